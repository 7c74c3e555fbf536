"""Pose of the rig's camera in the world frame of a strike with the object turned on the table."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from analyze.types import CameraModel


def turned_camera(camera: CameraModel, heading: float) -> CameraModel:
    """Camera with its pose in the world frame W of a strike with a heading; `camera` itself for 0.

    The heading is the angle by which object and striker are turned about the table's normal, anticlockwise
    seen from above. W turns with them, the camera does not.

    Args:
        camera: Camera with its pose in W at heading 0.
        heading: Heading of the strike [rad].
    """
    if heading == 0.0:
        return camera
    turn = np.eye(4)
    turn[:2, :2] = [[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]]
    return replace(camera, T_world_camera=turn @ camera.T_world_camera)
