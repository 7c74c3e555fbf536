"""The station, and strikes that are turned on it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from analyze.types import CameraModel


def turned_camera(camera: CameraModel, heading: float) -> CameraModel:
    """The camera as it stands in W turned by `heading` [rad] about z, in which a strike with a heading is written down."""
    if heading == 0.0:
        return camera
    turn = np.eye(4)
    turn[:2, :2] = [[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]]
    return replace(camera, T_world_camera=turn @ camera.T_world_camera)
