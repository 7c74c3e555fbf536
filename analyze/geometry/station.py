"""Camera of the station in the world frame of a turned strike."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from analyze.types import CameraModel


def turned_camera(camera: CameraModel, heading: float) -> CameraModel:
    """Camera in the frame W of a strike whose object and striker are turned by `heading` [rad] about z."""
    if heading == 0.0:
        return camera
    turn = np.eye(4)
    turn[:2, :2] = [[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]]
    return replace(camera, T_world_camera=turn @ camera.T_world_camera)
