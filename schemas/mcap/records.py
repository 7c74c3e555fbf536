"""Byte layout of single MCAP records: packing and parsing.

Source: the MCAP format specification (https://mcap.dev/spec). The recorder writes image chunks without
copying, the reader hands out views into a mapped file, and both must survive files that end anywhere. Every
parse function checks each length against the bytes present and raises `ContainerError`, so that a damaged
file can neither be read past its end nor make the reader allocate memory.
"""

from __future__ import annotations

import itertools
import struct
import zlib
from dataclasses import dataclass
from typing import Final, NamedTuple

Buffer = bytes | bytearray | memoryview

MAGIC: Final = b"\x89MCAP0\r\n"
HEADER: Final = 1
FOOTER: Final = 2
SCHEMA: Final = 3
CHANNEL: Final = 4
MESSAGE: Final = 5
CHUNK: Final = 6
MESSAGE_INDEX: Final = 7
CHUNK_INDEX: Final = 8
ATTACHMENT: Final = 9
ATTACHMENT_INDEX: Final = 10
STATISTICS: Final = 11
METADATA: Final = 12
METADATA_INDEX: Final = 13
SUMMARY_OFFSET: Final = 14
DATA_END: Final = 15
PADDING: Final = 0x80
"""Zeros that align the next record with a page of the file.

The format leaves 0x80 and above to applications; readers skip them.
"""

RECORD_HEAD: Final = 9
"""Bytes before every record's body: opcode and length."""
MESSAGE_HEAD: Final = 31
"""Bytes before every message's data: record head and fixed fields."""
CHUNK_HEAD: Final = 49
"""Bytes before an uncompressed chunk's messages: record head and fixed fields."""
FOOTER_SIZE: Final = RECORD_HEAD + 20
"""Bytes of the footer record."""

_MESSAGE_FIELDS: Final = struct.Struct("<HIQQ")
_PACKED_MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
_INDEX_ENTRY_BYTES: Final = 16


class ContainerError(ValueError):
    """Bytes that violate the MCAP format."""


# --- packing


def pack_record(opcode: int, body: bytes) -> bytes:
    """Whole record with this opcode and body."""
    return struct.pack("<BQ", opcode, len(body)) + body


def pack_string(text: str) -> bytes:
    """Length-prefixed UTF-8."""
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def pack_string_map(entries: dict[str, str]) -> bytes:
    """Length-prefixed map of strings."""
    data = b"".join(pack_string(key) + pack_string(value) for key, value in entries.items())
    return struct.pack("<I", len(data)) + data


def pack_metadata(name: str, entries: dict[str, str]) -> bytes:
    """Metadata record."""
    return pack_record(METADATA, pack_string(name) + pack_string_map(entries))


def pack_attachment(name: str, media_type: str, data: bytes, log_time_ns: int) -> bytes:
    """Attachment record with its CRC; creation time and log time are the same."""
    names = pack_string(name) + pack_string(media_type)
    body = struct.pack("<QQ", log_time_ns, log_time_ns) + names + struct.pack("<Q", len(data)) + data
    return pack_record(ATTACHMENT, body + struct.pack("<I", zlib.crc32(body)))


def message_head(channel_id: int, sequence: int, log_time_ns: int, publish_time_ns: int, size: int) -> bytes:
    """Bytes of a message record before its data of `size` bytes."""
    return _PACKED_MESSAGE_HEAD.pack(
        MESSAGE, 22 + size, channel_id, sequence & 0xFFFFFFFF, log_time_ns, publish_time_ns
    )


def chunk_head(start_ns: int, end_ns: int, size: int, crc: int) -> bytes:
    """Bytes of an uncompressed chunk record before its messages of `size` bytes and CRC-32 `crc`."""
    return struct.pack("<BQQQQIIQ", CHUNK, 40 + size, start_ns, end_ns, size, crc, 0, size)


def compressed_chunk_head(
    start_ns: int, end_ns: int, size: int, crc: int, compression: str, stored: int
) -> bytes:
    """Bytes of a compressed chunk record before its `stored` bytes of compressed messages.

    `size` [bytes] and `crc` are those of the uncompressed messages.
    """
    name = pack_string(compression)
    fixed = struct.pack("<BQQQQI", CHUNK, 36 + len(name) + stored, start_ns, end_ns, size, crc)
    return fixed + name + struct.pack("<Q", stored)


def pack_message_index(channel_id: int, entries: list[tuple[int, int]]) -> bytes:
    """Message index record of one channel in one chunk; entries are (log time [ns], offset in the chunk)."""
    numbers = itertools.chain.from_iterable(sorted(entries))
    return message_index_record(channel_id, struct.pack(f"<{2 * len(entries)}Q", *numbers))


def message_index_record(channel_id: int, packed_entries: bytes) -> bytes:
    """Message index record whose entries are already packed and ordered by time."""
    return (
        struct.pack("<BQHI", MESSAGE_INDEX, 6 + len(packed_entries), channel_id, len(packed_entries))
        + packed_entries
    )


# --- parsing


@dataclass(frozen=True)
class SchemaRecord:
    """Message type: name, encoding and definition."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class ChannelRecord:
    """Channel: the topic it carries, its schema and its message encoding."""

    id: int
    schema_id: int
    topic: str
    encoding: str


class MessageRecord(NamedTuple):
    """One message; `data` is a view into the bytes it was parsed from."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: memoryview


@dataclass(frozen=True)
class ChunkRecord:
    """Chunk of messages; `records` is a view of its message records as stored, possibly compressed."""

    start_ns: int
    end_ns: int
    uncompressed_size: int
    crc: int
    compression: str
    records: memoryview


@dataclass(frozen=True)
class AttachmentRecord:
    """Attached file."""

    name: str
    media_type: str
    log_time_ns: int
    data: bytes


@dataclass(frozen=True)
class MetadataRecord:
    """Named map of strings."""

    name: str
    entries: dict[str, str]


class _Fields:
    """Cursor over a record's fields that never reads past the end of its body."""

    def __init__(self, body: memoryview, record_name: str) -> None:
        self._body = body
        self._at = 0
        self._record_name = record_name

    @property
    def remaining(self) -> int:
        """Bytes of the body that are not read yet."""
        return len(self._body) - self._at

    def numbers(self, layout: str) -> tuple[int, ...]:
        size = struct.calcsize(layout)
        return struct.unpack(layout, self.take(size))

    def take(self, size: int) -> memoryview:
        if size > self.remaining:
            raise ContainerError(f"{self._record_name} record ends early")
        self._at += size
        return self._body[self._at - size : self._at]

    def prefixed(self) -> memoryview:
        return self.take(self.numbers("<I")[0])

    def string(self) -> str:
        try:
            return str(self.prefixed(), "utf-8")
        except UnicodeDecodeError:
            raise ContainerError(f"{self._record_name} record holds text that is not UTF-8") from None


def parse_schema(body: memoryview) -> SchemaRecord:
    """Parse the body of a schema record."""
    fields = _Fields(body, "schema")
    (number,) = fields.numbers("<H")
    return SchemaRecord(number, fields.string(), fields.string(), bytes(fields.prefixed()))


def parse_channel(body: memoryview) -> ChannelRecord:
    """Parse the body of a channel record."""
    fields = _Fields(body, "channel")
    number, schema_id = fields.numbers("<HH")
    return ChannelRecord(number, schema_id, fields.string(), fields.string())


def parse_message(body: memoryview) -> MessageRecord:
    """Parse the body of a message record."""
    if len(body) < _MESSAGE_FIELDS.size:
        raise ContainerError("message record ends early")
    channel_id, sequence, log_time, publish_time = _MESSAGE_FIELDS.unpack_from(body)
    return MessageRecord(channel_id, sequence, log_time, publish_time, body[22:])


def parse_chunk(body: memoryview) -> ChunkRecord:
    """Parse the body of a chunk record."""
    fields = _Fields(body, "chunk")
    start, end, size, crc = fields.numbers("<QQQI")
    compression = fields.string()
    return ChunkRecord(start, end, size, crc, compression, fields.take(fields.numbers("<Q")[0]))


def parse_attachment(body: memoryview) -> AttachmentRecord:
    """Parse the body of an attachment record and check its CRC."""
    fields = _Fields(body, "attachment")
    log_time, _ = fields.numbers("<QQ")
    name, media_type = fields.string(), fields.string()
    data = bytes(fields.take(fields.numbers("<Q")[0]))
    (crc,) = fields.numbers("<I")
    if crc and crc != zlib.crc32(body[:-4]):
        raise ContainerError(f"attachment {name!r} is damaged")
    return AttachmentRecord(name, media_type, log_time, data)


def parse_metadata(body: memoryview) -> MetadataRecord:
    """Parse the body of a metadata record."""
    fields = _Fields(body, "metadata")
    name = fields.string()
    entries = _Fields(fields.prefixed(), "metadata")
    result: dict[str, str] = {}
    while entries.remaining:
        key = entries.string()
        result[key] = entries.string()
    return MetadataRecord(name, result)


def parse_header(body: memoryview) -> tuple[str, str]:
    """Profile and library, from the body of a header record."""
    fields = _Fields(body, "header")
    return fields.string(), fields.string()


def parse_index_entries(body: memoryview) -> tuple[int, memoryview]:
    """Parse a message index record into channel id and packed entries (log time u64, offset u64)."""
    fields = _Fields(body, "message index")
    channel_id, size = fields.numbers("<HI")
    entries = fields.take(size)
    if size % _INDEX_ENTRY_BYTES:
        raise ContainerError("message index record holds half an entry")
    return channel_id, entries


def parse_message_index(body: memoryview) -> tuple[int, list[tuple[int, int]]]:
    """Parse a message index record into channel id and (log time [ns], offset) of each message."""
    channel_id, entries = parse_index_entries(body)
    return channel_id, list(struct.iter_unpack("<QQ", entries))
