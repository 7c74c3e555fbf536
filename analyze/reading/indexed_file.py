"""A recording's file, mapped: where every message stands, and views of them without copying.

Two ways in: by the summary at the end of a finished file, or by walking a file that ends early from its start. Every chunk's CRC is
checked once, when it is first looked into; whatever the bytes are, the only error is RecordingError.
"""

from __future__ import annotations

import contextlib
import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analyze.errors import RecordingCut, RecordingError, RecordingForeign
from schemas.mcap import records as container
from schemas.mcap.records import AttachmentRecord, ChannelRecord, ChunkRecord, ContainerError, MessageRecord


@dataclass(frozen=True)
class RecordedMessage:
    """One message as it stands in the file; `data` is a view that stays valid."""

    topic: str
    log_time_ns: int
    sequence: int
    data: memoryview


@dataclass(frozen=True)
class TopicIndex:
    """Where a topic's messages stand, by time; equal times keep the file's order."""

    time_ns: NDArray[np.int64]
    """(n,)"""
    chunk: NDArray[np.int64]
    """(n,) number of the chunk"""
    offset: NDArray[np.int64]
    """(n,) bytes into the chunk's messages"""


@dataclass(frozen=True)
class _Chunk:
    offset: int
    length: int
    index_offsets: dict[int, int] | None
    """channel id -> message index record; None: unknown, look into the chunk"""


@dataclass
class IndexedFile:
    """A mapped recording. Views stay valid after `close`."""

    path: Path
    data: memoryview
    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    chunks: list[_Chunk] = field(default_factory=list)
    attachments: dict[str, AttachmentRecord] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    damaged_chunks: int = 0
    """left out of a file that was walked"""
    _indexes: dict[str, TopicIndex] = field(default_factory=dict)
    _whole: dict[int, memoryview] = field(default_factory=dict)

    def release_memory(self) -> None:
        """Let the system take back what it holds of the file; views are read from the file again when they are used."""
        if isinstance(self.data.obj, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            self.data.obj.madvise(mmap.MADV_DONTNEED)

    def close(self) -> None:
        """Let go of the file, as far as no view is in use."""
        self._whole.clear()
        self._indexes.clear()
        mapped = self.data.obj
        with contextlib.suppress(BufferError):
            self.data.release()
            if isinstance(mapped, mmap.mmap):
                mapped.close()

    def topic_names(self) -> tuple[str, ...]:
        """Topics in the order of their channels."""
        return tuple(dict.fromkeys(channel.topic for channel in self.channels.values()))

    def schema_of(self, topic: str) -> str:
        """Full name of the topic's message type."""
        return next((self.schemas.get(channel.schema_id, "") for channel in self.channels.values() if channel.topic == topic), "")

    def index(self, topic: str) -> TopicIndex:
        """Where the topic's messages stand; read once.

        Raises:
            RecordingError: the file is damaged.
        """
        if topic not in self._indexes:
            ids = {channel.id for channel in self.channels.values() if channel.topic == topic}
            with self.guarded():
                self._indexes[topic] = self._read_index(ids)
        return self._indexes[topic]

    def message(self, index: TopicIndex, number: int) -> MessageRecord:
        """One message; its data is a view into the file.

        Raises:
            RecordingError: the file is damaged.
        """
        with self.guarded():
            messages = self.chunk_messages(int(index.chunk[number]))
            at = int(index.offset[number])
            if at + container.RECORD_HEAD > len(messages):
                raise ContainerError("a message index points outside its chunk")
            opcode, size = struct.unpack_from("<BQ", messages, at)
            end = at + container.RECORD_HEAD + size
            if opcode != container.MESSAGE or end > len(messages):
                raise ContainerError("a message index points at something else")
            return container.parse_message(messages[at + container.RECORD_HEAD : end])

    def chunk_messages(self, number: int) -> memoryview:
        """Message records of one chunk; its CRC is checked the first time.

        Raises:
            ContainerError: damaged.
        """
        whole = self._whole.get(number)
        if whole is not None:
            return whole
        chunk = self._chunk(number)
        whole = container.chunk_messages(chunk)
        if chunk.compression:
            # Unpacked chunks cost memory, views of the file do not: keep only the last one.
            self._whole = {kept: view for kept, view in self._whole.items() if view.obj is self.data.obj}
        self._whole[number] = whole
        return whole

    def forget_chunk(self, number: int) -> None:
        """Let go of a chunk's messages; it is checked again when it is looked into again."""
        self._whole.pop(number, None)

    @contextlib.contextmanager
    def guarded(self) -> Iterator[None]:
        """Whatever damaged bytes cause becomes one line."""
        try:
            yield
        except (ContainerError, struct.error) as error:
            raise RecordingError(f"{self.path}: damaged: {error}: `acquire recover` saves what can be read") from None

    def _chunk(self, number: int) -> ChunkRecord:
        chunk = self.chunks[number]
        body = self.data[chunk.offset + container.RECORD_HEAD : chunk.offset + chunk.length]
        return container.parse_chunk(body)

    def _read_index(self, channel_ids: set[int]) -> TopicIndex:
        entries: list[NDArray[np.uint64]] = []
        chunks: list[NDArray[np.int64]] = []
        for number, chunk in enumerate(self.chunks):
            for channel_id in channel_ids:
                found = self._chunk_index(number, chunk, channel_id)
                if len(found):
                    entries.append(found)
                    chunks.append(np.full(len(found), number, dtype=np.int64))
        if not entries:
            empty = np.empty(0, dtype=np.int64)
            return TopicIndex(empty, empty, empty)
        table = np.concatenate(entries).astype(np.int64)
        chunk_numbers = np.concatenate(chunks)
        order = np.lexsort((table[:, 1], chunk_numbers, table[:, 0]))
        return TopicIndex(table[order, 0], chunk_numbers[order], table[order, 1])

    def _chunk_index(self, number: int, chunk: _Chunk, channel_id: int) -> NDArray[np.uint64]:
        """(n, 2) log time and offset of one channel's messages in one chunk."""
        if chunk.index_offsets is None:
            return np.array(
                [(message.log_time_ns, at) for at, message in _messages(self.chunk_messages(number)) if message.channel_id == channel_id],
                dtype=np.uint64,
            ).reshape(-1, 2)
        at = chunk.index_offsets.get(channel_id)
        if at is None:
            return np.empty((0, 2), dtype=np.uint64)
        if at + container.RECORD_HEAD + 6 > len(self.data):
            raise ContainerError("a chunk index points outside the file")
        opcode, size, found_id, length = struct.unpack_from("<BQHI", self.data, at)
        start = at + container.RECORD_HEAD + 6
        if (
            opcode != container.MESSAGE_INDEX
            or found_id != channel_id
            or length + 6 > size
            or length > len(self.data) - start
            or length % 16
        ):
            raise ContainerError("a chunk index points at something else than a message index")
        return np.frombuffer(self.data, "<u8", length // 8, start).reshape(-1, 2)


def _messages(records: memoryview) -> Iterator[tuple[int, MessageRecord]]:
    for opcode, at, body in container.walk(records):
        if opcode == container.MESSAGE:
            yield at, container.parse_message(body)


def mapped(path: Path) -> memoryview:
    """A file's bytes, mapped.

    Raises:
        RecordingCut: it is empty.
        RecordingError: it is missing, cannot be read, or is no MCAP file.
    """
    try:
        with path.open("rb") as file:
            data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such recording: check the path") from None
    except ValueError:  # mmap of nothing
        raise RecordingCut(f"{path}: is empty: nothing of this recording can be saved: record again") from None
    except IsADirectoryError as error:
        inside = sorted(file.name for file in path.glob("*.mcap"))  # ROS 2 keeps a bag in a folder
        remedy = f": name a file in it, as {inside[0]}" if inside else ""
        raise RecordingError(f"{path}: cannot be read: {error.strerror}{remedy}") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from None
    magic = container.MAGIC
    if bytes(data[: len(magic)]) != magic:
        data.release()
        raise RecordingForeign(f"{path}: is not a recording: it does not begin like an MCAP file")
    return data


def open_finished(path: Path) -> IndexedFile:
    """Map a finished recording; only its summary is read.

    Raises:
        RecordingCut: it ends early.
        RecordingError: it is missing, not MCAP, or damaged.
    """
    file = IndexedFile(path, mapped(path))
    try:
        with file.guarded():
            for opcode, _, body in container.walk(_summary(file)):
                _take(file, opcode, body)
    except RecordingError:
        file.close()
        raise
    return file


def open_cut(path: Path) -> IndexedFile:
    """Map a recording that ends anywhere, and walk it: whole, undamaged chunks count.

    Raises:
        RecordingError: it is missing or not MCAP.
    """
    file = IndexedFile(path, mapped(path))
    for opcode, at, body in container.walk(file.data, len(container.MAGIC)):
        if opcode == container.DATA_END:
            break
        try:
            if opcode == container.CHUNK:
                container.chunk_messages(container.parse_chunk(body))
                file.chunks.append(_Chunk(at, container.RECORD_HEAD + len(body), None))
            elif opcode == container.ATTACHMENT:
                attachment = container.parse_attachment(body)
                file.attachments[attachment.name] = attachment
            elif opcode == container.METADATA:
                metadata = container.parse_metadata(body)
                file.metadata[metadata.name] = metadata.entries
            else:
                _take(file, opcode, body)
        except ContainerError:
            file.damaged_chunks += 1
    return file


def _summary(file: IndexedFile) -> memoryview:
    data, magic = file.data, container.MAGIC
    cut = RecordingCut(f"{file.path}: ends early: it was cut short or is still being written: `acquire recover {file.path} -o NEW.mcap`")
    footer = len(data) - len(magic) - container.FOOTER_SIZE
    if footer < len(magic) or bytes(data[-len(magic) :]) != magic:
        raise cut
    opcode, size, start, _, crc = struct.unpack_from("<BQQQI", data, footer)
    if opcode != container.FOOTER or size != 20 or not 0 < start < footer:
        raise cut
    if crc and zlib.crc32(data[start : footer + container.FOOTER_SIZE - 4]) != crc:
        raise ContainerError("the summary's CRC is wrong")
    return data[start:footer]


def _take(file: IndexedFile, opcode: int, body: memoryview) -> None:
    if opcode == container.SCHEMA:
        schema = container.parse_schema(body)
        file.schemas[schema.id] = schema.name
    elif opcode == container.CHANNEL:
        channel = container.parse_channel(body)
        file.channels[channel.id] = channel
    elif opcode == container.CHUNK_INDEX:
        file.chunks.append(_chunk_place(file, body))
    elif opcode == container.ATTACHMENT_INDEX:
        attachment = container.parse_attachment(_record(file, body, container.ATTACHMENT))
        file.attachments[attachment.name] = attachment
    elif opcode == container.METADATA_INDEX:
        metadata = container.parse_metadata(_record(file, body, container.METADATA))
        file.metadata[metadata.name] = metadata.entries


def _chunk_place(file: IndexedFile, body: memoryview) -> _Chunk:
    _, _, offset, length, size = struct.unpack_from("<QQQQI", body)
    if offset + length > len(file.data) or length < container.RECORD_HEAD or file.data[offset] != container.CHUNK:
        raise ContainerError("the summary points at something else than a chunk")
    if size > len(body) - 36 or size % 10:
        raise ContainerError("a chunk index record ends early")
    offsets = dict(struct.iter_unpack("<HQ", body[36 : 36 + size]))
    return _Chunk(offset, length, offsets)


def _record(file: IndexedFile, index: memoryview, expected: int) -> memoryview:
    """Body of the record that an attachment or metadata index points at."""
    offset, length = struct.unpack_from("<QQ", index)
    if length < container.RECORD_HEAD or offset + length > len(file.data) or file.data[offset] != expected:
        raise ContainerError("the summary points at something else than it says")
    return file.data[offset + container.RECORD_HEAD : offset + length]
