"""Packs chunks of messages with their indexes; decompresses and checks chunks that were read."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from schemas.mcap import records as container
from schemas.mcap.records import Buffer, ChunkRecord, ContainerError

MessagePlaces = dict[int, list[tuple[int, int]]]
"""channel id -> log time [ns] and offset in the chunk of each of its messages"""

_CHUNK_PLACE: Final = struct.Struct("<QQQQI")
_CHUNK_SIZES: Final = struct.Struct("<QQ")
_INDEX_OFFSET: Final = struct.Struct("<HQ")
_ONE_MESSAGE_INDEX: Final = struct.Struct("<BQHIQQ")
_ONE_CHUNK_INDEX: Final = struct.Struct("<BQQQQQIHQQIQQ")
"""chunk index record with one message index, uncompressed"""
_PLAUSIBLE_BYTES: Final = 1 << 24
_PLAUSIBLE_RATIO: Final = 1000
"""a compressed chunk that claims more than both of these is not decompressed"""


class ChunkEntry(NamedTuple):
    """One chunk and its message indexes, as the summary lists them."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    """bytes of the chunk record"""
    index_offsets: dict[int, int]
    """channel id -> offset of its message index record"""
    index_length: int
    """bytes of all its message index records, which follow the chunk"""
    compression: str
    stored_size: int
    uncompressed_size: int

    @property
    def end(self) -> int:
        """Offset after the chunk's message indexes."""
        return self.offset + self.length + self.index_length

    @classmethod
    def parse(cls, body: memoryview) -> ChunkEntry:
        """Parse the body of a chunk index record.

        Raises:
            ContainerError: it is damaged.
        """
        try:
            start_ns, end_ns, offset, length, size = _CHUNK_PLACE.unpack_from(body)
            offsets = _parse_index_offsets(body, size)
            at = _CHUNK_PLACE.size + size
            index_length, name_size = struct.unpack_from("<QI", body, at)
            at += 12 + name_size
            compression = str(body[at - name_size : at], "ascii") if name_size else ""
            stored, uncompressed = _CHUNK_SIZES.unpack_from(body, at)
        except (struct.error, UnicodeDecodeError):
            raise ContainerError("a chunk index record is damaged") from None
        return cls(start_ns, end_ns, offset, length, offsets, index_length, compression, stored, uncompressed)

    def pack(self) -> bytes:
        """Chunk index record."""
        offsets = b"".join(_INDEX_OFFSET.pack(*entry) for entry in self.index_offsets.items())
        place = _CHUNK_PLACE.pack(self.start_ns, self.end_ns, self.offset, self.length, len(offsets))
        sizes = _CHUNK_SIZES.pack(self.stored_size, self.uncompressed_size)
        compression = struct.pack("<Q", self.index_length) + container.pack_string(self.compression)
        return container.pack_record(container.CHUNK_INDEX, place + offsets + compression + sizes)


def parse_chunk_offsets(body: memoryview) -> tuple[int, dict[int, int]]:
    """Offset of a chunk, and of its message index records by channel id, from a chunk index record's body.

    Opening a recording with thousands of chunks needs only these; `ChunkEntry.parse` also reads the rest.

    Raises:
        ContainerError: the record ends early.
    """
    try:
        _, _, offset, _, size = _CHUNK_PLACE.unpack_from(body)
    except struct.error:
        raise ContainerError("a chunk index record is damaged") from None
    return offset, _parse_index_offsets(body, size)


def _parse_index_offsets(body: memoryview, size: int) -> dict[int, int]:
    end = _CHUNK_PLACE.size + size
    if end > len(body) or size % _INDEX_OFFSET.size:
        raise ContainerError("a chunk index record ends early")
    return dict(_INDEX_OFFSET.iter_unpack(body[_CHUNK_PLACE.size : end]))


@dataclass
class PendingMessages:
    """Messages gathered for the next chunk."""

    data: bytearray = field(default_factory=bytearray)
    """whole message records"""
    places: MessagePlaces = field(default_factory=dict[int, list[tuple[int, int]]])

    def add(
        self, channel_id: int, sequence: int, log_time_ns: int, publish_time_ns: int, data: Buffer
    ) -> None:
        """Append one message."""
        records = self.data
        self.places.setdefault(channel_id, []).append((log_time_ns, len(records)))
        records += container.message_head(channel_id, sequence, log_time_ns, publish_time_ns, len(data))
        records += data


class PackedChunk(NamedTuple):
    """Bytes around a chunk's messages in the file, and the chunk index record for the summary."""

    head: bytes
    indexes: bytes
    entry: bytes


class ChunkSize(NamedTuple):
    """Size, checksum and compression of a chunk's messages."""

    size: int
    """bytes of the messages"""
    crc: int
    """CRC-32 of the uncompressed messages"""
    compression: str
    """"" for none"""
    stored: int
    """bytes in the file"""


def pack_chunk(offset: int, size: int, crc: int, places: MessagePlaces) -> PackedChunk:
    """Pack the frame of an uncompressed chunk of `size` bytes of messages that is written at `offset`."""
    if len(places) == 1:
        [(channel_id, entries)] = places.items()
        if len(entries) == 1:
            return pack_chunk_of_one(offset, size, crc, channel_id, entries[0])
    start = min(min(entries)[0] for entries in places.values())
    end = max(max(entries)[0] for entries in places.values())
    head = container.chunk_head(start, end, size, crc)
    at = offset + len(head) + size
    indexes = b""
    offsets: dict[int, int] = {}
    for channel_id, entries in places.items():
        offsets[channel_id] = at + len(indexes)
        indexes += container.pack_message_index(channel_id, entries)
    entry = ChunkEntry(start, end, offset, len(head) + size, offsets, len(indexes), "", size, size)
    return PackedChunk(head, indexes, entry.pack())


def pack_chunk_of_channel(
    offset: int, times_ns: tuple[int, int], chunk: ChunkSize, channel_id: int, index_entries: bytes
) -> PackedChunk:
    """Pack the frame of a chunk of one channel whose message index entries are packed already.

    Args:
        offset: offset of the chunk in the file [bytes].
        times_ns: first and last log time [ns].
        chunk: size, checksum and compression of its messages.
        channel_id: channel of all its messages.
        index_entries: packed log time and offset of each message, by time.
    """
    start, end = times_ns
    if chunk.compression:
        head = container.compressed_chunk_head(
            start, end, chunk.size, chunk.crc, chunk.compression, chunk.stored
        )
    else:
        head = container.chunk_head(start, end, chunk.size, chunk.crc)
    record = container.message_index_record(channel_id, index_entries)
    length = len(head) + chunk.stored
    offsets = {channel_id: offset + length}
    entry = ChunkEntry(
        start, end, offset, length, offsets, len(record), chunk.compression, chunk.stored, chunk.size
    )
    return PackedChunk(head, record, entry.pack())


def pack_chunk_of_one(
    offset: int, size: int, crc: int, channel_id: int, entry: tuple[int, int]
) -> PackedChunk:
    """Pack the frame of a chunk of one message, in a fifth of the time of the general `pack_chunk`.

    At line rate there are 365 such chunks in a second.
    """
    time_ns, at = entry
    head = container.chunk_head(time_ns, time_ns, size, crc)
    index = _ONE_MESSAGE_INDEX.pack(container.MESSAGE_INDEX, 22, channel_id, 16, time_ns, at)
    length = len(head) + size
    place = (time_ns, time_ns, offset, length, 10, channel_id, offset + length, len(index), 0, size, size)
    body_size = _ONE_CHUNK_INDEX.size - container.RECORD_HEAD
    return PackedChunk(head, index, _ONE_CHUNK_INDEX.pack(container.CHUNK_INDEX, body_size, *place))


def chunk_messages(chunk: ChunkRecord) -> memoryview:
    """Message records of a chunk, decompressed where needed; size and CRC are checked.

    Raises:
        ContainerError: the chunk is damaged, or its compression is unknown.
    """
    data = _decompressed(chunk)
    if len(data) != chunk.uncompressed_size:
        raise ContainerError(f"chunk holds {len(data)} bytes instead of {chunk.uncompressed_size}")
    if chunk.crc and zlib.crc32(data) != chunk.crc:
        raise ContainerError("chunk is damaged (CRC)")
    return data


def _decompressed(chunk: ChunkRecord) -> memoryview:
    if not chunk.compression:
        return chunk.records
    if chunk.uncompressed_size > max(_PLAUSIBLE_BYTES, _PLAUSIBLE_RATIO * len(chunk.records)):
        raise ContainerError("chunk claims an impossible size")
    if chunk.compression == "lz4":
        import lz4.frame  # comes with mcap

        try:
            return memoryview(lz4.frame.decompress(chunk.records))
        except RuntimeError as error:
            raise ContainerError(f"chunk cannot be decompressed: {error}") from None
    if chunk.compression == "zstd":
        import zstandard  # comes with mcap

        decompressor = zstandard.ZstdDecompressor()
        try:
            return memoryview(decompressor.decompress(chunk.records, max_output_size=chunk.uncompressed_size))
        except zstandard.ZstdError as error:
            raise ContainerError(f"chunk cannot be decompressed: {error}") from None
    raise ContainerError(f"chunk compression {chunk.compression!r} is not known")
