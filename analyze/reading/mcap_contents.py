"""What any MCAP file holds, whoever wrote it: topics and their times, encodings, compression, and how whole it is.

Source: the MCAP format specification (https://mcap.dev/spec). Schemas, channels, chunks and indexes are looked for where they stand, so
that a file needs no summary and no end. A chunk is unpacked only where no message index says what it holds.
"""

from __future__ import annotations

import contextlib
import struct
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analyze.reading.indexed_file import mapped
from schemas.mcap import records as container
from schemas.mcap.records import ChannelRecord, ChunkRecord, ContainerError, MessageRecord, SchemaRecord

Progress = Callable[[int, int], None]


@dataclass
class Compression:
    """The chunks that are packed in one way."""

    chunks: int = 0
    stored_bytes: int = 0
    unpacked_bytes: int = 0


@dataclass
class McapContents:
    """One file. Times are log times [ns], in the file's order."""

    path: Path
    size: int
    profile: str = ""
    library: str = ""
    schemas: dict[int, SchemaRecord] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    attachments: dict[str, int] = field(default_factory=dict)
    """bytes by name"""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    compression: dict[str, Compression] = field(default_factory=dict)
    finished: bool = False
    """it ends as a finished file does"""
    indexed: bool = False
    """it ends with a summary that leads to every chunk"""
    stated_messages: int | None = None
    """what the summary's statistics count"""
    unread_bytes: int = 0
    """behind the last whole record, before the end"""
    damage: list[str] = field(default_factory=list)
    delays_ns: list[int] = field(default_factory=list)
    """log time less publish time, of messages that were looked at: those of the first chunk at least"""
    _times: dict[int, list[NDArray[np.uint64]]] = field(default_factory=dict)

    def topics(self) -> tuple[str, ...]:
        """In the order of their channels."""
        return tuple(dict.fromkeys(channel.topic for channel in self.channels.values()))

    def channels_of(self, topic: str) -> list[ChannelRecord]:
        """A topic has one per publisher, in some files."""
        return [channel for channel in self.channels.values() if channel.topic == topic]

    def times(self, topic: str) -> NDArray[np.int64]:
        """(n,) log times; channel by channel where the topic has several."""
        found = [part for channel in self.channels_of(topic) for part in self._times.get(channel.id, [])]
        return np.concatenate(found).astype(np.int64) if found else np.empty(0, dtype=np.int64)

    @property
    def messages(self) -> int:
        """Those that were found, of channels that are described or not."""
        return sum(len(part) for parts in self._times.values() for part in parts)

    @property
    def nameless(self) -> int:
        """Messages of channels that the file does not describe."""
        return sum(len(part) for number, parts in self._times.items() if number not in self.channels for part in parts)

    def add(self, channel_id: int, times: NDArray[np.uint64]) -> None:
        """Take in a channel's messages."""
        self._times.setdefault(channel_id, []).append(times)


def read_contents(path: Path, progress: Progress | None = None) -> McapContents:
    """Walk a file from its beginning, as far as it goes.

    Args:
        path: the file.
        progress: called with bytes walked and bytes in all.

    Raises:
        RecordingError: it is missing, empty, or not MCAP.
    """
    data = mapped(path)
    try:
        contents = McapContents(path, len(data))
        _Walk(contents, data, progress or (lambda _done, _total: None)).run()
        return contents
    finally:
        data.release()


class _Walk:
    def __init__(self, contents: McapContents, data: memoryview, progress: Progress) -> None:
        self._found, self._data, self._progress = contents, data, progress
        self._chunk: ChunkRecord | None = None
        self._indexes: dict[int, list[tuple[int, int]]] = {}
        """log time and offset of the chunk's messages, by channel"""
        self._chunks: list[int] = []
        self._loose: dict[int, list[int]] = {}
        """times of messages that stand in no chunk, by channel"""

    def run(self) -> None:
        found, data, magic = self._found, self._data, container.MAGIC
        at, ended = len(magic), False
        for opcode, start, body in container.walk(data, len(magic)):
            at = start + container.RECORD_HEAD + len(body)
            try:
                self._take(opcode, start, body)
            except (ContainerError, struct.error, ValueError) as error:
                found.damage.append(str(error))
            if opcode == container.FOOTER:
                ended = True
                break
        found.finished = ended and bytes(data[at : at + len(magic)]) == magic
        found.unread_bytes = 0 if found.finished else len(data) - at
        # Its indexes may not have been written any more.
        self._close_chunk(trust=found.finished)
        for channel_id, times in self._loose.items():
            found.add(channel_id, np.array(times, dtype=np.uint64))
        self._look_into_chunks()

    def _take(self, opcode: int, start: int, body: memoryview) -> None:
        found = self._found
        if opcode == container.MESSAGE_INDEX:
            channel_id, entries = container.parse_message_index(body)
            self._indexes[channel_id] = entries
            return
        self._close_chunk(trust=True)
        if opcode == container.MESSAGE:
            message = container.parse_message(body)
            self._loose.setdefault(message.channel_id, []).append(message.log_time_ns)
            found.delays_ns.append(message.log_time_ns - message.publish_time_ns)
        elif opcode == container.CHUNK:
            self._progress(start, len(self._data))
            self._chunk = chunk = container.parse_chunk(body)
            self._chunks.append(start)
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
        if opcode == container.SCHEMA:
            schema = container.parse_schema(body)
            self._found.schemas[schema.id] = schema
        elif opcode == container.CHANNEL:
            channel = container.parse_channel(body)
            self._found.channels[channel.id] = channel

    def _close_chunk(self, *, trust: bool) -> None:
        """Count the last chunk's messages: by its indexes where they are to be trusted, otherwise by the messages."""
        chunk, indexes = self._chunk, self._indexes
        self._chunk, self._indexes = None, {}
        if chunk is None:
            return
        if indexes and trust:
            for channel_id, entries in indexes.items():
                self._found.add(channel_id, np.array([time for time, _ in sorted(entries, key=lambda entry: entry[1])], dtype=np.uint64))
            return
        try:
            self._count(container.chunk_messages(chunk))
        except ContainerError as error:
            self._found.damage.append(str(error))

    def _count(self, records: memoryview) -> None:
        times: dict[int, list[int]] = {}
        for message in self._unpacked(records):
            times.setdefault(message.channel_id, []).append(message.log_time_ns)
        for channel_id, found in times.items():
            self._found.add(channel_id, np.array(found, dtype=np.uint64))

    def _unpacked(self, records: memoryview) -> Iterator[MessageRecord]:
        """A chunk's messages; what describes their channels is taken in on the way."""
        for opcode, _, body in container.walk(records):
            if opcode == container.MESSAGE:
                message = container.parse_message(body)
                self._found.delays_ns.append(message.log_time_ns - message.publish_time_ns)
                yield message
            else:
                self._describe(opcode, body)

    def _look_into_chunks(self) -> None:
        """Of the first chunk the publish times; of others what describes channels that no summary repeats."""
        for start in self._chunks:
            if self._found.delays_ns and not self._found.nameless:
                return
            (size,) = struct.unpack_from("<Q", self._data, start + 1)
            body = self._data[start + container.RECORD_HEAD : start + container.RECORD_HEAD + size]
            with contextlib.suppress(ContainerError):
                deque(self._unpacked(container.chunk_messages(container.parse_chunk(body))), maxlen=0)
