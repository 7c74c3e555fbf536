"""Coded pictures gathered to chunks: each begins with a key picture, and is packed where its pictures are small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import deflate
import numpy as np
import zstandard
from numpy.typing import NDArray

from analyze.importing.image_messages import VideoMessages
from schemas import container
from schemas.container import Buffer
from schemas.container_summary import ChunkSize

WHOLE_CHUNK: Final = 1 << 20
"""bytes of pictures from which on the next key picture begins another chunk: each costs as much time as ten pictures"""
_SMALL_PICTURE: Final = 1024
"""bytes of an average picture below which what stands around each counts: 100 bytes, most of them those of the one before"""
_PACKED_TOGETHER: Final = 4 << 20
"""bytes of a chunk from which on it is not packed: it would have to be held twice"""
_LEVEL: Final = 3
_PACKED: Final = "zstd"


class VideoChunk(NamedTuple):
    """A chunk of coded pictures: message by message its head and its picture."""

    messages: VideoMessages
    heads: list[bytes]
    """record head and all fields but the picture"""
    pictures: list[Buffer]


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
    _heads: list[bytes] = field(default_factory=list)
    _pictures: list[Buffer] = field(default_factory=list)
    size: int = 0
    """bytes of its pictures"""

    def add(self, messages: VideoMessages, heads: list[bytes], pictures: list[Buffer]) -> None:
        """Some more."""
        self._messages.append(messages)
        self._heads += heads
        self._pictures += pictures
        self.size += int(messages.sizes.sum())

    def closed(self) -> VideoChunk:
        """All of them; nothing may be added any more."""
        columns = [np.concatenate(column) for column in zip(*self._messages, strict=True)]
        return VideoChunk(VideoMessages(*columns), self._heads, self._pictures)


def checked(chunk: VideoChunk) -> CheckedChunk:
    """Checksums, index, and where it pays compression."""
    crc = 0
    identity: list[tuple[int, int, Buffer, int]] = []
    sizes: list[int] = []
    buffers: list[Buffer] = []
    own_head = container.MESSAGE_HEAD
    for time_ns, head, picture in zip(chunk.messages.times_ns.tolist(), chunk.heads, chunk.pictures, strict=True):
        sizes.append(len(head) + len(picture))
        buffers += (head, picture)
        crc = deflate.crc32(picture, deflate.crc32(head, crc))
        fields = head[own_head:]
        size = len(fields) + len(picture)
        if size < container.LARGE_MESSAGE:
            identity.append((time_ns, size, fields + picture, 0))
        else:
            identity.append((time_ns, size, b"", deflate.crc32(picture, deflate.crc32(fields, 0))))
    total = sum(sizes)
    entries = _entries(chunk.messages.times_ns, sizes)
    if total < min(_PACKED_TOGETHER, _SMALL_PICTURE * len(sizes)):
        packed = zstandard.ZstdCompressor(level=_LEVEL).compress(b"".join(buffers))
        if len(packed) < total:
            return CheckedChunk([packed], ChunkSize(total, crc, _PACKED, len(packed)), entries, identity)
    return CheckedChunk(buffers, ChunkSize(total, crc, "", total), entries, identity)


def _entries(times_ns: NDArray[np.int64], sizes: list[int]) -> bytes:
    places = np.cumsum([0, *sizes[:-1]])
    order = np.argsort(times_ns, kind="stable")
    return np.stack((times_ns[order], places[order]), axis=1).astype("<u8").tobytes()
