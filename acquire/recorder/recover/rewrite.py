"""Puts a recording together from pieces of another one: whole chunks as they are, messages one by one where a chunk must change."""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from acquire.errors import RecorderError
from acquire.recorder import atomic
from schemas.mcap import records as container
from schemas.mcap.records import Buffer, ChannelRecord, ContainerError
from schemas.mcap.summary import Summary, pack_chunk, pack_topic
from schemas.topics import Topic

CHUNK_BYTES = 1 << 20


def refuse_folder(path: Path) -> None:
    """Raise RecorderError if `path` is a folder."""
    if path.is_dir():
        raise RecorderError(f"{path}: is a folder: name the recording in it")


@contextmanager
def mapped(path: Path) -> Iterator[memoryview]:
    """A file's bytes, read-only.

    Raises:
        RecorderError: it is missing, a folder, empty, or no MCAP file.
    """
    refuse_folder(path)
    try:
        with path.open("rb") as file:
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError:
        raise RecorderError(f"{path}: no such recording: check the path") from None
    except ValueError:  # mmap of nothing
        raise RecorderError(f"{path}: is empty: there is nothing to read") from None
    except OSError as error:
        raise RecorderError(f"{path}: cannot be read: {error.strerror}") from None
    if data[: len(container.MAGIC)] != container.MAGIC:
        data.close()
        raise RecorderError(f"{path}: is not a recording: it does not begin like an MCAP file")
    # Not closed but dropped: views of it may live on in an exception's traceback.
    yield memoryview(data)


@dataclass(frozen=True)
class Layout:
    """A finished recording, as its summary tells it."""

    summary: Summary
    channels: dict[int, ChannelRecord]
    metadata: dict[str, dict[str, str]]
    data_end: int
    """offset of the DataEnd record: what is appended goes here"""


def read_layout(path: Path, data: memoryview) -> Layout:
    """Read a finished recording's summary.

    Raises:
        RecorderError: it ends early or is damaged.
    """
    footer = len(data) - len(container.MAGIC) - container.FOOTER_SIZE
    try:
        if footer < 0 or data[-len(container.MAGIC) :] != container.MAGIC:
            raise ContainerError("it ends early")
        opcode, _, start, _, crc = struct.unpack_from("<BQQQI", data, footer)
        if opcode != container.FOOTER or not 0 < start < footer:
            raise ContainerError("it has no summary")
        if crc and zlib.crc32(data[start : footer + container.FOOTER_SIZE - 4]) != crc:
            raise ContainerError("its summary is damaged")
        data_end = start - container.RECORD_HEAD - 4
        if data[data_end] != container.DATA_END:
            raise ContainerError("its summary does not follow its data")
        return _layout(data, data[start:footer], data_end)
    except (ContainerError, struct.error, IndexError) as error:
        raise RecorderError(f"{path}: is no whole recording: {error}: `acquire recover` it first") from None


def _layout(data: memoryview, section: memoryview, data_end: int) -> Layout:
    summary = Summary()
    channels: dict[int, ChannelRecord] = {}
    metadata: dict[str, dict[str, str]] = {}
    for opcode, at, body in container.walk(section):
        whole = bytes(section[at : at + container.RECORD_HEAD + len(body)])
        if opcode == container.SCHEMA:
            summary.schemas.append(whole)
        elif opcode == container.CHANNEL:
            channel = container.parse_channel(body)
            channels[channel.id] = channel
            summary.channels.append(whole)
        elif opcode == container.CHUNK_INDEX:
            summary.chunks.append(whole)
        elif opcode == container.ATTACHMENT_INDEX:
            summary.attachments.append(whole)
        elif opcode == container.METADATA_INDEX:
            summary.metadata.append(whole)
            offset, length = struct.unpack_from("<QQ", body)
            record = container.parse_metadata(data[offset + container.RECORD_HEAD : offset + length])
            metadata[record.name] = record.entries
        elif opcode == container.STATISTICS:
            counts = body[46:]
            summary.message_counts = Counter(dict(struct.iter_unpack("<HQ", counts)))
    return Layout(summary, channels, metadata, data_end)


class Rewriter:
    """A new recording under a temporary name; `publish` or `abandon` it.

    Raises:
        RecorderError: the path is taken or the disk refuses.
    """

    def __init__(self, path: Path, part_path: Path) -> None:
        self.path = path
        self.part_path = part_path
        self.summary = Summary()
        self.size = 0
        self._fd = atomic.create_part(part_path)
        self._pending = bytearray()
        self._index: dict[int, list[tuple[int, int]]] = {}

    def start(self) -> None:
        """Magic and header."""
        self._put([container.MAGIC, container.record(container.HEADER, container.string("") + container.string("percuss"))])

    def copy_from(self, source: Path, size: int, summary: Summary) -> None:
        """Begin with the first `size` bytes of `source`, which `summary` describes."""
        fd = os.open(source, os.O_RDONLY | os.O_CLOEXEC)
        try:
            while self.size < size:
                self.size += _copy_range(fd, self._fd, size - self.size, self.size)
        except OSError as error:
            raise self._disk_error(error) from None
        finally:
            os.close(fd)
        self.summary = summary

    def add_topic(self, topic: Topic, number: int) -> None:
        """Declare a topic as channel and schema `number`."""
        schema, channel = pack_topic(topic, number)
        self.declare(schema, self.summary.schemas)
        self.declare(channel, self.summary.channels)

    def declare(self, whole: bytes, records: list[bytes]) -> None:
        """Write a whole schema or channel record and note it in `records`."""
        self.flush()
        self._put([whole])
        records.append(whole)

    def message(self, channel_id: int, sequence: int, log_time_ns: int, publish_time_ns: int, data: Buffer) -> None:
        """Add one message to the chunk that is being filled."""
        self._index.setdefault(channel_id, []).append((log_time_ns, len(self._pending)))
        self._pending += container.message_head(channel_id, sequence, log_time_ns, publish_time_ns, len(data))
        self._pending += data
        if len(self._pending) >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the chunk that is being filled."""
        if self._pending:
            self.chunk(self._pending, zlib.crc32(self._pending), self._index)
            self._pending, self._index = bytearray(), {}

    def chunk(self, messages: Buffer, crc: int, index: dict[int, list[tuple[int, int]]]) -> None:
        """Write message records as a chunk; `index` is channel id -> (log time, offset) of each."""
        packed = pack_chunk(self.size, len(messages), crc, index)
        self._put([packed.head, messages, packed.indexes])
        self.summary.chunks.append(packed.entry)
        for channel_id, entries in index.items():
            self.summary.message_counts[channel_id] += len(entries)

    def attachment(self, whole: memoryview) -> None:
        """Write a whole attachment record."""
        self.flush()
        attachment = container.parse_attachment(whole[container.RECORD_HEAD :])
        offset = self.size
        self._put([whole])
        self.summary.add_attachment(offset, len(whole), attachment, len(attachment.data))

    def metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write named strings."""
        self.flush()
        offset = self.size
        length = self._put([container.record(container.METADATA, container.string(name) + container.string_map(entries))])
        self.summary.add_metadata(offset, length, name)

    def finish(self) -> None:
        """Write the summary and fsync; the file still has its temporary name."""
        self.flush()
        self._put([self.summary.pack(self.size)])
        try:
            os.fsync(self._fd)
        except OSError as error:
            raise self._disk_error(error) from None

    def close(self) -> None:
        """Close the file; what still has its temporary name is removed."""
        os.close(self._fd)
        self.part_path.unlink(missing_ok=True)

    def _put(self, buffers: list[Buffer]) -> int:
        try:
            length = atomic.write_all(self._fd, buffers)
        except OSError as error:
            raise self._disk_error(error) from None
        self.size += length
        return length

    def _disk_error(self, error: OSError) -> RecorderError:
        return RecorderError(f"{self.path}: cannot be written: {error.strerror}: free space on this disk and try again")


def _copy_range(source: int, target: int, count: int, offset: int) -> int:
    try:
        copied = os.copy_file_range(source, target, count, offset)
    except OSError:
        # Not between these file systems (EXDEV, ENOSYS): through the page cache instead.
        copied = os.sendfile(target, source, offset, count)
    if copied == 0:
        raise OSError(5, "the recording became shorter while it was copied")
    return copied
