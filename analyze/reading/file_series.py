"""Finds the files of one recording: a series NAME.mcap, NAME-0002.mcap, ..., each readable by itself.

A recording has several files if it is continuous, or if the process that wrote it died and another continued.
The user names any one of them, and the others are found. A file belongs to the series if its manifest has the
same `recording_id` and, as `part`, the number in its name; an older file of that name does not belong to it,
nor does a renamed one.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading.followed_recording import PART_SUFFIX, FollowedRecording
from schemas.session_manifest import SessionManifest


@dataclass(frozen=True)
class SeriesFiles:
    """Files of one recording that are in one folder, and the numbers of those that are missing."""

    files: tuple[Path, ...]
    """files in their order; an unfinished one ends in `.part`"""
    missing: tuple[int, ...] = ()
    """numbers below the last file's for which no file was found"""


def final_path(path: Path) -> Path:
    """Path that a `.part` file (being written) will have when it is finished; any other path unchanged."""
    return path.with_suffix("") if path.suffix == PART_SUFFIX else path


def missing_files_text(numbers: Sequence[int]) -> str:
    """Words that name a recording's missing files by number, such as "files 2, 3 of this recording"."""
    names = ", ".join(str(number) for number in numbers)
    return f"file {names} of this recording" if len(numbers) == 1 else f"files {names} of this recording"


def find_series_files(path: Path) -> SeriesFiles:
    """Find the files of the recording that `path` belongs to, in the same folder.

    Only `path` itself is returned if it does not exist or has no readable manifest (description of the
    session). The same holds if it was renamed, so that its name lacks its number (2 or more); all lower
    numbers then count as missing. If a number has a finished and an unfinished file, the finished one is
    returned, unless `path` is the other.

    Returns:
        The files in their order, and the numbers of missing ones.
    """
    ours = _manifest(path)
    if ours is None:
        return SeriesFiles((path,))
    final = final_path(path)
    stem = final.stem.removesuffix(f"-{ours.part:04d}") if ours.part > 1 else final.stem
    if stem == final.stem and ours.part > 1:  # renamed
        return SeriesFiles((path,), tuple(range(1, ours.part)))
    found = {ours.part: path}
    for number, file in _candidates(path.parent, stem, final.suffix):
        if number != ours.part and (number not in found or file.suffix != PART_SUFFIX):
            head = _manifest(file)
            if head is not None and (head.recording_id, head.part) == (ours.recording_id, number):
                found[number] = file
    missing = tuple(number for number in range(1, max(found)) if number not in found)
    return SeriesFiles(tuple(found[number] for number in sorted(found)), missing)


def _candidates(folder: Path, stem: str, suffix: str) -> list[tuple[int, Path]]:
    """Number and path of every file, finished or not, whose name fits a series.

    Empty if the folder cannot be listed. The files' manifests are not read.

    Args:
        folder: folder of the series.
        stem: name of the series' first file, without suffix.
        suffix: suffix of the series' finished files.
    """
    pattern = re.compile(
        rf"{re.escape(stem)}(?:-(\d{{4,}}))?{re.escape(suffix)}(?:{re.escape(PART_SUFFIX)})?"
    )
    try:
        names = os.listdir(folder)  # noqa: PTH208 - of thousands of files, paths are made for few
    except OSError:  # a folder that may be entered, but not listed
        return []
    matches = [pattern.fullmatch(name) for name in sorted(names) if name.startswith(stem)]
    return [(int(match[1] or 1), folder / match[0]) for match in matches if match]


def _manifest(path: Path) -> SessionManifest | None:
    """Manifest (description of the session) of the file at `path`; None if it cannot be read."""
    if path.suffix == PART_SUFFIX and not path.exists():
        return None  # FollowedRecording would open the finished file of that name
    with contextlib.suppress(RecordingError, ValueError), FollowedRecording(path) as file:
        return file.read_manifest()
    return None
