"""Report on a session that has closed its recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class SessionReport:
    """Files and counts (strikes, frames) of a session that has closed its recording."""

    path: Path
    """path of the recording; `files` lists all of its files"""
    files: tuple[Path, ...]
    """files of the recording; more than one if the capture process died on the way"""
    strikes: int
    """number of strikes whose record is in the recording"""
    frames: int
    """number of frames recorded"""
    lost: int
    """number of frames lost"""
    aborted: bool
    """True if the session ended before its last planned strike"""
    text: str
    """reason if the session was aborted"""
