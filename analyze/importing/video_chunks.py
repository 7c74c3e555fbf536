"""Coded pictures gathered to chunks: each begins with a key picture, and is packed where its pictures are small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import deflate
import numpy as np
import zstandard
from numpy.typing import NDArray

from analyze.sources.image_messages import VideoMessages
from schemas.mcap import records as container
from schemas.mcap.records import Buffer
from schemas.mcap.summary import ChunkSize

WHOLE_CHUNK: Final = 1 << 20
"""bytes of pictures from which on the next key picture begins another chunk: each costs as much time as ten pictures"""
_SMALL_PICTURE: Final = 1024
"""bytes of an average picture below which what stands around each counts: 100 bytes, most of them those of the one before"""
_PACKED_TOGETHER: Final = 4 << 20
"""bytes of a chunk from which on it is not packed: it would have to be held twice"""
_LEVEL: Final = 3
_PACKED: Final = "zstd"


class VideoChunk(NamedTuple):
    """A chunk of coded pictures."""

    messages: VideoMessages
    records: list[memoryview]
    """whole message records"""


class CheckedChunk(NamedTuple):
    """A chunk ready to be written."""

    buffers: Sequence[Buffer]
    size: ChunkSize
    entries: bytes
    """its message index's entries, by time"""
    identity: list[tuple[int, int, Buffer, int]]
    """of each message log time, size of its data, the data where they are small, their CRC-32"""


@dataclass
class OpenChunk:
    """A chunk that still grows."""

    _messages: list[VideoMessages] = field(default_factory=list)
    _records: list[memoryview] = field(default_factory=list)
    size: int = 0
    """bytes of its pictures"""

    def add(self, messages: VideoMessages, records: list[memoryview]) -> None:
        """Some more."""
        self._messages.append(messages)
        self._records += records
        self.size += int(messages.sizes.sum())

    def closed(self) -> VideoChunk:
        """All of them; nothing may be added any more."""
        columns = [np.concatenate(column) for column in zip(*self._messages, strict=True)]
        return VideoChunk(VideoMessages(*columns), self._records)


def checked(chunk: VideoChunk) -> CheckedChunk:
    """Checksums, index, and where it pays compression."""
    crc = 0
    identity: list[tuple[int, int, Buffer, int]] = []
    for time_ns, record in zip(chunk.messages.times_ns.tolist(), chunk.records, strict=True):
        crc = deflate.crc32(record, crc)
        data = record[container.MESSAGE_HEAD :]
        size = len(data)
        identity.append((time_ns, size, data, 0) if size < container.LARGE_MESSAGE else (time_ns, size, b"", deflate.crc32(data, 0)))
    sizes = np.array([len(record) for record in chunk.records])
    total = int(sizes.sum())
    entries = _entries(chunk.messages.times_ns, sizes)
    if total < min(_PACKED_TOGETHER, _SMALL_PICTURE * len(sizes)):
        packed = zstandard.ZstdCompressor(level=_LEVEL).compress(b"".join(chunk.records))
        if len(packed) < total:
            return CheckedChunk([packed], ChunkSize(total, crc, _PACKED, len(packed)), entries, identity)
    return CheckedChunk(chunk.records, ChunkSize(total, crc, "", total), entries, identity)


def _entries(times_ns: NDArray[np.int64], sizes: NDArray[np.int64]) -> bytes:
    places = np.cumsum(sizes) - sizes
    order = np.argsort(times_ns, kind="stable")
    return np.stack((times_ns[order], places[order]), axis=1).astype("<u8").tobytes()
