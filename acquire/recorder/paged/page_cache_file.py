"""A file written through the kernel's page cache: appended bytes are kept if this process is killed."""

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
"""space kept from other writers on the disk [bytes], so that a full disk still lets the summary be written"""


class PageCacheFile:
    """File of a recording, written through the kernel's page cache; implements RecordingFile.

    After each `sync_bytes` the kernel is made to write its cache, so that it never has seconds of data to
    write.

    Args:
        part_path: path of the new file, which must not exist.
        sync_bytes: bytes after which `sync` calls fdatasync.

    Raises:
        RecorderError: `part_path` is taken, or cannot be created in its folder.
    """

    never_waits: ClassVar = False

    def __init__(self, part_path: Path, sync_bytes: int) -> None:
        self.size = 0
        self._fd = atomic.create_part(part_path)
        self._reserve = atomic.reserve(part_path.parent, RESERVE_BYTES)
        self._sync_bytes = sync_bytes
        self._synced = 0

    def has_room(self, size: int, *, image: bool, borrowed: int = 0) -> bool:  # noqa: ARG002 - `append` waits
        """Always True: `append` waits for the disk if it must, and raises OSError if the disk is full."""
        return True

    def append_borrowed(self, run: BorrowedRun) -> int:
        """Write images from borrowed camera buffers and the bytes around them, then release the buffers.

        Args:
            run: the images' borrowed pages, and the bytes before, between and after them.

        Returns:
            Number of bytes appended.

        Raises:
            OSError: the disk is full or failing; the file is unchanged and no buffer was released.
        """
        pieces = itertools.chain.from_iterable(zip(run.pages, run.following, strict=True))
        length = self.append([run.lead, *pieces])
        for release in run.release:
            release()
        return length

    def append(self, buffers: Sequence[Buffer], *, image: bool = False) -> int:  # noqa: ARG002 - all may
        """Write all `buffers` at the end of the file, or none; waits for the disk where it must.

        Returns:
            Number of bytes appended.

        Raises:
            OSError: the disk is full or failing; the file is unchanged.
        """
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
        """Free the RESERVE_BYTES of reserved disk space, so that the end of the recording can be written."""
        if self._reserve is not None:
            os.close(self._reserve)
            self._reserve = None

    def wait_until(self, size: int) -> None:
        """Do nothing: other programs can read appended bytes at once."""

    def sync(self) -> None:
        """Make the kernel write the file (fdatasync) if `sync_bytes` were appended since the last time.

        An error of the disk is ignored here; the fsync of `finish` reports it again.
        """
        if self.size - self._synced >= self._sync_bytes:
            self._synced = self.size
            with contextlib.suppress(OSError):  # reported again by the fsync in finish
                os.fdatasync(self._fd)

    def finish(self) -> None:
        """Make the kernel write the whole file to the disk (fsync), and close it.

        Raises:
            OSError: the disk refuses; the file is closed all the same.
        """
        try:
            os.fsync(self._fd)
        finally:
            self.abort()

    def abort(self) -> None:
        """Release the reserved disk space and close the file without fsync."""
        self.release_reserve()
        os.close(self._fd)
