"""A compressed chunk is unpacked up to the size that it states, whatever the frame's own head states."""

from __future__ import annotations

import lz4.frame
import pytest
import zstandard

from schemas.mcap.chunks import MAX_DECOMPRESSED_BYTES, chunk_messages
from schemas.mcap.records import ChunkRecord, ContainerError
from tests.attack.hostile_files import lz4_declares, zstd_declares

FRAMES = {"lz4": lz4_declares(1 << 40), "zstd": zstd_declares(1 << 40)}
COMPRESS = {"lz4": lz4.frame.compress, "zstd": zstandard.ZstdCompressor().compress}


def _chunk(compression: str, stored: bytes, size: int) -> ChunkRecord:
    return ChunkRecord(0, 0, size, 0, compression, memoryview(stored))


@pytest.mark.parametrize("compression", FRAMES)
@pytest.mark.parametrize("size", [0, 1000, 1 << 24, MAX_DECOMPRESSED_BYTES + 1, 1 << 40, (1 << 64) - 1])
def test_a_frame_that_declares_a_terabyte_is_refused(compression, size):
    with pytest.raises(ContainerError):
        chunk_messages(_chunk(compression, FRAMES[compression], size))


@pytest.mark.parametrize("compression", COMPRESS)
def test_no_more_is_unpacked_than_the_chunk_states(compression):
    stored = COMPRESS[compression](bytes(100_000))
    assert chunk_messages(_chunk(compression, stored, 100_000)) == bytes(100_000)
    for size in (0, 1, 99_999, 100_001):
        with pytest.raises(ContainerError):
            chunk_messages(_chunk(compression, stored, size))


@pytest.mark.parametrize("compression", COMPRESS)
def test_a_frame_cut_anywhere_is_refused(compression):
    stored = COMPRESS[compression](bytes(range(256)) * 4)
    for end in range(len(stored)):
        with pytest.raises(ContainerError):
            chunk_messages(_chunk(compression, stored[:end], 1024))
