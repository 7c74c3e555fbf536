"""Observations of one marker in the frames so far, and the place where it is expected next."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.tracking.edges import SquareFit
    from analyze.types import Array, Marker


@dataclass(frozen=True)
class FoundMarker:
    """Marker found in one frame: fit of its black square, and corners (4, 2) in the distorted image [px]."""

    fit: SquareFit
    """the fitted square"""
    corners_raw: Array
    """(4, 2) corners [raw px]"""


@dataclass
class MarkerPath:
    """Observations of one marker so far: log times [ns] and corners of the frames in which it was found.

    Corners are given twice: raw px as in the image, and ideal px, free of lens distortion.
    """

    marker: Marker
    """the marker"""
    time_ns: list[int] = field(default_factory=list)
    """log times of the frames in which it was found [ns]"""
    corners_raw: list[Array] = field(default_factory=list)
    """(4, 2) corners in each frame of `time_ns` [raw px]"""
    corners_ideal: list[Array] = field(default_factory=list)
    """(4, 2) corners in each frame of `time_ns` [ideal px]"""
    sd: list[float] = field(default_factory=list)
    """standard deviation of the corners in each frame of `time_ns` [px]"""
    missed: int = 0
    """number of frames since it was last found"""
    fit: SquareFit | None = None
    """the newest fit; None if there is none"""

    def predict(self, time_ns: int) -> tuple[Array, Array, float]:
        """Expected corners of the marker, (4, 2) [raw px] and (4, 2) [ideal px], and their uncertainty [px].

        Raw pixels are those of the image, ideal ones are free of lens distortion. The corners move on at the
        velocity of the last two observations, by at most four times the motion between these. After a single
        observation they stay in its place, with an uncertainty of 4 px. The marker must have been found at
        least once.

        Args:
            time_ns: log time of the frame for which the corners are expected [ns].
        """
        raw, ideal = self.corners_raw[-1], self.corners_ideal[-1]
        if len(self.time_ns) < 2:
            return raw, ideal, 4.0
        step = self.time_ns[-1] - self.time_ns[-2]
        ratio = min((time_ns - self.time_ns[-1]) / step, 4.0) if step > 0 else 0.0
        move = (raw - self.corners_raw[-2]) * ratio
        moved = ideal + (ideal - self.corners_ideal[-2]) * ratio
        return raw + move, moved, 6.0 + 1.5 * float(np.abs(move).max()) + 4.0 * self.missed
