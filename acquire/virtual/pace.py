"""Whether the computer kept up with the virtual rig, whose world and camera run in real time."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.wording import counted

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
    unsent: int = 0
    """number of images that were never drawn, as the camera was opened anew while they were late"""

    def note(self) -> str | None:
        """Line for the user if the computer was too busy; None if it kept up."""
        late = []
        if self.world_s > _WORLD_S:
            late.append(f"the simulated world ran up to {self.world_s:.1f} s late")
        if self.camera_s > _CAMERA_S:
            late.append(f"images came up to {self.camera_s:.1f} s late")
        if not late:
            return None
        unsent = ""
        if self.unsent:
            unsent = (
                f"{counted(self.unsent, 'late image', 'was')} never sent, because the camera was opened "
                "anew, and count as lost; "
            )
        return (
            f"this computer was too busy: {' and '.join(late)}; {unsent}servo faults, second contacts and "
            "repeated strikes may come from that: close other programs, and run it again"
        )


def read_pace(folder: Path) -> Pace:
    """Delays of a virtual rig that has ended, from the files that its processes wrote; 0 without a file.

    Args:
        folder: folder of the rig's files.
    """
    world, camera = folder / "world.json", folder / "camera.json"
    return Pace(
        _figure(world, "latest_ms") / 1000,
        _figure(camera, "latest_ms") / 1000,
        int(_figure(camera, "unsent")),
    )


def _figure(path: Path, name: str) -> float:
    try:
        return float(json.loads(path.read_text(encoding="utf-8"))[name])
    except (OSError, ValueError, KeyError, TypeError):
        return 0.0
