"""Files that appear complete or not at all: write under another name, fsync, rename."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from acquire.errors import RecorderError
from schemas.mcap.records import Buffer
from schemas.output_file import why_taken, why_unwritable

_IOV_MAX = 1024
"""greatest number of buffers of one writev on Linux"""


def refuse_unwritable(path: Path, *inputs: Path) -> None:
    """Raise RecorderError if no file can be created at `path`; called before the file's content is made.

    Raises:
        RecorderError: `path` is a folder or one of the `inputs`, or its folder is missing or not writable.
    """
    if (reason := why_unwritable(path, *inputs)) is not None:
        raise RecorderError(reason)


def refuse_taken(path: Path, *, force: bool | None = None) -> None:
    """Raise RecorderError if `path` exists and is not to be replaced.

    Args:
        path: file to be written.
        force: value of the command's option --force; None if it has none.
    """
    if (reason := why_taken(path, force=force)) is not None:
        raise RecorderError(reason)


def create_part(part_path: Path, flags: int = 0) -> int:
    """Create the new file `part_path` (temporary name of an output) for writing.

    Args:
        part_path: path at which no file exists yet.
        flags: further flags of open(2), for example O_DIRECT.

    Returns:
        Descriptor of the open file.

    Raises:
        RecorderError: the file exists already, or cannot be created in its folder.
    """
    try:
        return os.open(part_path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | flags, 0o644)
    except FileExistsError:
        raise RecorderError(
            f"{part_path}: left by a recording that did not finish: "
            "run `acquire recover` on it, or move it away"
        ) from None
    except OSError as error:
        raise RecorderError(f"{part_path}: cannot be created: {error.strerror}: check the folder") from None


def reserve(folder: Path, size: int) -> int | None:
    """Reserve `size` bytes on the disk of `folder` in an unnamed file, until its descriptor is closed.

    Returns:
        Descriptor of the unnamed file; None if no such file can be created in `folder` or the disk has too
        little space.
    """
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
    """Write all bytes of `buffers` to the descriptor `fd` without joining them.

    Returns:
        Number of bytes written.

    Raises:
        OSError: the disk is full or failing; some bytes may be written.
    """
    total = sum(map(len, buffers))
    left = total
    while left:
        taken = os.writev(fd, buffers[:_IOV_MAX])
        left -= taken
        if left:
            buffers = remaining(buffers, taken)
    return total


def remaining(buffers: Sequence[Buffer], taken: int) -> list[memoryview]:
    """Views of the bytes of `buffers` after the first `taken` bytes; an empty list if none are left."""
    for number, buffer in enumerate(buffers):
        if taken < len(buffer):
            return [memoryview(buffer)[taken:], *map(memoryview, buffers[number + 1 :])]
        taken -= len(buffer)
    return []


def publish(part_path: Path, path: Path, *, replace: bool = False) -> None:
    """Give a finished, fsynced file its final name, and make the rename survive a power cut.

    Without `replace`, another file at `path` is never replaced where the file system has hard links.
    Elsewhere (FAT, some network file systems) one that another program created there meanwhile is replaced.

    Args:
        part_path: temporary name.
        path: final name, in the same folder.
        replace: True to replace a file at `path`.

    Raises:
        RecorderError: a file exists at `path`; the new file keeps its temporary name.
        OSError: the file cannot be renamed, or the folder cannot be written to the disk.
    """
    try:
        if replace:
            part_path.replace(path)
        else:
            os.link(part_path, path)
            part_path.unlink()
    except FileExistsError:
        raise RecorderError(
            f"{path}: another program created it meanwhile: the complete recording is {part_path}"
        ) from None
    except OSError:
        # File systems without hard links (FAT, some network ones): a rename there replaces a file created
        # since `path` was last checked.
        part_path.rename(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Make renames in `folder` survive a power cut: fsync the folder.

    Raises:
        OSError: the folder is missing, or the disk refuses.
    """
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
