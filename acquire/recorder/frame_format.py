"""Size and rate of a camera's frames."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FrameFormat:
    """Name, image size and frame rate of one camera, constant during a recording."""

    camera: str
    width: int
    height: int
    frame_rate_hz: float

    @property
    def image_bytes(self) -> int:
        """Size of a mono8 image in bytes."""
        return self.width * self.height
