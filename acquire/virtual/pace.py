"""Whether the computer kept up with the virtual rig, whose world and camera run in real time."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

_WORLD_S = 0.05
"""delay of the world [s] from which on the servo answers and brakes too late"""
_CAMERA_S = 0.5
"""delay of an image [s] from which on the session has to wait for images"""


@dataclass(frozen=True)
class Pace:
    """Largest delays of a virtual rig behind real time."""

    world_s: float
    """largest delay of the simulated world, which the servo's answers share [s]"""
    camera_s: float
    """largest delay of an image after the end of its exposure [s]"""

    def note(self) -> str | None:
        """Line for the user if the computer was too busy; None if it kept up."""
        late = []
        if self.world_s > _WORLD_S:
            late.append(f"the simulated world ran up to {self.world_s:.1f} s late")
        if self.camera_s > _CAMERA_S:
            late.append(f"images came up to {self.camera_s:.1f} s late")
        if not late:
            return None
        return (
            f"this computer was too busy: {' and '.join(late)}; servo faults, second contacts and repeated "
            "strikes may come from that: close other programs, and run it again"
        )


def read_pace(folder: Path) -> Pace:
    """Delays of a virtual rig that has ended, from the files that its processes wrote; 0 without a file.

    Args:
        folder: folder of the rig's files.
    """
    return Pace(_latest_s(folder / "world.json"), _latest_s(folder / "camera.json"))


def _latest_s(path: Path) -> float:
    try:
        return float(json.loads(path.read_text(encoding="utf-8"))["latest_ms"]) / 1000
    except (OSError, ValueError, KeyError, TypeError):
        return 0.0
