"""Points of an object's print in the images of a strike, as they were followed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.tracking.camera_model import distort

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.tracking.print_follower import PrintPose
    from analyze.types import CameraModel, IntArray

_MOST = 250
"""largest number of points that are kept"""


@dataclass(frozen=True)
class PrintPoints:
    """Some of the points by which a strike was followed."""

    time_ns: IntArray
    """(n,) log times of the images [ns]"""
    pixels: NDArray[np.float32]
    """(n, k, 2) places in the images [px]"""
    explained: NDArray[np.float32]
    """(n, k) share of the grey value that is explained, 0 to 1; NaN where a point is out of view"""


def print_points(time_ns: IntArray, poses: Sequence[PrintPose], camera: CameraModel) -> PrintPoints:
    """A sample of the template's points in all images; every image has the same points.

    Args:
        time_ns: (n,) log times of the images [ns].
        poses: (n,) poses by one template.
        camera: camera that took the images.
    """
    every = max(1, math.ceil(len(poses[0].pixels) / _MOST))
    ideal = np.array([pose.pixels[::every] for pose in poses])
    explained = np.array([pose.explained_points[::every] for pose in poses])
    return PrintPoints(time_ns, distort(camera, ideal).astype(np.float32), explained.astype(np.float32))
