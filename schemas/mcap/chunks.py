"""Packing of MCAP chunks (blocks of messages) with their indexes, and checks of chunks that were read."""

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
"""greatest ratio of claimed to stored size at which a chunk of over _PLAUSIBLE_BYTES is decompressed"""
MAX_DECOMPRESSED_BYTES: Final = 1 << 28
"""largest chunk that is decompressed; writers use a few megabytes"""
_LZ4_RATIO: Final = 255


class ChunkEntry(NamedTuple):
    """One chunk and its message indexes, as the chunk index record in the file's summary lists them.

    Offsets are counted from the beginning of the file, lengths and sizes are in bytes.
    """

    start_ns: int
    """smallest log time of its messages [ns]"""
    end_ns: int
    """largest log time of its messages [ns]"""
    offset: int
    """offset of the chunk record"""
    length: int
    """bytes of the chunk record"""
    index_offsets: dict[int, int]
    """channel id -> offset of its message index record"""
    index_length: int
    """bytes of all its message index records, which follow the chunk"""
    compression: str
    """"lz4", "zstd", or "" for none"""
    stored_size: int
    """bytes of its messages in the file"""
    uncompressed_size: int
    """bytes of its messages when decompressed"""

    @property
    def end(self) -> int:
        """File offset after the chunk's last message index record."""
        return self.offset + self.length + self.index_length

    @classmethod
    def parse(cls, body: memoryview) -> ChunkEntry:
        """Entry from the body of a chunk index record (without opcode and length).

        Raises:
            ContainerError: the record is damaged.
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
        """Whole chunk index record of this entry, for the file's summary."""
        offsets = b"".join(_INDEX_OFFSET.pack(*entry) for entry in self.index_offsets.items())
        place = _CHUNK_PLACE.pack(self.start_ns, self.end_ns, self.offset, self.length, len(offsets))
        sizes = _CHUNK_SIZES.pack(self.stored_size, self.uncompressed_size)
        compression = struct.pack("<Q", self.index_length) + container.pack_string(self.compression)
        return container.pack_record(container.CHUNK_INDEX, place + offsets + compression + sizes)


def parse_chunk_offsets(body: memoryview) -> tuple[int, dict[int, int]]:
    """File offsets of a chunk and of its message index records, from a chunk index record's body.

    Opening a recording with thousands of chunks needs only these; `ChunkEntry.parse` also reads the rest.

    Returns:
        Offset of the chunk record, and offsets of the message index records by channel id.

    Raises:
        ContainerError: the record ends early, or its list of offsets is damaged.
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
    """Messages gathered for the next chunk: their packed records, and log time and offset of each."""

    data: bytearray = field(default_factory=bytearray)
    """whole message records"""
    places: MessagePlaces = field(default_factory=dict[int, list[tuple[int, int]]])
    """log time [ns] of each message and offset of its record in `data`, by channel id"""

    def add(
        self, channel_id: int, sequence: int, log_time_ns: int, publish_time_ns: int, data: Buffer
    ) -> None:
        """Append one message to the gathered ones.

        Args:
            channel_id: channel of the message.
            sequence: number of the message in its channel.
            log_time_ns: log time [ns since 1970].
            publish_time_ns: publish time [ns since 1970].
            data: serialised message; it is copied.
        """
        records = self.data
        self.places.setdefault(channel_id, []).append((log_time_ns, len(records)))
        records += container.message_head(channel_id, sequence, log_time_ns, publish_time_ns, len(data))
        records += data


class PackedChunk(NamedTuple):
    """Bytes before and after a chunk's messages in the file, and the chunk's entry for the summary."""

    head: bytes
    """bytes of the chunk record before its messages"""
    indexes: bytes
    """message index records, which follow the chunk"""
    entry: bytes
    """chunk index record"""


class ChunkSize(NamedTuple):
    """Size, checksum and compression of a chunk's messages."""

    size: int
    """bytes of the messages when decompressed"""
    crc: int
    """CRC-32 of the uncompressed messages"""
    compression: str
    """"lz4", "zstd", or "" for none"""
    stored: int
    """bytes of the messages in the file"""


def pack_chunk(offset: int, size: int, crc: int, places: MessagePlaces) -> PackedChunk:
    """Pack the parts of an uncompressed chunk that enclose its messages, and its entry for the summary.

    Args:
        offset: file offset at which the chunk is to be written [bytes].
        size: bytes of its messages.
        crc: CRC-32 of its messages.
        places: log time [ns] and offset in the chunk of each message, by channel id; at least one message.

    Returns:
        Bytes before and after the messages, and the chunk index record for the summary.
    """
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
    """Pack the parts of a chunk of one channel that enclose its messages, from packed index entries.

    Args:
        offset: file offset at which the chunk is to be written [bytes].
        times_ns: first and last log time [ns].
        chunk: size, checksum and compression of its messages.
        channel_id: channel of all its messages.
        index_entries: log time and offset in the chunk of each message, packed and ordered by time.

    Returns:
        Bytes before and after the messages, and the chunk index record for the summary.
    """
    start, end = times_ns
    head = container.compressed_chunk_head(start, end, *chunk)
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
    """Pack the parts of an uncompressed chunk of one message that enclose the message.

    It takes a fifth of the time of `pack_chunk`: at line rate there are 365 such chunks in a second.

    Args:
        offset: file offset at which the chunk is to be written [bytes].
        size: bytes of the message record.
        crc: CRC-32 of the message record.
        channel_id: channel of the message.
        entry: log time [ns] of the message and its offset in the chunk.

    Returns:
        Bytes before and after the message, and the chunk index record for the summary.
    """
    time_ns, at = entry
    head = container.chunk_head(time_ns, time_ns, size, crc)
    index = _ONE_MESSAGE_INDEX.pack(container.MESSAGE_INDEX, 22, channel_id, 16, time_ns, at)
    length = len(head) + size
    place = (time_ns, time_ns, offset, length, 10, channel_id, offset + length, len(index), 0, size, size)
    body_size = _ONE_CHUNK_INDEX.size - container.RECORD_HEAD
    return PackedChunk(head, index, _ONE_CHUNK_INDEX.pack(container.CHUNK_INDEX, body_size, *place))


def chunk_messages(chunk: ChunkRecord) -> memoryview:
    """Bytes of all records of a chunk, decompressed where needed, after checks of their size and CRC.

    The records are messages; in other programs' files also schemas and channels. A CRC of 0 means that the
    chunk has none. Without compression the result is a view of the chunk's own bytes.

    Raises:
        ContainerError: the chunk is damaged, or its compression is neither lz4 nor zstd.
    """
    data = _decompressed(chunk)
    if len(data) != chunk.uncompressed_size:
        raise ContainerError(f"chunk holds {len(data)} bytes instead of {chunk.uncompressed_size}")
    if chunk.crc and zlib.crc32(data) != chunk.crc:
        raise ContainerError("chunk is damaged (CRC)")
    return data


def refuse_bomb(chunk: ChunkRecord) -> None:
    """Raise ContainerError if a chunk, read by a library without bounds, would take too much memory.

    An LZ4 frame holds at most 255 times its own bytes; a small one need not be looked into.
    """
    if chunk.compression == "zstd":
        import zstandard  # comes with mcap

        try:
            stated = zstandard.frame_content_size(chunk.records)
        except zstandard.ZstdError as error:
            raise ContainerError(f"chunk cannot be decompressed: {error}") from None
        if max(stated, chunk.uncompressed_size) > MAX_DECOMPRESSED_BYTES:
            raise ContainerError("chunk claims an impossible size")
    elif len(chunk.records) * _LZ4_RATIO > MAX_DECOMPRESSED_BYTES:
        _decompressed(chunk)


def _decompressed(chunk: ChunkRecord) -> memoryview:
    if not chunk.compression:
        return chunk.records
    size = chunk.uncompressed_size
    if size > max(_PLAUSIBLE_BYTES, _PLAUSIBLE_RATIO * len(chunk.records)):
        raise ContainerError("chunk claims an impossible size")
    if size > MAX_DECOMPRESSED_BYTES:
        most = f"{MAX_DECOMPRESSED_BYTES >> 20} MB"
        raise ContainerError(f"chunk of {size >> 20} MB; compressed ones are read up to {most}")
    if chunk.compression == "lz4":
        return _without_lz4(chunk.records, size)
    if chunk.compression == "zstd":
        return _without_zstd(chunk.records, size)
    raise ContainerError(f"chunk compression {chunk.compression!r} is not known")


def _without_lz4(stored: memoryview, size: int) -> memoryview:
    """Content of an LZ4 frame, of which at most `size` bytes are unpacked, whatever its head states.

    Raises:
        ContainerError: the frame is damaged or holds more.
    """
    import lz4.frame  # comes with mcap

    decompressor = lz4.frame.LZ4FrameDecompressor()
    try:
        data = decompressor.decompress(stored, max_length=size)
        if not decompressor.eof:  # its end mark may be left
            data += decompressor.decompress(b"", max_length=1)
    except (RuntimeError, EOFError) as error:
        raise ContainerError(f"chunk cannot be decompressed: {error}") from None
    if not decompressor.eof:
        raise ContainerError("chunk cannot be decompressed: it is cut short, or holds more than it states")
    return memoryview(data)


def _without_zstd(stored: memoryview, size: int) -> memoryview:
    """Content of a Zstandard frame, of which at most `size` bytes are unpacked, whatever its head states.

    Raises:
        ContainerError: the frame is damaged or holds more.
    """
    import zstandard  # comes with mcap

    try:
        if zstandard.frame_content_size(stored) > size:
            raise ContainerError("chunk cannot be decompressed: it holds more than it states")
        return memoryview(zstandard.ZstdDecompressor().decompress(stored, max_output_size=size))
    except zstandard.ZstdError as error:
        raise ContainerError(f"chunk cannot be decompressed: {error}") from None
