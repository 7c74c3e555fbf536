"""Byte layout of single MCAP records: packing and parsing.

Source: the MCAP format specification (https://mcap.dev/spec). The recorder writes image chunks without
copying, the reader hands out views into a mapped file, and both must survive files that end anywhere. A
record is its opcode (a byte that states the kind of record), the length of its body, and the body. Every
parse function takes the body of a record (without opcode and length), checks each length against the bytes
present and raises `ContainerError`, so that a damaged file can neither be read past its end nor make the
reader allocate memory that the file only claims to need.
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
    """Bytes that violate the MCAP format; the message states the violation."""


# --- packing


def pack_record(opcode: int, body: bytes) -> bytes:
    """Whole record: opcode (1 byte), length of the body (8 bytes), body."""
    return struct.pack("<BQ", opcode, len(body)) + body


def pack_string(text: str) -> bytes:
    """Text as UTF-8 after its length in bytes (4 bytes)."""
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def pack_string_map(entries: dict[str, str]) -> bytes:
    """Map of strings after its length in bytes (4 bytes); keys and values are length-prefixed UTF-8."""
    data = b"".join(pack_string(key) + pack_string(value) for key, value in entries.items())
    return struct.pack("<I", len(data)) + data


def pack_metadata(name: str, entries: dict[str, str]) -> bytes:
    """Whole metadata record: a map of strings with a name."""
    return pack_record(METADATA, pack_string(name) + pack_string_map(entries))


def pack_attachment(name: str, media_type: str, data: bytes, log_time_ns: int) -> bytes:
    """Whole attachment record, which holds a file, with its CRC; creation time and log time are the same.

    Args:
        name: name of the attached file.
        media_type: media type, for example "application/json".
        data: content of the file.
        log_time_ns: log time and creation time [ns].
    """
    names = pack_string(name) + pack_string(media_type)
    body = struct.pack("<QQ", log_time_ns, log_time_ns) + names + struct.pack("<Q", len(data)) + data
    return pack_record(ATTACHMENT, body + struct.pack("<I", zlib.crc32(body)))


def message_head(channel_id: int, sequence: int, log_time_ns: int, publish_time_ns: int, size: int) -> bytes:
    """Bytes of a message record before its data of `size` bytes; `sequence` is taken modulo 2^32."""
    return _PACKED_MESSAGE_HEAD.pack(
        MESSAGE, 22 + size, channel_id, sequence & 0xFFFFFFFF, log_time_ns, publish_time_ns
    )


def chunk_head(start_ns: int, end_ns: int, size: int, crc: int) -> bytes:
    """Bytes of an uncompressed chunk record before its messages.

    Args:
        start_ns: smallest log time of the messages [ns].
        end_ns: largest log time [ns].
        size: bytes of the messages.
        crc: CRC-32 of the messages.
    """
    return struct.pack("<BQQQQIIQ", CHUNK, 40 + size, start_ns, end_ns, size, crc, 0, size)


def compressed_chunk_head(
    start_ns: int, end_ns: int, size: int, crc: int, compression: str, stored: int
) -> bytes:
    """Bytes of a compressed chunk record before its compressed messages.

    Args:
        start_ns: smallest log time of the messages [ns].
        end_ns: largest log time [ns].
        size: bytes of the uncompressed messages.
        crc: CRC-32 of the uncompressed messages.
        compression: "lz4" or "zstd"; "" for none.
        stored: bytes of the compressed messages.
    """
    name = pack_string(compression)
    fixed = struct.pack("<BQQQQI", CHUNK, 36 + len(name) + stored, start_ns, end_ns, size, crc)
    return fixed + name + struct.pack("<Q", stored)


def pack_message_index(channel_id: int, entries: list[tuple[int, int]]) -> bytes:
    """Whole message index record of one channel in one chunk.

    Args:
        channel_id: the channel.
        entries: log time [ns] and offset in the chunk of each message, in any order; written by time.
    """
    numbers = itertools.chain.from_iterable(sorted(entries))
    return message_index_record(channel_id, struct.pack(f"<{2 * len(entries)}Q", *numbers))


def message_index_record(channel_id: int, packed_entries: bytes) -> bytes:
    """Whole message index record whose entries are already packed and ordered by time."""
    return (
        struct.pack("<BQHI", MESSAGE_INDEX, 6 + len(packed_entries), channel_id, len(packed_entries))
        + packed_entries
    )


# --- parsing


@dataclass(frozen=True)
class SchemaRecord:
    """Message type: id, full name, encoding of the definition ("protobuf"), and definition."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class ChannelRecord:
    """Channel: its id, the id of its schema (message type), its topic's name and its message encoding."""

    id: int
    schema_id: int
    topic: str
    encoding: str


class MessageRecord(NamedTuple):
    """One message: channel id, sequence number, log and publish time [ns], and data.

    `data` is a view into the bytes that the message was parsed from.
    """

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: memoryview


@dataclass(frozen=True)
class ChunkRecord:
    """Chunk of messages; `records` is a view of its message records as stored, possibly compressed.

    `crc` is the CRC-32 of the uncompressed records, 0 if there is none.
    """

    start_ns: int
    """smallest log time of the messages [ns]"""
    end_ns: int
    """largest log time of the messages [ns]"""
    uncompressed_size: int
    """bytes of the records when decompressed"""
    crc: int
    compression: str
    """"lz4", "zstd", or "" for none"""
    records: memoryview


@dataclass(frozen=True)
class AttachmentRecord:
    """Attached file: its name, media type, log time [ns] and content."""

    name: str
    media_type: str
    log_time_ns: int
    data: bytes


@dataclass(frozen=True)
class MetadataRecord:
    """Metadata record: a map of strings with a name."""

    name: str
    entries: dict[str, str]


class _Fields:
    """Cursor over the fields of a record's body; reading past the end raises ContainerError.

    Args:
        body: body of the record.
        record_name: kind of record, for messages.
    """

    def __init__(self, body: memoryview, record_name: str) -> None:
        self._body = body
        self._at = 0
        self._record_name = record_name

    @property
    def remaining(self) -> int:
        """Number of bytes of the record's body that have not been read yet."""
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
    """Schema (message type) from the body of a schema record.

    Raises:
        ContainerError: the record is damaged.
    """
    fields = _Fields(body, "schema")
    (number,) = fields.numbers("<H")
    return SchemaRecord(number, fields.string(), fields.string(), bytes(fields.prefixed()))


def parse_channel(body: memoryview) -> ChannelRecord:
    """Channel from the body of a channel record; the metadata that follow the encoding are not read.

    Raises:
        ContainerError: the record is damaged.
    """
    fields = _Fields(body, "channel")
    number, schema_id = fields.numbers("<HH")
    return ChannelRecord(number, schema_id, fields.string(), fields.string())


def parse_message(body: memoryview) -> MessageRecord:
    """Message from the body of a message record; its data are a view.

    Raises:
        ContainerError: the record ends early.
    """
    if len(body) < _MESSAGE_FIELDS.size:
        raise ContainerError("message record ends early")
    channel_id, sequence, log_time, publish_time = _MESSAGE_FIELDS.unpack_from(body)
    return MessageRecord(channel_id, sequence, log_time, publish_time, body[22:])


def parse_chunk(body: memoryview) -> ChunkRecord:
    """Chunk from the body of a chunk record; its CRC is not checked.

    Raises:
        ContainerError: the record is damaged.
    """
    fields = _Fields(body, "chunk")
    start, end, size, crc = fields.numbers("<QQQI")
    compression = fields.string()
    return ChunkRecord(start, end, size, crc, compression, fields.take(fields.numbers("<Q")[0]))


def parse_attachment(body: memoryview) -> AttachmentRecord:
    """Attached file from the body of an attachment record; its data are a copy.

    Bytes behind the CRC are ignored: MCAP lets a writer extend a record by fields of its own.

    Raises:
        ContainerError: the record is damaged, or its CRC is neither 0 nor that of the content.
    """
    fields = _Fields(body, "attachment")
    log_time, _ = fields.numbers("<QQ")
    name, media_type = fields.string(), fields.string()
    data = bytes(fields.take(fields.numbers("<Q")[0]))
    covered = body[: len(body) - fields.remaining]
    (crc,) = fields.numbers("<I")
    if crc and crc != zlib.crc32(covered):
        raise ContainerError(f"attachment {name!r} is damaged")
    return AttachmentRecord(name, media_type, log_time, data)


def parse_metadata(body: memoryview) -> MetadataRecord:
    """Name and map of strings that the body of a metadata record holds.

    Raises:
        ContainerError: the record is damaged.
    """
    fields = _Fields(body, "metadata")
    name = fields.string()
    entries = _Fields(fields.prefixed(), "metadata")
    result: dict[str, str] = {}
    while entries.remaining:
        key = entries.string()
        result[key] = entries.string()
    return MetadataRecord(name, result)


def parse_header(body: memoryview) -> tuple[str, str]:
    """Profile and name of the writing library, both texts, from the body of a header record.

    The profile names a set of conventions that the file follows; it is "" in the recordings of this program.

    Raises:
        ContainerError: the record is damaged.
    """
    fields = _Fields(body, "header")
    return fields.string(), fields.string()


def parse_index_entries(body: memoryview) -> tuple[int, memoryview]:
    """Channel id and packed entries from the body of a message index record.

    Returns:
        The channel id, and a view of the entries of 16 bytes each: log time [ns] and offset in the chunk
        (u64).

    Raises:
        ContainerError: the record ends early, or holds half an entry.
    """
    fields = _Fields(body, "message index")
    channel_id, size = fields.numbers("<HI")
    entries = fields.take(size)
    if size % _INDEX_ENTRY_BYTES:
        raise ContainerError("message index record holds half an entry")
    return channel_id, entries


def parse_message_index(body: memoryview) -> tuple[int, list[tuple[int, int]]]:
    """Channel id and list of entries from the body of a message index record.

    Returns:
        The channel id, and log time [ns] and offset in the chunk of each message.

    Raises:
        ContainerError: the record ends early, or holds half an entry.
    """
    channel_id, entries = parse_index_entries(body)
    return channel_id, list(struct.iter_unpack("<QQ", entries))
