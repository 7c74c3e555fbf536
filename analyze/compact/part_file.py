"""The unfinished copy beside a recording's file: one process at a time, and never the recording itself."""

from __future__ import annotations

import fcntl
import os
import shutil
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from analyze.errors import CompactError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


def part_path(path: Path) -> Path:
    """Path of the unfinished copy of a file; the name is no recording's."""
    return path.with_name(f".{path.name}.compact")


@contextmanager
def locked_part(path: Path) -> Iterator[int]:
    """Create, or empty, the unfinished copy of a file; yield it open for writing, and remove it afterwards.

    What a killed run left is written anew. If it was given its final name meanwhile, nothing is removed.

    Args:
        path: final path of the copy.

    Raises:
        CompactError: another process compacts the file.
        OSError: it cannot be created.
    """
    part = part_path(path)
    while True:
        fd = os.open(part, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(fd)
            raise CompactError(f"{path}: another process is compacting it: wait for that") from None
        if _is_at(part, fd):
            break
        os.close(fd)  # it has become the recording
    try:
        os.ftruncate(fd, 0)
        yield fd
    finally:
        if _is_at(part, fd):
            with suppress(OSError):
                part.unlink()
        os.close(fd)


def publish(target: Path, fd: int) -> None:
    """Give a copy the name of the file that it replaces, forced to the disk.

    It takes over owner, permissions, times, and the extended attributes that the file system has room for.

    Args:
        target: file to be replaced.
        fd: the copy, open.

    Raises:
        CompactError: the copy is no longer there, or cannot be given to the file's owner.
        OSError: it cannot be renamed.
    """
    owner, own = target.stat(), os.fstat(fd)
    if (owner.st_uid, owner.st_gid) != (own.st_uid, own.st_gid):
        try:
            os.fchown(fd, owner.st_uid, owner.st_gid)
        except PermissionError:
            raise CompactError(
                f"{target}: belongs to user {owner.st_uid}, group {owner.st_gid}: compact it as that user"
            ) from None
    shutil.copystat(target, f"/proc/self/fd/{fd}")
    os.fsync(fd)
    if not _is_at(part_path(target), fd):
        raise CompactError(f"{target}: its copy {part_path(target).name} was removed meanwhile: run it again")
    part_path(target).replace(target)
    with suppress(OSError):  # the disk has one of the two in any case
        folder = os.open(target.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _is_at(part: Path, fd: int) -> bool:
    """True if the open file is the one of this name."""
    try:
        return os.path.samestat(part.stat(), os.fstat(fd))
    except FileNotFoundError:
        return False
