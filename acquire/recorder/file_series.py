"""A recording in one file or in a series of numbered files, with no message lost between two files.

Each file is a recording by itself.

The next file is open, with its head and topics, before the current one is finished: every message goes to one
of the two. A thread of its own opens the new file and finishes the old one, because a busy disk delays both;
meanwhile the old file keeps growing. An image and the meta (FrameMeta message) written after it are in the
same file.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquire.errors import RecorderError
from acquire.recorder.channel import Channel
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.disk_space import DiskSpace
from acquire.recorder.messages import BorrowedImage, ImageMessage, SmallMessage
from acquire.recorder.seal import Seal
from acquire.recorder.writer import PART_SUFFIX, McapWriter
from schemas.topics import Topic


@dataclass(frozen=True)
class Rotation:
    """Rotation of a recording's files: size at which the next one begins, and number of newest files kept.

    Older files are deleted.
    """

    rotate_bytes: int = 0
    """size of a file [bytes] from which on the next one is begun; 0: everything goes to one file"""
    keep_files: int = 0
    """number of files, including the one being written; older ones are deleted. 0: all are kept"""


def part_path(path: Path, part: int) -> Path:
    """Path of file number `part` (from 1) in the series that begins with `path`.

    Number 1 is `path` itself, number 2 `<stem>-0002<suffix>`.
    """
    return path if part == 1 else path.with_name(f"{path.stem}-{part:04d}{path.suffix}")


def newest_part(path: Path) -> int:
    """Number of the newest file, complete or not, in the series that begins with `path`.

    The folder is searched; 1 if there is no file with a number in its name.
    """
    newest = 1
    for found in path.parent.glob(f"{path.stem}-????{path.suffix}*"):
        name = found.name.removesuffix(PART_SUFFIX)
        number = name.removeprefix(f"{path.stem}-").removesuffix(path.suffix)
        if number.isdecimal():
            newest = max(newest, int(number))
    return newest


class FileSeries:
    """Writer of a recording to `path`, then, as files fill up, to `<stem>-0002.mcap` and so on.

    Every method may be called from any thread.

    Raises:
        RecorderError: a path is taken, or the disk refuses or has no room for the next file; the current one
            can still be finished.
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
        """Open the first file.

        Args:
            path: final path of the series's file number 1.
            write_head: function that writes manifest and attachments at the beginning of a file, given the
                file's writer and number.
            rotation: size at which the next file is begun, and number of files kept.
            disk: check for room on the disk, made before each file.
            memory: blocks for direct I/O, shared by the files; None: write through the page cache.
            first_part: number of the file to be opened; above 1 if an interrupted series continues.
        """
        self._path = path
        self._memory = memory
        self._write_head = write_head
        self._rotation = rotation
        self._disk = disk
        self._lock = threading.Lock()
        self._topics: dict[str, Topic] = {}
        self._part = first_part
        self._written = 0
        self._files = deque(
            earlier for part in range(1, first_part) if (earlier := part_path(path, part)).exists()
        )
        self._rotation_thread: threading.Thread | None = None
        self._next: McapWriter | None = None
        self._refused: RecorderError | None = None
        """error that kept the next file from being opened; None if there was none"""
        self._error: RecorderError | None = None
        """error that kept a full file from being finished; None if there was none"""
        self._writer = self._open_file(first_part)

    @property
    def path(self) -> Path:
        """Final path of the file being written; the file gets that name when it is complete."""
        return self._writer.path

    @property
    def size(self) -> int:
        """Number of bytes written so far, to all files that this object opened."""
        return self._written + self._writer.size

    @property
    def never_waits(self) -> bool:
        """True if `write_images` and `write_borrowed` return without waiting for the disk."""
        return self._memory is not None

    def add_topic(self, topic: Topic) -> Channel:
        """Declare a topic, in the current file and all later ones, and return its handle.

        The handle (number and topic), which is needed to write messages, is valid in every file; the same
        topic again gives the same handle.

        Raises:
            RecorderError: the name is taken by a topic of another message type, the recording is finished, or
                the disk refuses.
        """
        with self._lock:
            self._topics.setdefault(topic.name, topic)
            return self._writer.add_topic(topic)

    def write_small(self, channel: Channel, messages: Sequence[SmallMessage]) -> None:
        """Write messages of a small topic (any topic but the images) to the current file.

        Raises:
            RecorderError: the disk is full or failing, the recording is finished, or a log time is not
                positive.
        """
        with self._lock:
            self._writer.write_small(channel, messages)

    def write_images(self, channel: Channel, messages: Sequence[ImageMessage]) -> None:
        """Write images together to the current file, or to the next one if that is due and ready.

        Raises:
            DiskBehind: there is no memory for the images now; only if `never_waits`.
            RecorderError: the disk is full or failing, the next file could not be opened or an earlier one
                not finished, the recording is finished, or a log time is not positive. In each case no image
                was written.
        """
        with self._lock:
            self._rotate_if_full()
            self._writer.write_images(channel, messages)

    def write_borrowed(self, channel: Channel, images: Sequence[BorrowedImage]) -> None:
        """Write at least one image directly from camera buffers, each in an MCAP chunk of its own.

        The images go to the next file if the current one is full and the next one ready. Each buffer is
        released when its image is on the disk, or when the disk failed.

        Raises:
            DiskBehind: there is no room for the images now.
            RecorderError: the disk is full or failing, the next file could not be opened or an earlier one
                not finished, the recording is finished, or a log time is not positive. In each case no buffer
                is released.
        """
        with self._lock:
            self._rotate_if_full()
            self._writer.write_borrowed(channel, images)

    def flush(self) -> None:
        """Hand small messages that wait in memory to the current file.

        Small messages are those of all topics but the images. On return other programs can read them, except
        those for which the file has no room now: these stay in memory.

        Raises:
            RecorderError: the disk refused some of the messages.
        """
        with self._lock:
            writer = self._writer
        writer.flush()

    def finish(self) -> Seal:
        """Finish the last file.

        Returns:
            Of the last file: path, content id (hash of its messages), number of messages and size [bytes].

        Raises:
            RecorderError: the last file or an earlier one could not be finished; its `.part` file stays, and
                `acquire recover` reads it.
        """
        self._join_rotation()
        with self._lock:
            # A next file that was ready too late has no message.
            _discard(self._next)
            seal = self._writer.finish()
            if self._error is not None:
                raise self._error
            return seal

    def abandon(self) -> None:
        """Stop writing and delete the unfinished files (current and next one); finished ones stay."""
        self._join_rotation()
        with self._lock:
            _discard(self._next)
            _discard(self._writer)

    # --- under the lock ---

    def _rotate_if_full(self) -> None:
        """Change to the next file if the current one is full and the next one ready.

        If the next one is not ready, a thread starts to open it, once.

        Raises:
            RecorderError: the next file could not be opened, or an earlier one not finished.
        """
        if not 0 < self._rotation.rotate_bytes <= self._writer.size:
            return
        if (error := self._error or self._refused) is not None:
            raise error
        if self._next is not None:
            full, self._writer, self._next = self._writer, self._next, None
            for topic in self._topics.values():  # topics that were added while it was opened
                self._writer.add_topic(topic)
            self._part += 1
            self._written += full.size
            self._start(self._finish_full, full)
        elif self._rotation_thread is None or not self._rotation_thread.is_alive():
            self._start(self._open_next, self._part + 1)

    def _start(self, work: Callable[[Any], None], argument: object) -> None:
        self._rotation_thread = threading.Thread(target=work, args=(argument,), name="recorder-rotate")
        self._rotation_thread.start()

    # --- helper thread ---

    def _join_rotation(self) -> None:
        while (thread := self._rotation_thread) is not None and thread.is_alive():
            thread.join()

    def _open_file(self, part: int) -> McapWriter:
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

    def _open_next(self, part: int) -> None:
        try:
            self._next = self._open_file(part)
        except RecorderError as error:
            self._refused = error
        except OSError as error:
            self._refused = RecorderError(f"{self._path}: {error.strerror}")

    def _finish_full(self, writer: McapWriter) -> None:
        try:
            self._files.append(writer.finish().path)
            while 0 < self._rotation.keep_files <= len(self._files):
                self._files.popleft().unlink(missing_ok=True)
        except RecorderError as error:
            self._error = error
        except OSError as error:
            self._error = RecorderError(f"{writer.path}: {error.strerror}")


def _discard(writer: McapWriter | None) -> None:
    if writer is not None:
        writer.abort()
        writer.part_path.unlink(missing_ok=True)
