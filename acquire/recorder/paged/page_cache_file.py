"""A file written through the kernel's page cache: bytes survive this process once `append` accepted them."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Final

from acquire.recorder import atomic
from acquire.recorder.recording_file import BorrowedRun
from schemas.mcap.records import Buffer

RESERVE_BYTES: Final = 8 << 20
"""space kept from other writers on the disk, so that a full disk still lets the summary be written"""


class PageCacheFile:
    """RecordingFile in the page cache.

    Every `sync_bytes` the kernel is made to write, so that it never has seconds of data to write.

    Raises:
        RecorderError: `part_path` is taken, or its folder is missing.
    """

    never_waits: ClassVar = False

    def __init__(self, part_path: Path, sync_bytes: int) -> None:
        self.size = 0
        self._fd = atomic.create_part(part_path)
        self._reserve = atomic.reserve(part_path.parent, RESERVE_BYTES)
        self._sync_bytes = sync_bytes
        self._synced = 0

    def has_room(self, size: int, *, image: bool, borrowed: int = 0) -> bool:  # noqa: ARG002 - `append` waits
        """See RecordingFile."""
        return True

    def append_borrowed(self, run: BorrowedRun) -> int:
        """See RecordingFile."""
        pieces = itertools.chain.from_iterable(zip(run.pages, run.following, strict=True))
        length = self.append([run.lead, *pieces])
        for release in run.release:
            release()
        return length

    def append(self, buffers: Sequence[Buffer], *, image: bool = False) -> int:  # noqa: ARG002 - all may
        """See RecordingFile."""
        try:
            length = atomic.write_all(self._fd, buffers)
        except OSError:
            # Take back the half-written record: the file stays a sequence of whole records.
            os.ftruncate(self._fd, self.size)
            os.lseek(self._fd, self.size, os.SEEK_SET)
            raise
        self.size += length
        return length

    def release_reserve(self) -> None:
        """See RecordingFile."""
        if self._reserve is not None:
            os.close(self._reserve)
            self._reserve = None

    def wait_until(self, size: int) -> None:
        """See RecordingFile: the bytes are readable as soon as they are accepted."""

    def sync(self) -> None:
        """See RecordingFile."""
        if self.size - self._synced >= self._sync_bytes:
            self._synced = self.size
            with contextlib.suppress(OSError):  # reported again by the fsync in finish
                os.fdatasync(self._fd)

    def finish(self) -> None:
        """See RecordingFile."""
        try:
            os.fsync(self._fd)
        finally:
            self.abort()

    def abort(self) -> None:
        """See RecordingFile."""
        self.release_reserve()
        os.close(self._fd)
