"""System calls of direct I/O (O_DIRECT): allocate disk space, write whole pages, test for support."""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
from pathlib import Path
from typing import Final

from acquire.frames.page_memory import PAGE_BYTES
from acquire.recorder import atomic

MOST_VIEWS: Final = 1024
"""greatest number of buffers of one write: IOV_MAX of Linux"""
_FALLOC_FL_KEEP_SIZE: Final = 1

_libc = ctypes.CDLL(None, use_errno=True)


def allocate(fd: int, offset: int, size: int) -> None:
    """Allocate `size` bytes of disk space from `offset` on, without changing the file's length.

    fallocate(2) is called, because os.posix_fallocate changes the length, and writes zeros on file systems
    that cannot allocate.

    Raises:
        OSError: the disk is full, or the file system cannot allocate.
    """
    if _libc.fallocate(fd, _FALLOC_FL_KEEP_SIZE, ctypes.c_int64(offset), ctypes.c_int64(size)) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def can_write_directly(folder: Path) -> bool:
    """True if the file system of `folder` accepts O_DIRECT writes and allocates space in advance."""
    try:
        fd = os.open(folder, os.O_TMPFILE | os.O_WRONLY | os.O_DIRECT | os.O_CLOEXEC, 0o600)
    except OSError:
        return False
    try:
        allocate(fd, 0, 4 * PAGE_BYTES)
        with mmap.mmap(-1, PAGE_BYTES) as page:
            return os.pwrite(fd, page, PAGE_BYTES) == PAGE_BYTES
    except OSError:
        return False
    finally:
        os.close(fd)


def write_pages(fd: int, views: list[memoryview], offset: int) -> None:
    """Write the whole pages in `views` to the file of descriptor `fd`, from `offset` [bytes] on.

    Raises:
        OSError: the disk is full or failing.
    """
    while views:
        first = views[:MOST_VIEWS]
        taken = os.pwritev(fd, first, offset)
        if taken == sum(map(len, first)):
            offset += taken
            views = views[MOST_VIEWS:]
            continue
        taken -= taken % PAGE_BYTES  # a partly written page is written again
        if taken == 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        offset += taken
        views = atomic.remaining(views, taken)
