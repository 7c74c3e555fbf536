"""Gathers coded pictures of a video into chunks of an MCAP recording, and compresses small pictures."""

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
from schemas.mcap.chunks import ChunkSize
from schemas.mcap.content_hash import LARGE_MESSAGE_BYTES, HashedMessage
from schemas.mcap.records import Buffer

FULL_CHUNK_BYTES: Final = 1 << 20
"""Size [bytes] from which on the next key picture begins a new chunk.

Writing a chunk takes as much time as writing ten pictures.
"""
_SMALL_PICTURE_BYTES: Final = 1024
"""Mean size of a picture with its message record [bytes] below which a chunk is compressed.

The 100 bytes of record around each picture are mostly those around the previous one.
"""
_MAX_COMPRESSED_BYTES: Final = 4 << 20
"""Size [bytes] from which on a chunk is not compressed, since it would be in memory twice."""
_COMPRESSION: Final = "zstd"
_COMPRESSION_LEVEL: Final = 3


class VideoChunk(NamedTuple):
    """A finished chunk: MCAP message records of n coded pictures, with their times, numbers and sizes."""

    messages: VideoMessages
    """times, sequence numbers and sizes of the n pictures"""
    records: list[memoryview]
    """n whole MCAP message records, one for each picture"""


class PreparedChunk(NamedTuple):
    """A chunk of coded pictures with its checksums and message index, ready to be written."""

    buffers: Sequence[Buffer]
    """parts of the chunk's records, compressed or as they are"""
    size: ChunkSize
    """sizes, checksum and kind of compression of the chunk"""
    index_entries: bytes
    """entries of its message index by time: log time [ns] and offset in the chunk, 16 bytes per message"""
    hashed: list[HashedMessage]
    """log time [ns], size, data and CRC-32 of each message, for the recording's content hash; data are empty
    for a large message, the CRC is 0 for a small one"""


@dataclass
class OpenChunk:
    """Unfinished MCAP chunk of a video's coded pictures, to which further pictures can be added."""

    _messages: list[VideoMessages] = field(default_factory=list)
    _records: list[memoryview] = field(default_factory=list)
    size: int = 0
    """size of its pictures [bytes]"""

    def add(self, messages: VideoMessages, records: list[memoryview]) -> None:
        """Append n coded pictures to the chunk.

        Args:
            messages: times, sequence numbers and sizes of the pictures' messages.
            records: whole MCAP message record of each picture.
        """
        self._messages.append(messages)
        self._records += records
        self.size += int(messages.sizes.sum())

    def closed(self) -> VideoChunk:
        """Finished chunk with all pictures that were added; there must be at least one.

        Nothing may be added afterwards.
        """
        columns = [np.concatenate(column) for column in zip(*self._messages, strict=True)]
        return VideoChunk(VideoMessages(*columns), self._records)


def prepare_chunk(chunk: VideoChunk) -> PreparedChunk:
    """Compute a chunk's checksums and message index, and compress it if its pictures are small.

    A chunk of 4 MiB or more, or one that compression would not make smaller, stays as it is.

    Returns:
        Its bytes as they are to be written, with sizes, checksums and index.
    """
    crc = 0
    hashed: list[HashedMessage] = []
    for time_ns, record in zip(chunk.messages.times_ns.tolist(), chunk.records, strict=True):
        crc = deflate.crc32(record, crc)
        data = record[container.MESSAGE_HEAD :]
        size = len(data)
        large = size >= LARGE_MESSAGE_BYTES
        hashed.append((time_ns, size, b"", deflate.crc32(data, 0)) if large else (time_ns, size, data, 0))
    sizes = np.array([len(record) for record in chunk.records])
    total = int(sizes.sum())
    entries = _index_entries(chunk.messages.times_ns, sizes)
    if total < min(_MAX_COMPRESSED_BYTES, _SMALL_PICTURE_BYTES * len(sizes)):
        compressed = zstandard.ZstdCompressor(level=_COMPRESSION_LEVEL).compress(b"".join(chunk.records))
        if len(compressed) < total:
            size = ChunkSize(total, crc, _COMPRESSION, len(compressed))
            return PreparedChunk([compressed], size, entries, hashed)
    return PreparedChunk(chunk.records, ChunkSize(total, crc, "", total), entries, hashed)


def _index_entries(times_ns: NDArray[np.int64], sizes: NDArray[np.int64]) -> bytes:
    """Bytes of the MCAP message index of n consecutive records, sorted by time.

    An entry has 16 bytes: log time [ns] and the record's offset in the chunk [bytes].

    Args:
        times_ns: (n,) log times [ns].
        sizes: (n,) sizes of the records [bytes].
    """
    offsets = np.cumsum(sizes) - sizes
    order = np.argsort(times_ns, kind="stable")
    return np.stack((times_ns[order], offsets[order]), axis=1).astype("<u8").tobytes()
