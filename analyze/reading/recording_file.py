"""Find a recording's file, and whether it is still being written; without slow imports."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import RecordingCut, RecordingError
from analyze.reading.not_a_recording import not_a_recording
from schemas.input_file import open_file

_MAGIC = b"\x89MCAP0\r\n"
_PART = ".part"
STILL_S = 10.0
"""Time without a write after which a file counts as complete [s]: the recorder writes several clock samples a
second."""


@dataclass(frozen=True)
class RecordingFile:
    """File of a recording, and whether it is still being written."""

    path: Path
    """path of the file that exists"""
    growing: bool
    """True if the file is still being written."""


def find_recording(file: Path) -> RecordingFile:
    """Find the file of a recording: NAME.mcap may still be NAME.mcap.part, or the reverse.

    Args:
        file: path as the user gave it.

    Returns:
        The file that exists; it counts as growing if it is a `.part` file written to within 10 s.

    Raises:
        RecordingError: the file does not exist, cannot be read, is empty and no longer written to, or is not
            a recording.
    """
    path = existing_file(file)
    try:
        with open_file(path) as stream:
            head = stream.read(len(_MAGIC))
    except FileNotFoundError:
        raise RecordingError(f"{file}: no such recording: check the path") from None
    except IsADirectoryError:
        raise RecordingError(not_a_recording(path)) from None
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror}") from None
    growing = path.suffix == _PART and is_fresh(path)
    if not head and not growing:
        raise RecordingCut(f"{file}: is empty: nothing of this recording can be recovered: record again")
    if head[: len(_MAGIC)] != _MAGIC[: len(head)]:
        raise RecordingError(not_a_recording(path))
    return RecordingFile(path, growing)


def existing_file(file: Path) -> Path:
    """Path of the file that exists: NAME.mcap may still be NAME.mcap.part, or the reverse; else `file`."""
    if file.exists():
        return file
    other = file.with_suffix("") if file.suffix == _PART else file.with_name(file.name + _PART)
    return other if other.exists() else file


def is_growing(path: Path, before: os.stat_result) -> bool:
    """True if an unfinished file is being written: it changed while it was read, or is a fresh `.part` file.

    Args:
        path: the file.
        before: its state before it was read.
    """
    if path.suffix == _PART and is_fresh(path):
        return True
    try:
        after = path.stat()
    except OSError:
        return False
    return (after.st_size, after.st_mtime_ns) != (before.st_size, before.st_mtime_ns)


def is_fresh(path: Path) -> bool:
    """True if the file, with suffix `.part`, is probably still being written.

    It then was written to within the last 10 s, or no longer exists because it was just given its final name.
    """
    try:
        return time.time() - path.stat().st_mtime < STILL_S
    except FileNotFoundError:
        return path.with_suffix("").exists()
    except OSError:
        return False
