"""A recording in one file, or in a row of numbered files, each a recording by itself, with no message lost between two.

The next file is open, with its head and topics, before the last takes its end: every message goes to the one or to the other. Both
the making of the new one and the old one's end run on a thread of their own, because a busy disk lets either wait; meanwhile the old
file grows on. An image and the meta written after it stand in the same file.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquire.errors import RecorderError
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.disk_space import DiskSpace
from acquire.recorder.messages import ImageMessage, LentImage, SmallMessage
from acquire.recorder.writer import Channel, McapWriter, Seal
from schemas.mcap.records import Buffer
from schemas.topics import Topic


@dataclass(frozen=True)
class Rotation:
    """When a file is full, and how many are kept."""

    rotate_bytes: int = 0
    """0: one file takes everything"""
    keep_files: int = 0
    """files there may be, the one being written among them; older ones are deleted. 0: all are kept"""


def part_path(path: Path, part: int) -> Path:
    """Of file number `part` in the row that begins with `path`."""
    return path if part == 1 else path.with_name(f"{path.stem}-{part:04d}{path.suffix}")


class FileSeries:
    """Writes to `path`, then to `<stem>-0002.mcap`, `<stem>-0003.mcap`, ... Every method may be called from any thread.

    `write_head(writer, part)` writes manifest and attachments of part 1, 2, ... A series that broke off goes on with `first_part`.

    Raises:
        RecorderError: a path is taken, or the disk refuses or has no room for the next file; the current one can still be finished.
    """

    def __init__(
        self,
        path: Path,
        write_head: Callable[[McapWriter, int], None],
        rotation: Rotation,
        disk: DiskSpace,
        memory: BlockMemory | None = None,
        first_part: int = 1,
    ) -> None:
        """`memory`: see McapWriter."""
        self._path = path
        self._memory = memory
        self._write_head = write_head
        self._rotation = rotation
        self._disk = disk
        self._lock = threading.Lock()
        self._topics: dict[str, Topic] = {}
        self._part = first_part
        self._written = 0
        self._kept = deque(earlier for part in range(1, first_part) if (earlier := part_path(path, part)).exists())
        self._turner: threading.Thread | None = None
        self._next: McapWriter | None = None
        self._refused: RecorderError | None = None
        """why there is no next file"""
        self._error: RecorderError | None = None
        """why a full file could not be finished"""
        self._writer = self._begin(first_part)

    @property
    def path(self) -> Path:
        """Of the file that is being written, once it is whole."""
        return self._writer.path

    @property
    def parts(self) -> int:
        """Number of the newest file."""
        return self._part

    @property
    def size(self) -> int:
        """Bytes written so far, to all files."""
        return self._written + self._writer.size

    @property
    def never_waits(self) -> bool:
        """Whether `write_images` returns without waiting for the disk."""
        return self._memory is not None

    def add_topic(self, topic: Topic) -> Channel:
        """Make a channel; the same topic again gives the same channel, and so does every file."""
        with self._lock:
            self._topics.setdefault(topic.name, topic)
            return self._writer.add_topic(topic)

    def write(self, channel: Channel, log_time_ns: int, data: Buffer, sequence: int = 0) -> None:
        """Write one small message."""
        with self._lock:
            self._writer.write(channel, log_time_ns, data, sequence)

    def write_small(self, channel: Channel, messages: Sequence[SmallMessage]) -> None:
        """Write messages of a small topic."""
        with self._lock:
            self._writer.write_small(channel, messages)

    def write_images(self, channel: Channel, messages: Sequence[ImageMessage]) -> None:
        """Write images together, to the next file where this one is full and that one is ready."""
        with self._lock:
            if 0 < self._rotation.rotate_bytes <= self._writer.size:
                self._turn()
            self._writer.write_images(channel, messages)

    def write_lent(self, channel: Channel, images: Sequence[LentImage]) -> None:
        """The same, from where they lie: see McapWriter."""
        with self._lock:
            if 0 < self._rotation.rotate_bytes <= self._writer.size:
                self._turn()
            self._writer.write_lent(channel, images)

    def flush(self) -> None:
        """Hand small topics to the file now; on return others can read in it what was written before."""
        with self._lock:
            writer = self._writer
        writer.flush()

    def finish(self) -> Seal:
        """Finish the last file.

        Raises:
            RecorderError: it, or one before it, could not be finished; `acquire recover` reads the `.part` file.
        """
        self._join()
        with self._lock:
            # The next file has taken nothing yet if it came too late.
            _discard(self._next)
            seal = self._writer.finish()
            if self._error is not None:
                raise self._error
            return seal

    def abandon(self) -> None:
        """Leave nothing of the current file behind."""
        self._join()
        with self._lock:
            _discard(self._next)
            _discard(self._writer)

    # --- under the lock ---

    def _turn(self) -> None:
        """Go over to the next file if it is ready; if nobody makes it, have it made."""
        if (error := self._error or self._refused) is not None:
            raise error
        if self._next is not None:
            full, self._writer, self._next = self._writer, self._next, None
            for topic in self._topics.values():  # those that came while it was made
                self._writer.add_topic(topic)
            self._part += 1
            self._written += full.size
            self._start(self._finish, full)
        elif self._turner is None or not self._turner.is_alive():
            self._start(self._prepare, self._part + 1)

    def _start(self, work: Callable[[Any], None], argument: object) -> None:
        self._turner = threading.Thread(target=work, args=(argument,), name="recorder-turn")
        self._turner.start()

    # --- helper thread ---

    def _join(self) -> None:
        while (turner := self._turner) is not None and turner.is_alive():
            turner.join()

    def _begin(self, part: int) -> McapWriter:
        path = part_path(self._path, part)
        self._disk.require(self._rotation.rotate_bytes, f"recording {path.name}")
        writer = McapWriter(path, self._memory)
        try:
            self._write_head(writer, part)
            for topic in list(self._topics.values()):
                writer.add_topic(topic)
            writer.flush()
        except BaseException:
            _discard(writer)
            raise
        return writer

    def _prepare(self, part: int) -> None:
        try:
            self._next = self._begin(part)
        except (RecorderError, OSError) as error:
            self._refused = error if isinstance(error, RecorderError) else RecorderError(f"{self._path}: {error.strerror}")

    def _finish(self, writer: McapWriter) -> None:
        try:
            self._kept.append(writer.finish().path)
            while 0 < self._rotation.keep_files <= len(self._kept):
                self._kept.popleft().unlink(missing_ok=True)
        except (RecorderError, OSError) as error:
            self._error = error if isinstance(error, RecorderError) else RecorderError(f"{writer.path}: {error.strerror}")


def _discard(writer: McapWriter | None) -> None:
    if writer is not None:
        writer.abort()
        writer.part_path.unlink(missing_ok=True)
