"""Strikes by hand, filmed by a phone: placement of the phone, and the limits of a hand as a striker."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.distance import pdist

from analyze.cameras.camera_file import read_camera
from analyze.geometry.object_model import ObjectModel
from analyze.planning.examine import Bench
from analyze.planning.impact import HAND
from analyze.tracking.camera_model import camera_from_spec
from analyze.types import Array, CameraModel

SEEN_WIDTH, SEEN_HEIGHT = 1.35, 1.15
"""width and height that the image shows at the pivot, in largest lengths of the object: it then stays in the
image from rest past its balance, on whichever face it rests"""
MIDDLE_X, MIDDLE_Z = 0.1, 0.45
"""place of the camera beside the pivot line and above the table, in largest lengths of the object"""


def phone_bench(camera_path: Path, model: ObjectModel, bench: Bench) -> Bench:
    """Bench (striker, camera, friction, gravity) of strikes by hand, with the lens of a camera file.

    A camera file with T_world_camera keeps its pose; otherwise the camera looks along y of the world frame,
    the line about which objects tip, from where the object, tipping on any face, just fills the image.

    Args:
        camera_path: camera file (of `analyze calibrate -o`, OpenCV, Kalibr or ROS).
        model: shape of the object.
        bench: bench of which friction, gravity and frame rate are kept.

    Raises:
        CalibrationError, DocumentError: the camera file cannot be used.
    """
    file = read_camera(camera_path)
    camera = camera_from_spec(file.calibration)
    if not file.placed:
        camera = replace(camera, T_world_camera=_pose_before(model, camera))
    return replace(bench, striker=HAND, camera=camera)


def _pose_before(model: ObjectModel, camera: CameraModel) -> Array:
    """Camera's pose (4, 4) [m] in the world frame: an object that tips on any face just fills the image."""
    length = float(pdist(model.hull_vertices).max())
    across, down = camera.K[0, 0] / camera.width, camera.K[1, 1] / camera.height
    # From the nearest end of the object, which lies half its length before the mark at most.
    away = length * max(SEEN_WIDTH * across, SEEN_HEIGHT * down) + length / 4
    pose = np.eye(4)
    pose[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    pose[:3, 3] = MIDDLE_X * length, -np.ceil(100 * away) / 100, MIDDLE_Z * length
    return pose
