"""Points of an object's print in the images of a strike, as they were followed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.tracking.camera_model import distort

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.tracking.print_follower import PrintPose
    from analyze.types import Array, CameraModel, IntArray

_KEPT = 250
"""number of points that are kept, about"""


@dataclass(frozen=True)
class PrintPoints:
    """Some of the points by which a strike was followed."""

    time_ns: IntArray
    """(n,) log times of the images [ns]"""
    pixels: Array
    """(n, k, 2) places in the images [px]"""
    explained: Array
    """(n, k) share of the grey value that is explained, 0 to 1; NaN where a point is out of view"""


def print_points(time_ns: IntArray, poses: Sequence[PrintPose], camera: CameraModel) -> PrintPoints:
    """Some of the points of all frames, of which each has the same.

    Args:
        time_ns: (n,) log times [ns].
        poses: poses of one pass over these frames.
        camera: camera that took the images.
    """
    every = max(1, len(poses[0].pixels) // _KEPT)
    ideal = np.array([pose.pixels[::every] for pose in poses])
    explained = np.array([pose.explained_points[::every] for pose in poses])
    return PrintPoints(time_ns, distort(camera, ideal).astype(np.float32).astype(np.float64), explained)
