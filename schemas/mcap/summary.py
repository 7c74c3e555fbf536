"""The summary at the end of a recording: what stands where. Built while the data section is written, or scanned from one."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from schemas.mcap import records as container
from schemas.topics import Topic

_CHUNK_TIMES: Final = struct.Struct("<QQ")
_CHUNK_PLACE: Final = struct.Struct("<QQQQI")
_INDEX_OFFSET: Final = struct.Struct("<HQ")
_ONE_INDEX: Final = struct.Struct("<BQHIQQ")
_ONE_CHUNK_INDEX: Final = struct.Struct("<BQQQQQIHQQIQQ")
"""with one message index, uncompressed"""


class ChunkEntry(NamedTuple):
    """One chunk and its message indexes."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    """of the chunk record"""
    index_offsets: dict[int, int]
    """channel id -> offset of its message index record"""
    index_length: int
    """of all message index records"""
    compression: str
    stored_size: int
    uncompressed_size: int

    @classmethod
    def parse(cls, body: memoryview) -> ChunkEntry:
        """From the body of a chunk index record.

        Raises:
            ContainerError: it ends early.
        """
        try:
            start_ns, end_ns, offset, length, size = struct.unpack_from("<QQQQI", body)
            offsets = dict(struct.iter_unpack("<HQ", body[36 : 36 + size]))
            index_length, name_size = struct.unpack_from("<QI", body, 36 + size)
            at = 36 + size + 12 + name_size
            stored, uncompressed = struct.unpack_from("<QQ", body, at)
            return cls(
                start_ns, end_ns, offset, length, offsets, index_length, str(body[at - name_size : at], "ascii"), stored, uncompressed
            )
        except (struct.error, UnicodeDecodeError):
            raise container.ContainerError("a chunk index record is damaged") from None

    def pack(self) -> bytes:
        """Chunk index record."""
        size = 10 * len(self.index_offsets)
        offsets = b"".join(_INDEX_OFFSET.pack(*entry) for entry in self.index_offsets.items())
        times = _CHUNK_PLACE.pack(self.start_ns, self.end_ns, self.offset, self.length, size)
        end = struct.pack("<QQ", self.stored_size, self.uncompressed_size)
        body = times + offsets + struct.pack("<Q", self.index_length) + container.string(self.compression) + end
        return container.record(container.CHUNK_INDEX, body)


@dataclass
class Summary:
    """Grows with the file; `pack` gives everything that follows the data section's last chunk."""

    schemas: list[bytes] = field(default_factory=list)
    """whole records"""
    channels: list[bytes] = field(default_factory=list)
    """whole records"""
    chunks: list[bytes] = field(default_factory=list)
    """whole chunk index records: of thousands the garbage collector must not count each"""
    attachments: list[bytes] = field(default_factory=list)
    """whole attachment index records"""
    metadata: list[bytes] = field(default_factory=list)
    """whole metadata index records"""
    message_counts: Counter[int] = field(default_factory=Counter)
    """by channel id"""

    def add_attachment(self, offset: int, length: int, attachment: container.AttachmentRecord, size: int) -> None:
        """Note an attachment record of `length` bytes at `offset` that holds `size` bytes of data."""
        body = struct.pack("<QQQQQ", offset, length, attachment.log_time_ns, attachment.log_time_ns, size)
        body += container.string(attachment.name) + container.string(attachment.media_type)
        self.attachments.append(container.record(container.ATTACHMENT_INDEX, body))

    def add_metadata(self, offset: int, length: int, name: str) -> None:
        """Note a metadata record of `length` bytes at `offset`."""
        self.metadata.append(container.record(container.METADATA_INDEX, struct.pack("<QQ", offset, length) + container.string(name)))

    def pack(self, offset: int) -> bytes:
        """DataEnd, summary, summary offsets, footer and magic, to be written at `offset`."""
        data_end = container.record(container.DATA_END, struct.pack("<I", 0))
        start = offset + len(data_end)
        summary = bytearray()
        groups: list[bytes] = []
        for opcode, records in (
            (container.SCHEMA, self.schemas),
            (container.CHANNEL, self.channels),
            (container.STATISTICS, [self._statistics()]),
            (container.CHUNK_INDEX, self.chunks),
            (container.ATTACHMENT_INDEX, self.attachments),
            (container.METADATA_INDEX, self.metadata),
        ):
            if records:
                group = b"".join(records)
                body = struct.pack("<BQQ", opcode, start + len(summary), len(group))
                groups.append(container.record(container.SUMMARY_OFFSET, body))
                summary += group
        offsets_start = start + len(summary)
        summary += b"".join(groups)
        footer = struct.pack("<BQQQ", container.FOOTER, 20, start, offsets_start)
        crc = zlib.crc32(footer, zlib.crc32(summary))
        return data_end + bytes(summary) + footer + struct.pack("<I", crc) + container.MAGIC

    def _statistics(self) -> bytes:
        counts = b"".join(struct.pack("<HQ", *entry) for entry in sorted(self.message_counts.items()))
        numbers = struct.pack(
            "<QHIIIIQQ",
            self.message_counts.total(),
            len(self.schemas),
            len(self.channels),
            len(self.attachments),
            len(self.metadata),
            len(self.chunks),
            min((_CHUNK_TIMES.unpack_from(chunk, container.RECORD_HEAD)[0] for chunk in self.chunks), default=0),
            max((_CHUNK_TIMES.unpack_from(chunk, container.RECORD_HEAD)[1] for chunk in self.chunks), default=0),
        )
        return container.record(container.STATISTICS, numbers + struct.pack("<I", len(counts)) + counts)


class PackedChunk(NamedTuple):
    """What stands around a chunk's messages in the file, and its chunk index record for the summary."""

    head: bytes
    indexes: bytes
    entry: bytes


def pack_chunk(offset: int, size: int, crc: int, index: dict[int, list[tuple[int, int]]]) -> PackedChunk:
    """Frame an uncompressed chunk of `size` bytes at `offset`; `index` is channel id -> (log time, offset in the chunk) of each message."""
    if len(index) == 1:
        [(channel_id, entries)] = index.items()
        if len(entries) == 1:
            return pack_chunk_of_one(offset, size, crc, channel_id, entries[0])
    start, end = min(min(entries)[0] for entries in index.values()), max(max(entries)[0] for entries in index.values())
    head = container.chunk_head(start, end, size, crc)
    at = offset + len(head) + size
    indexes = b""
    offsets: dict[int, int] = {}
    for channel_id, entries in index.items():
        offsets[channel_id] = at + len(indexes)
        indexes += container.message_index(channel_id, entries)
    entry = ChunkEntry(start, end, offset, len(head) + size, offsets, len(indexes), "", size, size)
    return PackedChunk(head, indexes, entry.pack())


class ChunkSize(NamedTuple):
    """Bytes of a chunk's messages, and how they are stored."""

    size: int
    crc: int
    """of the messages"""
    compression: str
    """"" for none"""
    stored: int
    """bytes in the file"""


def pack_chunk_of_channel(offset: int, times_ns: tuple[int, int], chunk: ChunkSize, channel_id: int, index: bytes) -> PackedChunk:
    """`pack_chunk` of one channel's messages, whose message index is packed: first and last log time, entries by time."""
    start, end = times_ns
    if chunk.compression:
        head = container.compressed_chunk_head(start, end, chunk.size, chunk.crc, chunk.compression, chunk.stored)
    else:
        head = container.chunk_head(start, end, chunk.size, chunk.crc)
    record = container.packed_message_index(channel_id, index)
    length = len(head) + chunk.stored
    entry = ChunkEntry(start, end, offset, length, {channel_id: offset + length}, len(record), chunk.compression, chunk.stored, chunk.size)
    return PackedChunk(head, record, entry.pack())


def pack_chunk_of_one(offset: int, size: int, crc: int, channel_id: int, entry: tuple[int, int]) -> PackedChunk:
    """`pack_chunk` of a chunk of one message, at a fifth of the time: at line rate there are 365 in a second."""
    time_ns, at = entry
    head = container.chunk_head(time_ns, time_ns, size, crc)
    index = _ONE_INDEX.pack(container.MESSAGE_INDEX, 22, channel_id, 16, time_ns, at)
    length = len(head) + size
    place = (time_ns, time_ns, offset, length, 10, channel_id, offset + length, len(index), 0, size, size)
    return PackedChunk(head, index, _ONE_CHUNK_INDEX.pack(container.CHUNK_INDEX, _ONE_CHUNK_INDEX.size - container.RECORD_HEAD, *place))


def pack_topic(topic: Topic, number: int) -> tuple[bytes, bytes]:
    """Schema and channel record of a topic; both carry the same number."""
    data = topic.schema_data()
    schema = struct.pack("<H", number) + container.string(topic.schema_name) + container.string("protobuf")
    channel = struct.pack("<HH", number, number) + container.string(topic.name) + container.string("protobuf") + container.string_map({})
    return (
        container.record(container.SCHEMA, schema + struct.pack("<I", len(data)) + data),
        container.record(container.CHANNEL, channel),
    )
