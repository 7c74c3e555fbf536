"""The checksums of a message are those of its bytes, however it is divided into parts."""

from __future__ import annotations

import random
import zlib

from acquire.recorder.checksum import checksums


def test_every_split_gives_zlibs_crc() -> None:
    generator = random.Random(1)
    for _ in range(60):
        before = generator.randbytes(generator.choice([0, 1, 57, 5000]))
        head = generator.randbytes(31)
        sizes = generator.choices([0, 1, 44, 8191, 8192, 8193, 20_000, 322_752], k=generator.randrange(4))
        parts = [generator.randbytes(size) for size in sizes]
        data = b"".join(parts)
        found = checksums(zlib.crc32(before), head, parts)
        assert found == (zlib.crc32(before + head + data), zlib.crc32(data))
