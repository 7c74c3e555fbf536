"""Where the recording to be replayed lies, found before anything is loaded that takes time."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import RecordingCut, RecordingError

_MAGIC = b"\x89MCAP0\r\n"
_PART = ".part"
STILL_S = 10.0
"""a file that has not been written to for so long is written no more: the recorder writes clock samples several times a second"""


@dataclass(frozen=True)
class Place:
    """A recording's file."""

    path: Path
    growing: bool
    """somebody is writing it"""


def find(file: Path) -> Place:
    """The file to read for the name that was given: NAME.mcap may still be NAME.mcap.part.

    Raises:
        RecordingError: there is none, or it is no recording.
    """
    path = file
    if not file.exists() and file.suffix != _PART and (part := file.with_name(file.name + _PART)).exists():
        path = part
    elif not file.exists() and file.suffix == _PART and file.with_suffix("").exists():
        path = file.with_suffix("")
    try:
        with path.open("rb") as stream:
            head = stream.read(len(_MAGIC))
    except FileNotFoundError:
        raise RecordingError(f"{file}: no such recording: check the path") from None
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror}") from None
    growing = path.suffix == _PART and is_fresh(path)
    if not head and not growing:
        raise RecordingCut(f"{file}: is empty: nothing of this recording can be saved: record again")
    if head[: len(_MAGIC)] != _MAGIC[: len(head)]:
        raise RecordingError(f"{file}: is not a recording: it does not begin like an MCAP file")
    return Place(path, growing)


def is_fresh(path: Path) -> bool:
    """Whether the file was written to within the last `STILL_S`, or has just been given its final name."""
    try:
        return time.time() - path.stat().st_mtime < STILL_S
    except FileNotFoundError:
        return path.with_suffix("").exists()
    except OSError:
        return False
