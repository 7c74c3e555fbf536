"""Files that appear whole or not at all: write under another name, fsync, rename."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from acquire.errors import RecorderError
from schemas.mcap.records import Buffer
from schemas.output_file import why_unwritable

_IOV_MAX = 1024
"""buffers that writev takes at once on Linux"""


def refuse_unwritable(path: Path) -> None:
    """Raise RecorderError unless a file may be made at `path`; early, before the work for it begins."""
    if (reason := why_unwritable(path)) is not None:
        raise RecorderError(reason)


def refuse_taken(path: Path) -> None:
    """Raise RecorderError if `path` exists."""
    if path.exists():
        raise RecorderError(f"{path}: exists already: choose another name or move it away")


def create_part(part_path: Path, flags: int = 0) -> int:
    """Open `part_path`, which must not exist, for writing; `flags` are open(2)'s.

    Raises:
        RecorderError: it exists, or the folder cannot be written.
    """
    try:
        return os.open(part_path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | flags, 0o644)
    except FileExistsError:
        raise RecorderError(f"{part_path}: left by a recording that did not finish: `acquire recover` it or move it away") from None
    except OSError as error:
        raise RecorderError(f"{part_path}: cannot be created: {error.strerror}: check the folder") from None


def reserve(folder: Path, size: int) -> int | None:
    """Hold `size` bytes of the disk in a file without a name; closing the descriptor gives them back. None where that cannot be had."""
    try:
        fd = os.open(folder, os.O_TMPFILE | os.O_WRONLY | os.O_CLOEXEC, 0o600)
    except OSError:
        return None
    try:
        os.posix_fallocate(fd, 0, size)
    except OSError:
        os.close(fd)
        return None
    return fd


def write_all(fd: int, buffers: Sequence[Buffer]) -> int:
    """Write every byte of `buffers` without joining them; returns their number.

    Raises:
        OSError: the disk is full or failing; some bytes may be written.
    """
    total = sum(map(len, buffers))
    left = total
    while left:
        taken = os.writev(fd, buffers[:_IOV_MAX])
        left -= taken
        if left:
            buffers = behind(buffers, taken)
    return total


def behind(buffers: Sequence[Buffer], taken: int) -> list[memoryview]:
    """What is left of `buffers` when their first `taken` bytes are written."""
    for number, buffer in enumerate(buffers):
        if taken < len(buffer):
            return [memoryview(buffer)[taken:], *map(memoryview, buffers[number + 1 :])]
        taken -= len(buffer)
    return []


def publish(part_path: Path, path: Path) -> None:
    """Give a finished, fsynced file its name, without ever replacing another one.

    Raises:
        RecorderError: `path` was taken meanwhile.
    """
    try:
        os.link(part_path, path)
        part_path.unlink()
    except FileExistsError:
        raise RecorderError(f"{path}: was created by somebody else meanwhile: the recording is whole in {part_path}") from None
    except OSError:
        # File systems without hard links (FAT, some network ones): the check and the rename are two steps there.
        part_path.rename(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Make a rename in `folder` outlast a power cut."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
