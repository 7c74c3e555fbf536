"""Report on a session that has closed its recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from schemas.wording import counted


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
    """reason if the session was aborted, or stopped itself"""
    skipped: tuple[str, ...] = ()
    """ids of planned strikes that were given up, because the object was never found as it should stand"""
    tosses: int = 0
    """number of tosses whose record is in the recording"""
    missed: bool = False
    """True if the session ended without the precision that it was to reach"""

    @property
    def complaint(self) -> str:
        """Line that states why the session did not do all planned strikes; empty if it did."""
        if self.aborted:
            return f"the session ended early: {self.text}"
        if self.missed:
            return f"the target was not reached: {self.text}"
        if self.strikes == 0 and self.tosses == 0:
            return (
                "no strike was made: every placement was refused: "
                "glue a tag on each side that faces the camera, and list it in the object file"
            )
        if self.skipped:
            return (
                f"{counted(len(self.skipped), 'planned strike')} given up ({', '.join(self.skipped)}): every "
                "placement was refused, the lines above say why: plan and strike them again"
            )
        return ""
