"""Size and rate of a camera's frames."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FrameFormat:
    """Camera name, image width and height [px] and frame rate [Hz], constant during a recording."""

    camera: str
    width: int
    height: int
    frame_rate_hz: float

    @property
    def image_bytes(self) -> int:
        """Size of one mono8 image (width * height) in bytes."""
        return self.width * self.height
