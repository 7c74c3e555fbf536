"""Observations of one marker in the frames so far, and the place where it is expected next."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.tracking.edges import SquareFit
    from analyze.types import Array, Marker

_NEARER = 1.25
"""largest scale in the image of a body's nearest parts over that of a marker on it"""


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


def marker_spread(markers: Sequence[Marker]) -> dict[int | str, float]:
    """Largest distance in the image from each marker's centre to another's corners, in its longest edges.

    Empty if a marker's place on the body is not known, or there is only one.
    """
    poses = [marker.T_object_marker for marker in markers]
    if len(markers) < 2 or any(pose is None for pose in poses):
        return {}
    centres = np.array([pose[:3, 3] for pose in poses if pose is not None])
    apart = np.linalg.norm(centres[:, None] - centres, axis=-1)
    sizes = np.array([marker.size for marker in markers])
    # A marker's corner is 0.71 of its edge off its centre; half an edge more is left around it.
    reach = _NEARER * (apart + 0.71 * sizes).max(axis=1) / sizes + 0.5
    return {marker.id: float(each) for marker, each in zip(markers, reach, strict=True)}
