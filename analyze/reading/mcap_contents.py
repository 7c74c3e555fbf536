"""Inspects MCAP files of any program: topics and their times, encodings, compression, damage.

Source: the MCAP format specification (https://mcap.dev/spec). Schemas, channels, chunks and indexes are taken
from the data section, so that the file needs no summary and no end. A chunk is decompressed only for what
indexes do not give: times if its message indexes are missing or may be incomplete, publish times, and
channels that are not known yet.
"""

from __future__ import annotations

import contextlib
import struct
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analyze.progress import Progress, no_progress
from analyze.reading.indexed_file import map_recording
from schemas.mcap import records as container
from schemas.mcap.chunks import chunk_messages
from schemas.mcap.records import ChannelRecord, ChunkRecord, ContainerError, MessageRecord, SchemaRecord
from schemas.mcap.walk import record_at, walk


@dataclass
class Compression:
    """Number and size of the chunks with one kind of compression."""

    chunks: int = 0
    """number of chunks"""
    stored_bytes: int = 0
    """size of the chunks' records as stored, compressed [bytes]"""
    unpacked_bytes: int = 0
    """size of the chunks' records when decompressed, as the chunks state it [bytes]"""


@dataclass
class McapContents:
    """Contents of one MCAP file, up to its last whole record: channels, attached files, metadata, damage.

    Of the messages it keeps only the times, by topic.
    """

    path: Path
    """path of the file"""
    size: int
    """size of the file [bytes]"""
    profile: str = ""
    """MCAP profile that the file's header states, such as "ros2"; often empty"""
    library: str = ""
    """program that wrote the file, by its header"""
    schemas: dict[int, SchemaRecord] = field(default_factory=dict)
    """message types by id"""
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    """channels (topic, type, encoding) by id"""
    attachments: dict[str, int] = field(default_factory=dict)
    """size of each attached file [bytes], by its name"""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    """entries of each metadata record, by its name"""
    compression: dict[str, Compression] = field(default_factory=dict)
    """chunks by kind of compression; "none" if uncompressed"""
    finished: bool = False
    """True if the file ends with a footer and the closing magic bytes"""
    indexed: bool = False
    """True if the file's summary lists the chunks"""
    stated_messages: int | None = None
    """number of messages by the summary's statistics, None if there are none"""
    unread_bytes: int = 0
    """bytes after the last whole record; 0 for a finished file"""
    damage: list[str] = field(default_factory=list)
    """descriptions of the damage found"""
    delays_ns: list[int] = field(default_factory=list)
    """log time minus publish time [ns] of the messages that were parsed: at least those of one chunk, or of
    all messages outside of chunks"""
    _times: dict[int, list[NDArray[np.uint64]]] = field(default_factory=dict)

    def topics(self) -> tuple[str, ...]:
        """Names of all topics, in the order of their channels, each once."""
        return tuple(dict.fromkeys(channel.topic for channel in self.channels.values()))

    def channels_of(self, topic: str) -> list[ChannelRecord]:
        """Channels of a topic; some files have one for each publisher. Empty for an unknown topic."""
        return [channel for channel in self.channels.values() if channel.topic == topic]

    def times(self, topic: str) -> NDArray[np.int64]:
        """Log times (n,) int64 of a topic's messages [ns], in file order within each of its channels."""
        found = [part for channel in self.channels_of(topic) for part in self._times.get(channel.id, [])]
        return np.concatenate(found).astype(np.int64) if found else np.empty(0, dtype=np.int64)

    @property
    def messages(self) -> int:
        """Number of messages found in the file, including those on channels that it does not describe."""
        return sum(len(part) for parts in self._times.values() for part in parts)

    @property
    def undescribed_messages(self) -> int:
        """Number of messages on channels that the file does not describe."""
        return sum(
            len(part)
            for number, parts in self._times.items()
            if number not in self.channels
            for part in parts
        )

    def add(self, channel_id: int, times: NDArray[np.uint64]) -> None:
        """Add the log times (n,) [ns] of further messages of a channel."""
        self._times.setdefault(channel_id, []).append(times)


def read_contents(path: Path, progress: Progress | None = None) -> McapContents:
    """Inspect an MCAP file from its beginning up to the last whole record.

    Args:
        path: the file.
        progress: called with (text, bytes read, bytes in all); None for no reports.

    Returns:
        Topics with log times [ns] and message types, attachments, metadata, compression, and descriptions
        of any damage, which is no error.

    Raises:
        RecordingError: the file is missing, cannot be read, is empty, or is not MCAP.
    """
    data = map_recording(path)
    try:
        contents = McapContents(path, len(data))
        _Inspection(contents, data, progress or no_progress).run()
        return contents
    finally:
        data.release()


class _Inspection:
    """One pass over an MCAP file, which enters what it finds in a `McapContents`.

    Args:
        contents: receives all findings.
        data: bytes of the whole file.
        progress: called with (text, bytes read, bytes in all).
    """

    def __init__(self, contents: McapContents, data: memoryview, progress: Progress) -> None:
        self._found, self._data, self._progress = contents, data, progress
        self._chunk: ChunkRecord | None = None
        self._indexes: dict[int, list[tuple[int, int]]] = {}
        """log time and offset of the present chunk's messages, by channel"""
        self._chunk_offsets: list[int] = []
        self._loose_times: dict[int, list[int]] = {}
        """log times of messages outside of chunks, by channel"""

    def run(self) -> None:
        """Inspect the MCAP file up to its footer or its last whole record.

        All findings are entered in the `McapContents` that the constructor was given.
        """
        found, data, magic = self._found, self._data, container.MAGIC
        at, ended = len(magic), False
        for opcode, start, body in walk(data, len(magic)):
            at = start + container.RECORD_HEAD + len(body)
            try:
                self._add_record(opcode, start, body)
            except (ContainerError, struct.error, ValueError) as error:
                found.damage.append(str(error))
            if opcode == container.FOOTER:
                ended = True
                break
        found.finished = ended and bytes(data[at : at + len(magic)]) == magic
        found.unread_bytes = 0 if found.finished else len(data) - at
        # In a cut file the last chunk's indexes may be incomplete.
        self._close_chunk(trust_indexes=found.finished)
        for channel_id, times in self._loose_times.items():
            found.add(channel_id, np.array(times, dtype=np.uint64))
        self._describe_channels()

    def _add_record(self, opcode: int, start: int, body: memoryview) -> None:
        found = self._found
        if opcode == container.MESSAGE_INDEX:
            channel_id, entries = container.parse_message_index(body)
            self._indexes[channel_id] = entries
            return
        self._close_chunk(trust_indexes=True)
        if opcode == container.MESSAGE:
            message = container.parse_message(body)
            self._loose_times.setdefault(message.channel_id, []).append(message.log_time_ns)
            found.delays_ns.append(message.log_time_ns - message.publish_time_ns)
        elif opcode == container.CHUNK:
            self._progress("reading", start, len(self._data))
            self._chunk = chunk = container.parse_chunk(body)
            self._chunk_offsets.append(start)
            packed = found.compression.setdefault(chunk.compression or "none", Compression())
            packed.chunks += 1
            packed.stored_bytes += len(chunk.records)
            packed.unpacked_bytes += chunk.uncompressed_size
        elif opcode == container.HEADER:
            found.profile, found.library = container.parse_header(body)
        elif opcode == container.ATTACHMENT:
            attachment = container.parse_attachment(body)
            found.attachments[attachment.name] = len(attachment.data)
        elif opcode == container.METADATA:
            metadata = container.parse_metadata(body)
            found.metadata[metadata.name] = metadata.entries
        elif opcode == container.STATISTICS:
            (found.stated_messages,) = struct.unpack_from("<Q", body)
        elif opcode == container.CHUNK_INDEX:
            found.indexed = True
        else:
            self._describe(opcode, body)

    def _describe(self, opcode: int, body: memoryview) -> None:
        """Enter a schema or channel record in the contents; records of other kinds are ignored.

        Args:
            opcode: kind of the record in MCAP.
            body: content of the record.

        Raises:
            ContainerError: the record is damaged.
        """
        if opcode == container.SCHEMA:
            schema = container.parse_schema(body)
            self._found.schemas[schema.id] = schema
        elif opcode == container.CHANNEL:
            channel = container.parse_channel(body)
            self._found.channels[channel.id] = channel

    def _close_chunk(self, *, trust_indexes: bool) -> None:
        """Enter the log times of the chunk that was read last in the contents; without one do nothing.

        They are taken from the chunk's message indexes, or from its messages if it has none. Damage of the
        chunk is described in the contents.

        Args:
            trust_indexes: False to read the messages even if there are message indexes.
        """
        chunk, indexes = self._chunk, self._indexes
        self._chunk, self._indexes = None, {}
        if chunk is None:
            return
        if indexes and trust_indexes:
            for channel_id, entries in indexes.items():
                in_file_order = sorted(entries, key=lambda entry: entry[1])
                self._found.add(channel_id, np.array([time for time, _ in in_file_order], dtype=np.uint64))
            return
        try:
            self._count(chunk_messages(chunk))
        except ContainerError as error:
            self._found.damage.append(str(error))

    def _count(self, records: memoryview) -> None:
        times: dict[int, list[int]] = {}
        for message in self._parsed_messages(records):
            times.setdefault(message.channel_id, []).append(message.log_time_ns)
        for channel_id, found in times.items():
            self._found.add(channel_id, np.array(found, dtype=np.uint64))

    def _parsed_messages(self, records: memoryview) -> Iterator[MessageRecord]:
        """Yield the messages among a chunk's `records`, and enter what else is found in the contents.

        That is: schemas, channels, and the messages' delays (log time minus publish time [ns]).

        Raises:
            ContainerError: a record is damaged.
        """
        for opcode, _, body in walk(records):
            if opcode == container.MESSAGE:
                message = container.parse_message(body)
                self._found.delays_ns.append(message.log_time_ns - message.publish_time_ns)
                yield message
            else:
                self._describe(opcode, body)

    def _describe_channels(self) -> None:
        """Read chunks again if channels were not described, or if no message's delay is known.

        A delay is log time minus publish time; that of one message is enough. The reading ends once a delay
        is known and all channels with messages are described, or after the last chunk. Damaged chunks are
        passed over.
        """
        for start in self._chunk_offsets:
            if self._found.delays_ns and not self._found.undescribed_messages:
                return
            body = record_at(self._data, start, container.CHUNK)
            with contextlib.suppress(ContainerError):
                deque(self._parsed_messages(chunk_messages(container.parse_chunk(body))), maxlen=0)
