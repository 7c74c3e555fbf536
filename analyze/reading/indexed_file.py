"""Maps a recording file into memory and indexes its messages; their data are views, not copies.

A finished file is opened by the summary at its end. A file that ends early is walked from its start
(`open_cut`), and damaged records are left out. A chunk's checksum (CRC) is verified when it is first read.
Damaged bytes raise RecordingError, but ContainerError in `IndexedFile.chunk_messages`.
"""

from __future__ import annotations

import contextlib
import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analyze.errors import RecordingCut, RecordingError, RecordingForeign
from analyze.reading.index_check import check_entries
from analyze.reading.not_a_recording import not_a_recording
from schemas.input_file import open_file
from schemas.mcap import records as container
from schemas.mcap.chunks import chunk_messages, parse_chunk_offsets
from schemas.mcap.records import AttachmentRecord, ChannelRecord, ContainerError, MessageRecord
from schemas.mcap.summary import EndsEarly, find_summary, parse_message_counts
from schemas.mcap.walk import index_entries_at, record_at, walk, walk_messages


@dataclass(frozen=True)
class RecordedMessage:
    """One message of a recording, not parsed, with topic, log time [ns] and sequence number."""

    topic: str
    """name of the topic"""
    log_time_ns: int
    """log time [ns]"""
    sequence: int
    """sequence number on the topic"""
    data: memoryview
    """encoded message, a view that stays valid"""


@dataclass(frozen=True)
class TopicIndex:
    """Log times [ns] of a topic's messages, and the place of each in a file: chunk and offset in it.

    The messages are in order of log time; those of equal time keep the file's order.
    """

    time_ns: NDArray[np.int64]
    """(n,) log times [ns]"""
    chunk: NDArray[np.int64]
    """(n,) number of the chunk in the file"""
    offset: NDArray[np.int64]
    """(n,) offset among the chunk's messages [bytes]"""


class _ChunkPlace(NamedTuple):
    """Position of a chunk and of its message indexes, as offsets in the file [bytes]."""

    offset: int
    """offset of the chunk record"""
    index_offsets: dict[int, int] | None
    """offset of the message index record by channel id; None if unknown: the chunk itself is read"""


@dataclass
class IndexedFile:
    """A memory-mapped recording file with its index; views of its bytes stay valid after `close`."""

    path: Path
    """path of the file"""
    data: memoryview
    """bytes of the file"""
    schemas: dict[int, str] = field(default_factory=dict)
    """names of the message types by schema id"""
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    """channels (topic, type, encoding) by id"""
    chunks: list[_ChunkPlace] = field(default_factory=list)
    """offsets of the chunks and of their message indexes, in the order in which they were found"""
    attachments: dict[str, AttachmentRecord] = field(default_factory=dict)
    """attached files by name"""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    """entries of each metadata record, by its name"""
    message_counts: dict[int, int] = field(default_factory=dict)
    """number of messages by channel id, from the summary; empty if it states none"""
    damaged_chunks: int = 0
    """number of damaged records, mostly chunks, left out of a file opened by `open_cut`"""
    _indexes: dict[str, TopicIndex] = field(default_factory=dict)
    _checked_chunks: dict[int, memoryview] = field(default_factory=dict)

    def release_memory(self) -> None:
        """Return cached pages of the file to the system; views read them again when they are used."""
        if isinstance(self.data.obj, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            self.data.obj.madvise(mmap.MADV_DONTNEED)

    def close(self) -> None:
        """Unmap the file; while views of it are in use it stays mapped."""
        self._checked_chunks.clear()
        self._indexes.clear()
        mapping = self.data.obj
        with contextlib.suppress(BufferError):
            self.data.release()
            if isinstance(mapping, mmap.mmap):
                mapping.close()

    def topic_names(self) -> tuple[str, ...]:
        """Names of all topics, in the order of their channels, each once."""
        return tuple(dict.fromkeys(channel.topic for channel in self.channels.values()))

    def schema_of(self, topic: str) -> str:
        """Full name of the topic's message type, "" if unknown."""
        channels = (channel for channel in self.channels.values() if channel.topic == topic)
        return next((self.schemas.get(channel.schema_id, "") for channel in channels), "")

    def index(self, topic: str) -> TopicIndex:
        """Positions of the topic's messages, read from the file once and kept; empty for an unknown topic.

        Raises:
            RecordingError: the file is damaged.
        """
        if topic not in self._indexes:
            ids = {channel.id for channel in self.channels.values() if channel.topic == topic}
            with self.damage_as_error():
                self._indexes[topic] = self._read_index(ids)
        return self._indexes[topic]

    def message(self, index: TopicIndex, number: int) -> MessageRecord:
        """One message of a topic; its data are a view of the file or of the decompressed chunk.

        Args:
            index: positions of the topic's messages, from `index`.
            number: number of the message in `index`, from 0.

        Raises:
            RecordingError: the file is damaged.
        """
        with self.damage_as_error():
            messages = self.chunk_messages(int(index.chunk[number]))
            at = int(index.offset[number])
            message = container.parse_message(record_at(messages, at, container.MESSAGE))
            if message.log_time_ns != index.time_ns[number]:
                raise ContainerError("a message index states another time than its message")
            return message

    def chunk_messages(self, number: int) -> memoryview:
        """Bytes of the records in one chunk, decompressed if needed; its checksum (CRC) is verified first.

        The bytes are kept for further calls; of compressed chunks only those of the latest.

        Args:
            number: number of the chunk in the file.

        Raises:
            ContainerError: the chunk is damaged.
        """
        messages = self._checked_chunks.get(number)
        if messages is not None:
            return messages
        chunk = container.parse_chunk(record_at(self.data, self.chunks[number].offset, container.CHUNK))
        messages = chunk_messages(chunk)
        if chunk.compression:
            # Decompressed chunks cost memory, views of the file do not: only the latest is kept.
            kept = self._checked_chunks.items()
            self._checked_chunks = {other: view for other, view in kept if view.obj is self.data.obj}
        self._checked_chunks[number] = messages
        return messages

    def release_chunk(self, number: int) -> None:
        """Drop the kept bytes of chunk `number`; its checksum is verified again when it is next read."""
        self._checked_chunks.pop(number, None)

    @contextlib.contextmanager
    def damage_as_error(self) -> Iterator[None]:
        """Convert errors of damaged bytes within the `with` block to RecordingError.

        Raises:
            RecordingError: the block raised ContainerError or struct.error.
        """
        try:
            yield
        except (ContainerError, struct.error) as error:
            raise RecordingError(
                f"{self.path}: damaged: {error}: `acquire recover` saves what can be read"
            ) from None

    def _read_index(self, channel_ids: set[int]) -> TopicIndex:
        """Positions of the messages of some channels, checked against the messages.

        In a compressed chunk a message is checked when it is read.

        Raises:
            ContainerError: a chunk or a message index is damaged.
        """
        entries: list[NDArray[np.uint64]] = []
        chunks: list[NDArray[np.int64]] = []
        for number, chunk in enumerate(self.chunks):
            for channel_id in channel_ids:
                found = self._chunk_index(number, chunk.index_offsets, channel_id)
                if len(found):
                    entries.append(found)
                    chunks.append(np.full(len(found), number, dtype=np.int64))
        stated = sum(self.message_counts.get(number, 0) for number in channel_ids)
        if self.message_counts and stated != sum(map(len, entries)) and self._is_whole():
            raise ContainerError("the message indexes do not list as many messages as the summary")
        if not entries:
            return TopicIndex(*[np.empty(0, dtype=np.int64)] * 3)
        table = np.concatenate(entries).astype(np.int64)
        chunk_numbers = np.concatenate(chunks)
        self._check_index(chunk_numbers, table, channel_ids)
        order = np.lexsort((table[:, 1], chunk_numbers, table[:, 0]))
        return TopicIndex(table[order, 0], chunk_numbers[order], table[order, 1])

    def _is_whole(self) -> bool:
        """True unless it is a copy from which chunks were left out: empty ones stand in their places."""
        return all(len(record_at(self.data, chunk.offset, container.CHUNK)) for chunk in self.chunks)

    def _check_index(
        self, chunk_numbers: NDArray[np.int64], table: NDArray[np.int64], channel_ids: set[int]
    ) -> None:
        """Check entries of message indexes against the messages themselves, outside of compressed chunks.

        Args:
            chunk_numbers: (n,) numbers of the chunks.
            table: (n, 2) log time [ns] and offset in the chunk [bytes].
            channel_ids: channels of the topic.

        Raises:
            ContainerError: a chunk or an entry is damaged.
        """
        used, inverse = np.unique(chunk_numbers, return_inverse=True)
        extents = np.array([self._extent(int(number)) for number in used], dtype=np.int64)[inverse]
        plain = extents[:, 1] > 0
        check_entries(self.data, extents[plain], table[plain, 1], table[plain, 0], channel_ids)

    def _extent(self, number: int) -> tuple[int, int]:
        """Start and end in the file of a chunk's records [bytes]; (0, 0) if they are compressed.

        Raises:
            ContainerError: the chunk is damaged.
        """
        body = record_at(self.data, self.chunks[number].offset, container.CHUNK)
        chunk = container.parse_chunk(body)
        if chunk.compression:
            return 0, 0
        end = self.chunks[number].offset + container.RECORD_HEAD + len(body)
        return end - len(chunk.records), end

    def _chunk_index(
        self, number: int, index_offsets: dict[int, int] | None, channel_id: int
    ) -> NDArray[np.uint64]:
        """Log time [ns] and offset in the chunk [bytes] of one channel's messages in a chunk, (n, 2) uint64.

        Args:
            number: number of the chunk.
            index_offsets: file offset of the chunk's message index record by channel id; None to walk the
                chunk itself.
            channel_id: id of the channel; the result is empty if the chunk has none of its messages.

        Raises:
            ContainerError: the chunk or its message index is damaged.
        """
        if index_offsets is None:
            messages = walk_messages(self.chunk_messages(number))
            found = [
                (message.log_time_ns, at) for at, message in messages if message.channel_id == channel_id
            ]
            return np.array(found, dtype=np.uint64).reshape(-1, 2)
        at = index_offsets.get(channel_id)
        if at is None:
            return np.empty((0, 2), dtype=np.uint64)
        return np.frombuffer(index_entries_at(self.data, at, channel_id), "<u8").reshape(-1, 2)


def map_recording(path: Path) -> memoryview:
    """Map an MCAP file into memory, read-only; return a view of all its bytes.

    Raises:
        RecordingCut: the file is empty.
        RecordingForeign: the file does not begin like an MCAP file.
        RecordingError: the file is missing or cannot be read.
    """
    try:
        with open_file(path) as file:
            data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such recording: check the path") from None
    except ValueError:  # mmap of an empty file
        raise RecordingCut(
            f"{path}: is empty: nothing of this recording can be saved: record again"
        ) from None
    except IsADirectoryError:
        raise RecordingError(not_a_recording(path)) from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    magic = container.MAGIC
    if bytes(data[: len(magic)]) != magic:
        data.release()
        raise RecordingForeign(not_a_recording(path))
    return data


def open_finished(path: Path) -> IndexedFile:
    """Map a finished recording file and index it; return the indexed file.

    Only its summary, attachments and metadata are read.

    Raises:
        RecordingCut: the file ends early or is empty.
        RecordingError: the file is missing, cannot be read, is not MCAP (RecordingForeign), or is damaged.
    """
    file = IndexedFile(path, map_recording(path))
    try:
        with file.damage_as_error():
            for opcode, _, body in walk(_summary_records(file)):
                _add_record(file, opcode, body)
    except RecordingError:
        file.close()
        raise
    return file


def open_cut(path: Path) -> IndexedFile:
    """Map a recording file that may end anywhere and walk it from its start; return the indexed file.

    Damaged chunks and records are left out, and counted in `damaged_chunks`.

    Raises:
        RecordingError: the file is missing, cannot be read, is empty (RecordingCut) or not MCAP
            (RecordingForeign).
    """
    file = IndexedFile(path, map_recording(path))
    for opcode, at, body in walk(file.data, len(container.MAGIC)):
        if opcode == container.DATA_END:
            break
        try:
            if opcode == container.CHUNK:
                chunk_messages(container.parse_chunk(body))
                file.chunks.append(_ChunkPlace(at, None))
            else:
                _add_record(file, opcode, body)
        except ContainerError:
            file.damaged_chunks += 1
    return file


def _summary_records(file: IndexedFile) -> memoryview:
    try:
        return find_summary(file.data).records
    except EndsEarly:
        raise RecordingCut(
            f"{file.path}: ends early: it was cut short or is still being written: "
            f"`acquire recover {file.path} -o NEW.mcap`"
        ) from None


_INDEXED = {container.ATTACHMENT_INDEX: container.ATTACHMENT, container.METADATA_INDEX: container.METADATA}
"""kind of the record whose offset is at the start of an index record"""


def _add_record(file: IndexedFile, opcode: int, body: memoryview) -> None:
    """Enter one record of an MCAP file in `file`: a schema, channel, chunk, attachment or metadata.

    An index record of the summary stands for the record at which it points. A chunk is entered by its index
    record only: a chunk record itself is ignored, as are all other kinds.

    Args:
        file: indexed file, which is extended.
        opcode: kind of the record in MCAP.
        body: content of the record.

    Raises:
        ContainerError: the record is damaged, or an index points at another kind of record.
    """
    if opcode == container.SCHEMA:
        schema = container.parse_schema(body)
        file.schemas[schema.id] = schema.name
    elif opcode == container.CHANNEL:
        channel = container.parse_channel(body)
        file.channels[channel.id] = channel
    elif opcode == container.CHUNK_INDEX:
        offset, index_offsets = parse_chunk_offsets(body)
        record_at(file.data, offset, container.CHUNK)
        file.chunks.append(_ChunkPlace(offset, index_offsets))
    elif opcode == container.ATTACHMENT:
        attachment = container.parse_attachment(body)
        file.attachments[attachment.name] = attachment
    elif opcode == container.METADATA:
        metadata = container.parse_metadata(body)
        file.metadata[metadata.name] = metadata.entries
    elif opcode == container.STATISTICS:
        file.message_counts = dict(parse_message_counts(body))
    elif opcode in _INDEXED:
        kind = _INDEXED[opcode]
        if len(body) < 8:
            raise ContainerError("index record ends early")
        _add_record(file, kind, record_at(file.data, *struct.unpack_from("<Q", body), kind))
