"""A file written through the kernel's page cache: what `append` took in outlives this process from then on."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Final

from acquire.recorder import atomic
from acquire.recorder.data_file import LentRun
from schemas.mcap.records import Buffer

RESERVE_BYTES: Final = 8 << 20
"""kept from other writers on the disk, so that a full disk still lets the summary be written"""


class PageCacheFile:
    """See DataFile. The kernel is made to write every `sync_bytes`, so that it never has seconds of them to write.

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

    def has_room(self, size: int, *, image: bool, lent: int = 0) -> bool:  # noqa: ARG002 - `append` waits, or says that the disk is full
        """See DataFile."""
        return True

    def append_lent(self, run: LentRun) -> int:
        """See DataFile."""
        length = self.append([run.lead, *itertools.chain.from_iterable(zip(run.lent, run.behind, strict=True))])
        for release in run.release:
            release()
        return length

    def append(self, buffers: Sequence[Buffer], *, image: bool = False) -> int:  # noqa: ARG002 - the reserve is another file's
        """See DataFile."""
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
        """See DataFile."""
        if self._reserve is not None:
            os.close(self._reserve)
            self._reserve = None

    def wait_until(self, size: int) -> None:
        """See DataFile: it is there already."""

    def sync(self) -> None:
        """See DataFile."""
        if self.size - self._synced >= self._sync_bytes:
            self._synced = self.size
            with contextlib.suppress(OSError):  # reported again by the fsync in finish
                os.fdatasync(self._fd)

    def finish(self) -> None:
        """See DataFile."""
        try:
            os.fsync(self._fd)
        finally:
            self.abort()

    def abort(self) -> None:
        """See DataFile."""
        self.release_reserve()
        os.close(self._fd)
