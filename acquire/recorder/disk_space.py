"""Check of the free disk space before a recording or a window (time span of a strike) begins.

A disk that fills up later ends the images of a recording, but its file is still completed (writer.py).
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from acquire.errors import RecorderError


def free_bytes(folder: Path) -> int:
    """Number of bytes that this user may still write on the disk of `folder`.

    Raises:
        RecorderError: the folder does not exist or cannot be accessed.
    """
    try:
        return shutil.disk_usage(folder).free
    except OSError as error:
        raise RecorderError(f"{folder}: cannot be used: {error.strerror}: create the folder first") from None


@dataclass(frozen=True)
class DiskSpace:
    """Check of the free space on the disk of one folder, before a recording or a strike's window begins."""

    folder: Path
    """existing folder on the disk"""
    reserve_bytes: int
    """space that must stay free [bytes]"""
    probe: Callable[[Path], int] = free_bytes
    """function that returns the free space of a folder's disk [bytes]"""

    def require(self, needed_bytes: int, purpose: str) -> None:
        """Raise RecorderError if `needed_bytes` more would leave less than `reserve_bytes` free on the disk.

        Args:
            needed_bytes: size of the planned output [bytes].
            purpose: name of the planned output in the error's text, for example "a window".

        Raises:
            RecorderError: too little space is free, or the folder cannot be accessed.
        """
        free = self.probe(self.folder)
        if free - needed_bytes < self.reserve_bytes:
            raise RecorderError(
                f"{self.folder}: {purpose} needs {_text(needed_bytes)} and {_text(self.reserve_bytes)} "
                f"are kept back (disk_reserve_bytes), but only {_text(free)} are free on this disk: "
                "free some space"
            )


def _text(size: int) -> str:
    return f"{size / 1e9:.2f} GB" if size >= 1e7 else f"{size / 1e6:.2f} MB"
