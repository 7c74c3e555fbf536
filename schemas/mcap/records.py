"""Byte layout of the MCAP container: pack and parse one record, and the hash that names a recording's content.

Source: the MCAP format specification (https://mcap.dev/spec). Both packages need it: the recorder writes image chunks without
copying, the reader hands out views into a mapped file, and both must survive files that end anywhere. Every parse function checks
each length against what is there and raises `ContainerError`, so that a damaged file can neither read past its end nor allocate.
"""

from __future__ import annotations

import hashlib
import itertools
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from schemas.topics import TRUTH_PREFIX

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
"""Zeros that bring what follows to a page of the file. The format leaves 0x80 and above to applications, and its readers skip them."""

RECORD_HEAD: Final = 9
"""opcode and length, before every record's body"""
MESSAGE_HEAD: Final = 31
"""record head and fixed fields, before every message's data"""
CHUNK_HEAD: Final = 49
"""record head and fixed fields, before an uncompressed chunk's messages"""
FOOTER_SIZE: Final = RECORD_HEAD + 20
LARGE_MESSAGE: Final = 4096
"""messages of this size and above enter the content hash by length and CRC-32"""


class ContainerError(ValueError):
    """Bytes that are not what the format promises."""


# --- packing ------------------------------------------------------------------------------------------------------


def record(opcode: int, body: bytes) -> bytes:
    """A whole record."""
    return struct.pack("<BQ", opcode, len(body)) + body


def string(text: str) -> bytes:
    """Length-prefixed UTF-8."""
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def string_map(entries: dict[str, str]) -> bytes:
    """Length-prefixed map of strings."""
    data = b"".join(string(key) + string(value) for key, value in entries.items())
    return struct.pack("<I", len(data)) + data


def message_head(channel_id: int, sequence: int, log_time_ns: int, publish_time_ns: int, size: int) -> bytes:
    """Everything of a message record that stands before its data of `size` bytes."""
    return struct.pack("<BQHIQQ", MESSAGE, 22 + size, channel_id, sequence & 0xFFFFFFFF, log_time_ns, publish_time_ns)


def chunk_head(start_ns: int, end_ns: int, size: int, crc: int) -> bytes:
    """Everything of an uncompressed chunk record that stands before its `size` bytes of messages."""
    return struct.pack("<BQQQQIIQ", CHUNK, 40 + size, start_ns, end_ns, size, crc, 0, size)


def compressed_chunk_head(start_ns: int, end_ns: int, size: int, crc: int, compression: str, stored: int) -> bytes:
    """The same where they are compressed to `stored` bytes; `crc` is of what was compressed."""
    name = string(compression)
    return struct.pack("<BQQQQI", CHUNK, 36 + len(name) + stored, start_ns, end_ns, size, crc) + name + struct.pack("<Q", stored)


def message_index(channel_id: int, entries: list[tuple[int, int]]) -> bytes:
    """Message index record of one channel in one chunk: log time [ns] and offset in the chunk of each message."""
    numbers = itertools.chain.from_iterable(sorted(entries))
    return packed_message_index(channel_id, struct.pack(f"<{2 * len(entries)}Q", *numbers))


def packed_message_index(channel_id: int, entries: bytes) -> bytes:
    """The same of entries that are packed and in order."""
    return struct.pack("<BQHI", MESSAGE_INDEX, 6 + len(entries), channel_id, len(entries)) + entries


def padding(size: int) -> bytes:
    """A padding record of `size` bytes, at least RECORD_HEAD."""
    return struct.pack("<BQ", PADDING, size - RECORD_HEAD) + bytes(size - RECORD_HEAD)


# --- parsing ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SchemaRecord:
    """A message type."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class ChannelRecord:
    """A topic."""

    id: int
    schema_id: int
    topic: str
    encoding: str


@dataclass(frozen=True)
class MessageRecord:
    """One message; `data` is a view into the bytes it was parsed from."""

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: memoryview


@dataclass(frozen=True)
class ChunkRecord:
    """A chunk; `records` is a view of its (possibly compressed) messages."""

    start_ns: int
    end_ns: int
    uncompressed_size: int
    crc: int
    compression: str
    records: memoryview


@dataclass(frozen=True)
class AttachmentRecord:
    """An attached file."""

    name: str
    media_type: str
    log_time_ns: int
    data: bytes


@dataclass(frozen=True)
class MetadataRecord:
    """Named strings."""

    name: str
    entries: dict[str, str]


class _Fields:
    """Reads fields one after the other, never past the end."""

    def __init__(self, body: memoryview, what: str) -> None:
        self._body = body
        self._at = 0
        self._what = what

    @property
    def left(self) -> int:
        return len(self._body) - self._at

    def numbers(self, layout: str) -> tuple[int, ...]:
        size = struct.calcsize(layout)
        return struct.unpack(layout, self.take(size))

    def take(self, size: int) -> memoryview:
        if size > self.left:
            raise ContainerError(f"{self._what} record ends early")
        self._at += size
        return self._body[self._at - size : self._at]

    def prefixed(self) -> memoryview:
        return self.take(self.numbers("<I")[0])

    def string(self) -> str:
        try:
            return str(self.prefixed(), "utf-8")
        except UnicodeDecodeError:
            raise ContainerError(f"{self._what} record holds a text that is not UTF-8") from None


def parse_schema(body: memoryview) -> SchemaRecord:
    """Body of a schema record."""
    fields = _Fields(body, "schema")
    (number,) = fields.numbers("<H")
    return SchemaRecord(number, fields.string(), fields.string(), bytes(fields.prefixed()))


def parse_channel(body: memoryview) -> ChannelRecord:
    """Body of a channel record."""
    fields = _Fields(body, "channel")
    number, schema_id = fields.numbers("<HH")
    return ChannelRecord(number, schema_id, fields.string(), fields.string())


def parse_message(body: memoryview) -> MessageRecord:
    """Body of a message record."""
    fields = _Fields(body, "message")
    channel_id, sequence, log_time, publish_time = fields.numbers("<HIQQ")
    return MessageRecord(channel_id, sequence, log_time, publish_time, body[22:])


def parse_chunk(body: memoryview) -> ChunkRecord:
    """Body of a chunk record."""
    fields = _Fields(body, "chunk")
    start, end, size, crc = fields.numbers("<QQQI")
    compression = fields.string()
    return ChunkRecord(start, end, size, crc, compression, fields.take(fields.numbers("<Q")[0]))


def parse_attachment(body: memoryview) -> AttachmentRecord:
    """Body of an attachment record; its CRC is checked."""
    fields = _Fields(body, "attachment")
    log_time, _ = fields.numbers("<QQ")
    name, media_type = fields.string(), fields.string()
    data = bytes(fields.take(fields.numbers("<Q")[0]))
    (crc,) = fields.numbers("<I")
    if crc and crc != zlib.crc32(body[:-4]):
        raise ContainerError(f"attachment {name!r} is damaged")
    return AttachmentRecord(name, media_type, log_time, data)


def parse_metadata(body: memoryview) -> MetadataRecord:
    """Body of a metadata record."""
    fields = _Fields(body, "metadata")
    name = fields.string()
    entries = _Fields(fields.prefixed(), "metadata")
    result: dict[str, str] = {}
    while entries.left:
        key = entries.string()
        result[key] = entries.string()
    return MetadataRecord(name, result)


def parse_header(body: memoryview) -> tuple[str, str]:
    """Body of a header record: profile and library."""
    fields = _Fields(body, "header")
    return fields.string(), fields.string()


def parse_message_index(body: memoryview) -> tuple[int, list[tuple[int, int]]]:
    """Body of a message index record: its channel, and log time [ns] and offset in the chunk of each message."""
    fields = _Fields(body, "message index")
    channel_id, size = fields.numbers("<HI")
    entries = fields.take(size)
    if size % 16:
        raise ContainerError("message index record holds half an entry")
    return channel_id, list(struct.iter_unpack("<QQ", entries))


def walk(data: memoryview, start: int = 0) -> Iterator[tuple[int, int, memoryview]]:
    """Whole records from `start` on: (opcode, offset of the record, body). Ends at the first record that is not all there."""
    at = start
    while at + RECORD_HEAD <= len(data):
        opcode, size = struct.unpack_from("<BQ", data, at)
        if opcode == 0 or size > len(data) - at - RECORD_HEAD:
            return
        yield opcode, at, data[at + RECORD_HEAD : at + RECORD_HEAD + size]
        at += RECORD_HEAD + size


def chunk_messages(chunk: ChunkRecord) -> memoryview:
    """The chunk's message records, decompressed where needed; size and CRC are checked.

    Raises:
        ContainerError: damaged, or compressed in a way that is not known.
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
    if chunk.uncompressed_size > max(1 << 24, 1000 * len(chunk.records)):
        raise ContainerError("chunk claims an impossible size")
    if chunk.compression == "lz4":
        import lz4.frame  # comes with mcap

        try:
            return memoryview(lz4.frame.decompress(chunk.records))
        except RuntimeError as error:
            raise ContainerError(f"chunk cannot be decompressed: {error}") from None
    if chunk.compression == "zstd":
        import zstandard  # comes with mcap

        try:
            return memoryview(zstandard.ZstdDecompressor().decompress(chunk.records, max_output_size=chunk.uncompressed_size))
        except zstandard.ZstdError as error:
            raise ContainerError(f"chunk cannot be decompressed: {error}") from None
    raise ContainerError(f"chunk compression {chunk.compression!r} is not known")


# --- identity -----------------------------------------------------------------------------------------------------


_TIME_AND_SIZE: Final = struct.Struct("<QQ")
_TIME_SIZE_CRC: Final = struct.Struct("<QQI")


class ContentHash:
    """The `content_id` of schemas/README.md: BLAKE2b over every message outside /truth/, per topic, in file order."""

    def __init__(self) -> None:
        self._topics: dict[str, hashlib.blake2b] = {}

    def add(self, topic: str, log_time_ns: int, size: int, data: Buffer, crc: int | None = None) -> None:
        """Take in one message. Of a large one `crc` (of its data) may be given instead of the data, which then may be empty."""
        self.add_all(topic, [(log_time_ns, size, data, crc)])

    def add_all(self, topic: str, messages: Iterable[tuple[int, int, Buffer, int | None]]) -> None:
        """The same for several of a topic, in order: log time, size, data, CRC-32."""
        if topic.startswith(TRUTH_PREFIX):
            return
        digest = self._topics.get(topic)
        if digest is None:
            digest = self._topics[topic] = hashlib.blake2b(digest_size=32)
        parts: list[Buffer] = []
        for log_time_ns, size, data, crc in messages:
            if size < LARGE_MESSAGE:
                parts += (_TIME_AND_SIZE.pack(log_time_ns, size), data)
            else:
                parts.append(_TIME_SIZE_CRC.pack(log_time_ns, size, zlib.crc32(data) if crc is None else crc))
        digest.update(b"".join(parts))

    def hexdigest(self) -> str:
        """Identity of what was taken in so far."""
        digest = hashlib.blake2b(digest_size=32)
        for topic in sorted(self._topics):
            digest.update(string(topic) + self._topics[topic].digest())
        return digest.hexdigest()
