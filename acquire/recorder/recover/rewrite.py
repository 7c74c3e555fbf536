"""Assembles a new recording from parts of another one.

Whole MCAP chunks are copied unchanged; of a chunk that must change, the messages are copied one by one.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from acquire.errors import RecorderError
from acquire.recorder import atomic
from schemas.input_file import open_file
from schemas.mcap import records as container
from schemas.mcap.chunks import MessagePlaces, PendingMessages
from schemas.mcap.record_writer import RecordWriter
from schemas.mcap.records import Buffer, ChannelRecord, ContainerError
from schemas.mcap.summary import DATA_END_SIZE, Summary, find_summary, parse_message_counts
from schemas.mcap.walk import record_at, walk
from schemas.topics import Topic

CHUNK_BYTES = 1 << 20


def refuse_folder(path: Path) -> None:
    """Raise RecorderError if `path` is a folder."""
    if path.is_dir():
        raise RecorderError(f"{path}: is a folder: name the recording in it")


@contextmanager
def mapped(path: Path) -> Iterator[memoryview]:
    """Context manager that maps a recording's bytes into memory, read-only.

    Yields:
        The bytes of the whole file.

    Raises:
        RecorderError: the file is missing, a folder, empty, or no MCAP file.
    """
    refuse_folder(path)
    try:
        with open_file(path) as file:
            data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError:
        raise RecorderError(f"{path}: no such recording: check the path") from None
    except ValueError:  # mmap of an empty file
        raise RecorderError(f"{path}: is empty: there is nothing to read") from None
    except OSError as error:
        raise RecorderError(f"{path}: cannot be read: {error.strerror}") from None
    if data[: len(container.MAGIC)] != container.MAGIC:
        data.close()
        raise RecorderError(f"{path}: is not a recording: it does not begin like an MCAP file")
    # Dropped, not closed: an exception's traceback may still hold views of it.
    yield memoryview(data)


@dataclass(frozen=True)
class Layout:
    """Contents of a finished recording, from the summary at its end: topics, metadata, index records.

    Index records state where the chunks (blocks of messages), attachments and metadata are in the file.
    """

    summary: Summary
    """whole records of the summary section"""
    channels: dict[int, ChannelRecord]
    """channel records, by channel id"""
    metadata: dict[str, dict[str, str]]
    """entries of the metadata records, by name"""
    data_end: int
    """offset of the DataEnd record, where further records are appended [bytes]"""

    @property
    def topics(self) -> dict[int, str]:
        """Topic names of the recording, by channel id (number of the topic in the file)."""
        return {number: channel.topic for number, channel in self.channels.items()}


def read_layout(path: Path, data: memoryview) -> Layout:
    """Contents of a finished recording: its topics, metadata and index records, and the end of its data.

    Args:
        path: path of the recording, for the error's text.
        data: bytes of the whole file.

    Raises:
        RecorderError: the recording ends early or is damaged.
    """
    try:
        section = find_summary(data)
        data_end = section.start - DATA_END_SIZE
        record_at(data, data_end, container.DATA_END)
        return _parse_layout(data, section.records, data_end)
    except (ContainerError, struct.error) as error:
        raise RecorderError(
            f"{path}: is not a whole recording: {error}: `acquire recover` it first"
        ) from None


def _parse_layout(data: memoryview, section: memoryview, data_end: int) -> Layout:
    summary = Summary()
    groups = {
        container.SCHEMA: summary.schemas,
        container.CHANNEL: summary.channels,
        container.CHUNK_INDEX: summary.chunks,
        container.ATTACHMENT_INDEX: summary.attachments,
        container.METADATA_INDEX: summary.metadata,
    }
    channels: dict[int, ChannelRecord] = {}
    metadata: dict[str, dict[str, str]] = {}
    for opcode, at, body in walk(section):
        if (group := groups.get(opcode)) is not None:
            group.append(bytes(section[at : at + container.RECORD_HEAD + len(body)]))
        if opcode == container.CHANNEL:
            channel = container.parse_channel(body)
            channels[channel.id] = channel
        elif opcode == container.METADATA_INDEX:
            (offset,) = struct.unpack_from("<Q", body)
            record = container.parse_metadata(record_at(data, offset, container.METADATA))
            metadata[record.name] = record.entries
        elif opcode == container.STATISTICS:
            summary.message_counts = parse_message_counts(body)
    return Layout(summary, channels, metadata, data_end)


class Rewriter:
    """Writer of a new recording under a temporary name; after `finish` the file is complete.

    The caller then renames it.

    Args:
        path: final path, for the errors' texts.
        part_path: temporary path of the new file.

    Raises:
        RecorderError: the temporary path is taken or the disk refuses.
    """

    def __init__(self, path: Path, part_path: Path) -> None:
        self.path = path
        self.part_path = part_path
        self.records = RecordWriter(self._append)
        self._fd = atomic.create_part(part_path)
        self._pending = PendingMessages()

    @property
    def summary(self) -> Summary:
        """Summary of the records written so far: lists of topics, chunks, attachments and metadata.

        Messages that wait for their chunk to fill up are not in it.
        """
        return self.records.summary

    def copy_from(self, source: Path, size: int, summary: Summary) -> None:
        """Begin the new file with the first `size` bytes of the file `source`.

        Args:
            source: existing recording.
            size: number of bytes to copy.
            summary: summary of the records in those bytes; it is extended by later records.

        Raises:
            RecorderError: the bytes cannot be copied.
            OSError: `source` cannot be opened.
        """
        fd = os.open(source, os.O_RDONLY | os.O_CLOEXEC)
        copied = 0
        try:
            while copied < size:
                copied += _copy_range(fd, self._fd, size - copied, copied)
        except OSError as error:
            raise self._disk_error(error) from None
        finally:
            os.close(fd)
        self.records.size, self.records.summary = copied, summary

    def add_topic(self, topic: Topic, number: int) -> None:
        """Write the records that declare a topic: schema and channel, both with the id `number`.

        Raises:
            RecorderError: the disk refuses.
        """
        self.flush()
        self.records.add_topic(topic, number)

    def copy_declaration(self, whole: bytes) -> None:
        """Write a schema or channel record (declaration of a message type or topic) of another recording.

        The bytes of the record, `whole`, are written unchanged.

        Raises:
            RecorderError: the disk refuses.
        """
        self.flush()
        self.records.copy_declaration(whole)

    def write_message(
        self, channel_id: int, sequence: int, log_time_ns: int, publish_time_ns: int, data: Buffer
    ) -> None:
        """Add one message to those in memory, which are written as one MCAP chunk at CHUNK_BYTES.

        Raises:
            RecorderError: the disk refuses.
        """
        self._pending.add(channel_id, sequence, log_time_ns, publish_time_ns, data)
        if len(self._pending.data) >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the messages that wait in memory as an MCAP chunk; does nothing if there are none.

        Raises:
            RecorderError: the disk refuses.
        """
        if self._pending.data:
            self.records.write_pending(self._pending)
            self._pending = PendingMessages()

    def copy_chunk(self, messages: memoryview, places: MessagePlaces) -> None:
        """Write message records of another recording as an MCAP chunk of their own.

        Args:
            messages: bytes of whole message records.
            places: (log time [ns], offset in `messages`) of each record, by channel id.

        Raises:
            RecorderError: the disk refuses.
        """
        self.flush()
        self.records.write_chunk([messages], len(messages), zlib.crc32(messages), places)

    def copy_attachment(self, whole: memoryview) -> None:
        """Write an attachment record of another recording; its bytes, `whole`, are unchanged.

        Raises:
            ContainerError: the record is damaged.
            RecorderError: the disk refuses.
        """
        self.flush()
        self.records.copy_attachment(whole, container.parse_attachment(whole[container.RECORD_HEAD :]))

    def write_metadata(self, name: str, entries: dict[str, str]) -> None:
        """Write a metadata record: a named map of strings.

        Raises:
            RecorderError: the disk refuses.
        """
        self.flush()
        self.records.write_metadata(name, entries)

    def finish(self) -> None:
        """Write the messages in memory and the summary, and fsync; the file keeps its temporary name.

        Raises:
            RecorderError: the disk refuses.
        """
        self.flush()
        self.records.end()
        try:
            os.fsync(self._fd)
        except OSError as error:
            raise self._disk_error(error) from None

    def close(self) -> None:
        """Close the file, and remove it if it still has its temporary name."""
        os.close(self._fd)
        self.part_path.unlink(missing_ok=True)

    def _append(self, buffers: Sequence[Buffer]) -> None:
        try:
            atomic.write_all(self._fd, buffers)
        except OSError as error:
            raise self._disk_error(error) from None

    def _disk_error(self, error: OSError) -> RecorderError:
        return RecorderError(
            f"{self.path}: cannot be written: {error.strerror}: free space on this disk and try again"
        )


def _copy_range(source: int, target: int, count: int, offset: int) -> int:
    """Copy bytes of the file `source` from `offset` on to the current position in the file `target`.

    Args:
        source: descriptor of the file to read.
        target: descriptor of the file to write.
        count: greatest number of bytes to copy.
        offset: offset in `source` of the first byte.

    Returns:
        Number of bytes copied: at least 1, at most `count`.

    Raises:
        OSError: the bytes cannot be copied, or `source` ends at `offset`.
    """
    try:
        copied = os.copy_file_range(source, target, count, offset)
    except OSError:
        # Not between these file systems (EXDEV, ENOSYS): through the page cache instead.
        copied = os.sendfile(target, source, offset, count)
    if copied == 0:
        raise OSError(5, "the recording became shorter while it was copied")
    return copied
