"""Which files are one recording: a row NAME.mcap, NAME-0002.mcap, NAME-0003.mcap, ..., each whole by itself.

A recording becomes a row where it is continuous, and where the process that wrote it died and another went on. Any file of the row
stands for all of it. A file belongs to it when its manifest carries the row's `recording_id` and, as `part`, the number in its name; so an
older file of the same name does not, and neither does one that was renamed.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading.followed_recording import PART_SUFFIX, FollowedRecording
from schemas.session_manifest import SessionManifest


@dataclass(frozen=True)
class FileRow:
    """The files of one recording that lie beside each other."""

    files: tuple[Path, ...]
    """in their order; `.part` where one is not whole"""
    missing: tuple[int, ...] = ()
    """numbers before the last one's of which there is no file"""


def whole_name(path: Path) -> Path:
    """The name that a `.part` file has once it is whole."""
    return path.with_suffix("") if path.suffix == PART_SUFFIX else path


def missing_text(numbers: Sequence[int]) -> str:
    """Which files of a row are not there, for people."""
    names = ", ".join(str(number) for number in numbers)
    return f"file {names} of this recording" if len(numbers) == 1 else f"files {names} of this recording"


def row_of(path: Path) -> FileRow:
    """The row that `path` is of; of a file that has no manifest, that file alone."""
    ours = _head(path)
    if ours is None:
        return FileRow((path,))
    whole = whole_name(path)
    stem = whole.stem.removesuffix(f"-{ours.part:04d}") if ours.part > 1 else whole.stem
    if stem == whole.stem and ours.part > 1:  # renamed
        return FileRow((path,), tuple(range(1, ours.part)))
    found = {ours.part: path}
    for number, file in _named_alike(path.parent, stem, whole.suffix):
        if number != ours.part and (number not in found or file.suffix != PART_SUFFIX):
            head = _head(file)
            if head is not None and (head.recording_id, head.part) == (ours.recording_id, number):
                found[number] = file
    missing = tuple(number for number in range(1, max(found)) if number not in found)
    return FileRow(tuple(found[number] for number in sorted(found)), missing)


def _named_alike(folder: Path, stem: str, suffix: str) -> list[tuple[int, Path]]:
    """(number, file) of every file that the row `stem` may have, whole or not."""
    pattern = re.compile(rf"{re.escape(stem)}(?:-(\d{{4,}}))?{re.escape(suffix)}(?:{re.escape(PART_SUFFIX)})?")
    try:
        files = sorted(folder.iterdir())
    except OSError:  # a folder that may be entered, but not listed
        return []
    matches = [(pattern.fullmatch(file.name), file) for file in files]
    return [(int(match[1] or 1), file) for match, file in matches if match]


def _head(path: Path) -> SessionManifest | None:
    if path.suffix == PART_SUFFIX and not path.exists():
        return None  # a follower would take the whole file of that name
    with contextlib.suppress(RecordingError, ValueError), FollowedRecording(path) as file:
        return file.peek()
    return None
