"""CRC-32 (IEEE) of image messages, each pixel read once: the only import of isal.

A chunk's CRC covers the message head as well as the data, the content id's only the data. Both follow from the image's own CRC by
`crc32_combine`. isal folds 64 bytes at a time with carry-less multiplication (Gopal et al., "Fast CRC computation for generic
polynomials using PCLMULQDQ", Intel 2009) and releases the interpreter; on the processor of docs/benchmarks.md it reads 57 GB/s where
zlib reads 4 GB/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from isal.isal_zlib import crc32, crc32_combine

from schemas.container import Buffer

_COMBINE_BYTES: Final = 8192
"""below it reading twice is cheaper than combining"""


class Checksums(NamedTuple):
    """CRC-32 of a chunk up to a message's end, and of that message's data alone."""

    chunk: int
    data: int


def checksums(chunk: int, head: Buffer, parts: Sequence[Buffer]) -> Checksums:
    """Continue the CRC `chunk` over a message's `head` and the `parts` of its data."""
    chunk, data = crc32(head, chunk), 0
    for part in parts:
        if (size := len(part)) < _COMBINE_BYTES:
            chunk, data = crc32(part, chunk), crc32(part, data)
        else:
            own = crc32(part)
            chunk, data = crc32_combine(chunk, own, size), crc32_combine(data, own, size)
    return Checksums(chunk, data)
