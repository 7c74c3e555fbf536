"""Copies a recording's file with its raw images in another coding; all else stays as it is, in its order."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass, field

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from analyze.compact.images import COMPRESSED, RAW, Coding, recode
from schemas.compaction import COMPACTED_NAME
from schemas.mcap import records as container
from schemas.mcap.chunks import PendingMessages, chunk_messages
from schemas.mcap.content_hash import ContentHash
from schemas.mcap.record_writer import RecordWriter, pack_topic
from schemas.mcap.records import Buffer, ChannelRecord, ContainerError, MessageRecord, MetadataRecord
from schemas.mcap.summary import DATA_END_SIZE, Summary, find_summary
from schemas.mcap.walk import walk, walk_messages
from schemas.session_manifest import SEAL_NAME
from schemas.topics import Topic

CodingOf = Callable[[str, int], Coding]
"""coding of the image of a topic with a log time [ns]"""
_LEFT_OUT = {container.HEADER, container.MESSAGE_INDEX, container.PADDING}
"""kinds of records that a copy has of its own"""
Tick = Callable[[int], None]
"""called with the number of bytes of the source that are done"""


@dataclass
class Copied:
    """Copy of a file that can be given its last records anew."""

    writer: RecordWriter
    fd: int
    content_id: str
    """hash of the copy's messages"""
    tail_offset: int
    """offset of the records that follow the last message"""
    summary: Summary
    """the summary as it was there"""
    metadata: list[tuple[str, dict[str, str]]]
    """metadata records that follow the last message, without the seal"""
    seal: dict[str, str]
    """entries of the source's seal; empty if it has none"""
    recoded_images: int
    """number of images in another coding"""

    def finish(self, entries: dict[str, str]) -> None:
        """Write what follows the messages, with this metadata on the coding, to the end of the file; again.

        Raises:
            OSError: the file cannot be written.
        """
        os.ftruncate(self.fd, self.tail_offset)
        os.lseek(self.fd, self.tail_offset, os.SEEK_SET)
        self.writer.size, self.writer.summary = self.tail_offset, deepcopy(self.summary)
        for name, values in self.metadata:
            self.writer.write_metadata(name, values)
        self.writer.write_metadata(COMPACTED_NAME, entries)
        if self.seal:
            self.writer.write_metadata(SEAL_NAME, self.seal | {"content_id": self.content_id})
        self.writer.end()
        os.fsync(self.fd)


@dataclass
class _Copy:
    """State of a copy while the source's records are walked."""

    writer: RecordWriter
    coding_of: CodingOf
    schemas: dict[int, tuple[str, bytes]] = field(default_factory=dict[int, tuple[str, bytes]])
    """name and whole record of each schema"""
    declared: set[int] = field(default_factory=set[int])
    """schemas that are written"""
    topics: dict[int, str] = field(default_factory=dict[int, str])
    """topic of each channel"""
    images_of: dict[int, str] = field(default_factory=dict[int, str])
    """type of the messages of each channel of images"""
    digest: ContentHash = field(default_factory=ContentHash)
    recoded_images: int = 0
    tail: list[tuple[str, dict[str, str]]] = field(default_factory=list[tuple[str, dict[str, str]]])
    """metadata that follow the first message"""
    seal: dict[str, str] = field(default_factory=dict[str, str])
    has_messages: bool = False

    def metadata(self, record: MetadataRecord) -> None:
        """Write metadata, or keep what follows messages for the end; that on a coding is made anew."""
        if record.name == SEAL_NAME:
            self.seal = record.entries
        elif record.name != COMPACTED_NAME:
            if self.has_messages:
                self.tail.append((record.name, record.entries))
            else:
                self.writer.write_metadata(record.name, record.entries)

    def channel(self, channel: ChannelRecord, whole: bytes) -> None:
        """Declare a channel, with the schema that its messages will have."""
        name, schema = self.schemas.get(channel.schema_id, ("", b""))
        self.topics[channel.id] = channel.topic
        if name in {RAW, COMPRESSED}:
            self.images_of[channel.id] = name
        if name == RAW:
            if channel.id != channel.schema_id and channel.id in self.schemas:
                raise ContainerError(f"channel {channel.id} has the number of another schema")
            schema, whole = pack_topic(Topic(channel.topic, CompressedImage), channel.id)
        if schema and (name == RAW or channel.schema_id not in self.declared):
            self.declared.add(channel.schema_id)
            self.writer.copy_declaration(schema)
        self.writer.copy_declaration(whole)

    def chunk(self, records: memoryview) -> None:
        """Write the messages of a chunk, images in their new coding."""
        self.has_messages = True
        pending = PendingMessages()
        for _, message in walk_messages(records):
            data = self._data(message)
            topic = self.topics[message.channel_id]
            self.digest.add(topic, message.log_time_ns, len(data), data)
            pending.add(
                message.channel_id, message.sequence, message.log_time_ns, message.publish_time_ns, data
            )
        if pending.places:
            self.writer.write_pending(pending)

    def _data(self, message: MessageRecord) -> Buffer:
        topic = self.topics.get(message.channel_id)
        if topic is None:
            raise ContainerError(f"a message is on channel {message.channel_id}, which is not described")
        schema = self.images_of.get(message.channel_id)
        if schema is None:
            return message.data
        recoded = recode(schema, message.data, self.coding_of(topic, message.log_time_ns))
        if recoded is None:
            return message.data
        self.recoded_images += 1
        return recoded


def copy_recoded(data: memoryview, fd: int, coding_of: CodingOf, tick: Tick) -> Copied:
    """Write a copy of a finished file, up to its last message; `Copied.finish` writes the rest.

    Args:
        data: bytes of the source.
        fd: file to write to, empty.
        coding_of: coding of each raw image.
        tick: called with the number of bytes of the source that are done.

    Raises:
        ContainerError: the source is damaged.
        OSError: the copy cannot be written.
    """
    writer = RecordWriter(lambda buffers: _write_all(fd, buffers))
    copy = _Copy(writer, coding_of)
    writer.begin()
    for opcode, at, body in _records(data):
        whole = data[at : at + container.RECORD_HEAD + len(body)]
        if opcode == container.METADATA:
            copy.metadata(container.parse_metadata(body))
        elif opcode == container.ATTACHMENT:
            writer.copy_attachment(whole, container.parse_attachment(body))
        elif opcode == container.SCHEMA:
            schema = container.parse_schema(body)
            copy.schemas[schema.id] = schema.name, bytes(whole)
        elif opcode == container.CHANNEL:
            copy.channel(container.parse_channel(body), bytes(whole))
        elif opcode == container.CHUNK:
            copy.chunk(chunk_messages(container.parse_chunk(body)))
        elif opcode not in _LEFT_OUT:
            raise ContainerError(f"a record of kind {opcode} at byte {at} is none of a recording's")
        tick(at)
    content_id, summary = copy.digest.hexdigest(), deepcopy(writer.summary)
    return Copied(writer, fd, content_id, writer.size, summary, copy.tail, copy.seal, copy.recoded_images)


def stored_messages(data: memoryview) -> Iterator[tuple[str, MessageRecord]]:
    """Topic and message, one after the other, of a finished file.

    Raises:
        ContainerError: the file is damaged.
    """
    topics: dict[int, str] = {}
    for opcode, _, body in _records(data):
        if opcode == container.CHANNEL:
            channel = container.parse_channel(body)
            topics[channel.id] = channel.topic
        elif opcode == container.CHUNK:
            for _, message in walk_messages(chunk_messages(container.parse_chunk(body))):
                yield topics.get(message.channel_id, ""), message


def _records(data: memoryview) -> Iterator[tuple[int, int, memoryview]]:
    """Records of a finished file's data section.

    Raises:
        ContainerError: it ends early.
    """
    end = find_summary(data).start - DATA_END_SIZE
    read = len(container.MAGIC)
    for opcode, at, body in walk(data[:end], read):
        yield opcode, at, body
        read = at + container.RECORD_HEAD + len(body)
    if read != end:
        raise ContainerError(f"the record at byte {read} is not whole")


def _write_all(fd: int, buffers: Sequence[Buffer]) -> None:
    """Write all bytes of the buffers to a file."""
    for buffer in buffers:
        view = memoryview(buffer)
        while view:
            view = view[os.write(fd, view) :]
