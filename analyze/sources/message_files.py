"""Reads message files of other programs (MCAP files, ROS 2 bags): their topics, and messages by time.

A bag is a folder with metadata.yaml, or a single .db3 file. Their images become frames in topic_source.py.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.reader import SeekingReader
from mcap.records import Chunk
from mcap.summary import Summary
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from analyze.errors import ImportRefused
from analyze.sources.bag_checks import METADATA, check_bag, unpacked_message
from analyze.sources.pictures import VIDEO
from schemas.input_file import open_file
from schemas.mcap.chunks import refuse_bomb
from schemas.mcap.records import RECORD_HEAD, ChunkRecord, ContainerError
from schemas.session_manifest import MANIFEST_NAME

BAG_FILE = ".db3"
MAX_RECORD_BYTES = 1 << 30
"""largest record that is read [bytes]: a damaged length could demand any amount of memory"""


@dataclass(frozen=True)
class LoggedTopic:
    """A topic of a message file, with one message type and encoding, and its number of messages."""

    name: str
    """name of the topic"""
    schema: str
    """name of the messages' type"""
    encoding: str
    """encoding of the messages: protobuf, json or cdr"""
    count: int | None
    """number of messages; None if the file does not state it (for a bag also if it states 0)"""


class LoggedMessage(NamedTuple):
    """A message as stored in the file, not parsed, with its log time [ns]."""

    log_ns: int
    """time at which the recorder received the message, on the recorder's clock [ns]"""
    data: bytes
    """the message, encoded"""


class McapFile:
    """MCAP file with an index, written by any other program; every call opens the file anew."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def topics(self) -> list[LoggedTopic]:
        """Topics by the file's index, sorted by name, then by message type and encoding.

        Raises:
            ImportRefused: the file is damaged, without index or messages, or already one of this project's
                recordings.
        """
        with self._named_damage(), open_file(self.path) as stream:
            summary = SeekingReader(stream, record_size_limit=MAX_RECORD_BYTES).get_summary()
            if summary is None or not summary.channels:
                raise ImportRefused(
                    f"{self.path}: contains no index, or no messages: rewrite it with `mcap recover "
                    f"{self.path.name} -o NEW.mcap`"
                )
            if any(index.name == MANIFEST_NAME for index in summary.metadata_indexes):
                raise ImportRefused(
                    f"{self.path}: is already a recording: use it as it is, as in `analyze estimate "
                    f"{self.path.name}`"
                )
            counts = summary.statistics.channel_message_counts if summary.statistics is not None else None
            found: Counter[tuple[str, str, str]] = Counter()
            for number, channel in summary.channels.items():
                schema = summary.schemas.get(channel.schema_id)
                key = (channel.topic, "" if schema is None else schema.name, channel.message_encoding)
                found[key] += 0 if counts is None else counts.get(number, 0)
        return [LoggedTopic(*key, None if counts is None else many) for key, many in sorted(found.items())]

    def messages(
        self, topic: LoggedTopic, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[LoggedMessage]:
        """Yield the messages of a topic by log time, those of a video in the file's order.

        Args:
            topic: topic, as returned by `topics`.
            start_ns: earliest log time [ns], included; None for no limit.
            end_ns: latest log time [ns], included; None for no limit.

        Raises:
            ImportRefused: the file cannot be read or is damaged.
        """
        with self._named_damage(), open_file(self.path) as stream:
            until = None if end_ns is None else max(end_ns + 1, start_ns or 0)
            reader = SeekingReader(stream, record_size_limit=MAX_RECORD_BYTES)
            self._refuse_bombs(stream, reader.get_summary(), start_ns or 0, until)
            found = reader.iter_messages(
                [topic.name],
                starting_at=start_ns,
                ending_before=until,
                log_time_order=topic.schema != VIDEO,
            )
            for schema, channel, message in found:
                if (
                    channel.message_encoding == topic.encoding
                    and (schema.name if schema else "") == topic.schema
                ):
                    yield LoggedMessage(message.log_time, message.data)

    def _refuse_bombs(
        self, stream: BinaryIO, summary: Summary | None, start_ns: int, until_ns: int | None
    ) -> None:
        """Refuse compressed chunks that are to be read and would take too much memory: mcap has no bound."""
        for index in summary.chunk_indexes if summary is not None else ():
            later = until_ns is not None and index.message_start_time >= until_ns
            if later or index.message_end_time < start_ns:
                continue
            stream.seek(index.chunk_start_offset + RECORD_HEAD)
            chunk = Chunk.read(ReadDataStream(stream))
            if not chunk.compression:
                continue
            times, data = (chunk.message_start_time, chunk.message_end_time), memoryview(chunk.data)
            try:
                refuse_bomb(ChunkRecord(*times, chunk.uncompressed_size, 0, chunk.compression, data))
            except ContainerError as error:
                raise ImportRefused(
                    f"{self.path}: {error}: write it anew with chunks of a few megabytes, or copy it again"
                ) from None

    @contextmanager
    def _named_damage(self) -> Iterator[None]:
        """Convert every error within the `with` block to ImportRefused with the file's name.

        An ImportRefused of the block itself passes unchanged.
        """
        try:
            yield
        except ImportRefused:
            raise
        except OSError as error:
            raise ImportRefused(f"{self.path}: cannot be read: {error.strerror}") from None
        except Exception:  # the reader and three decompressors raise errors of their own
            raise ImportRefused(
                f"{self.path}: not an MCAP file, damaged, or cut short: try `mcap recover {self.path.name} "
                "-o NEW.mcap`"
            ) from None


class BagFile:
    """ROS 2 bag with SQLite or MCAP storage; a folder stands for all its files.

    Every call opens the bag anew.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._is_checked = False

    def topics(self) -> list[LoggedTopic]:
        """Topics of the bag, sorted by name, then by message type and encoding.

        Raises:
            ImportRefused: the bag cannot be read.
        """
        with self._opened() as reader:
            found: Counter[tuple[str, str, str]] = Counter()
            for connection in reader.connections:
                key = (connection.topic, connection.msgtype, _serialization(connection))
                found[key] += connection.msgcount
        return [LoggedTopic(*key, many or None) for key, many in sorted(found.items())]

    def messages(
        self, topic: LoggedTopic, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[LoggedMessage]:
        """Yield the messages of a topic by log time.

        Args:
            topic: topic, as returned by `topics`.
            start_ns: earliest log time [ns], included; None for no limit.
            end_ns: latest log time [ns], included; None for no limit.

        Raises:
            ImportRefused: the bag cannot be read.
        """
        with self._opened() as reader:
            meant = [
                each
                for each in reader.connections
                if each.topic == topic.name and each.msgtype == topic.schema
            ]
            until = None if end_ns is None else end_ns + 1
            packed = reader.compression_mode == "message"
            if packed:  # the reader would unpack without bounds
                storage: Any = reader.storage
                storage.metadata = storage.metadata._replace(compression_mode=None)
            for _, log_ns, data in reader.messages(meant, start_ns, until):
                yield LoggedMessage(log_ns, unpacked_message(data) if packed else bytes(data))

    @contextmanager
    def _opened(self) -> Iterator[Reader]:
        """Open the bag for a `with` block, which gets its reader.

        Errors of opening and of the block become ImportRefused with the bag's name.
        """
        try:
            if not self._is_checked:
                check_bag(self.path)
                self._is_checked = True
            with Reader(self.path) as reader:
                yield reader
        except ImportRefused:
            raise
        except OSError as error:
            raise ImportRefused(f"{self.path}: cannot be read: {error.strerror or error}") from None
        except ContainerError as error:
            raise ImportRefused(
                f"{self.path}: {error}: copy the bag again from where it was recorded"
            ) from None
        except Exception as error:  # reader, storages and decompressor raise errors of their own
            raise ImportRefused(
                f"{self.path}: not a readable ROS 2 bag ({' '.join(str(error).split())[:120]}): check it "
                "with `ros2 bag info`"
            ) from None


def _serialization(connection: Connection) -> str:
    """Encoding of the messages of a bag's connection (one topic with one type); cdr if not stated."""
    return str(getattr(connection.ext, "serialization_format", "cdr"))


def is_bag(path: Path) -> bool:
    """True if the path is a ROS 2 bag: a folder with metadata.yaml, or a name in .db3."""
    return (path / METADATA).is_file() or path.suffix.lower() == BAG_FILE


def is_message_file(path: Path) -> bool:
    """True if the path is a ROS 2 bag, or its name ends in .mcap."""
    return path.suffix.lower() == ".mcap" or is_bag(path)


def open_message_file(path: Path) -> McapFile | BagFile:
    """Reader of the message file at a path: of a ROS 2 bag if it is one, otherwise of an MCAP file."""
    return BagFile(path) if is_bag(path) else McapFile(path)
