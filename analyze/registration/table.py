"""Pose of the table relative to the recorded world frame W: two tilts and a height.

The recorded frame W is the one of the camera's recorded pose T_world_camera; the true table need not be its z
= 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.geometry.rotations import hat, matrix_from_vector

if TYPE_CHECKING:
    from analyze.types import Array, CameraModel


@dataclass(frozen=True)
class TablePrior:
    """Prior sd of the table's tilts [rad] and height [m] in W, the world frame.

    W is known by the recorded pose of the camera in it, which may be wrong.
    """

    tilt_sd: float
    """standard deviation of the tilt about W's x and of that about y [rad]"""
    height_sd: float
    """standard deviation of the height [m]"""


LAID_BOARD = TablePrior(math.radians(0.1), 5e-4)
"""prior with a board that was laid on the table by hand"""
UNKNOWN_TABLE = TablePrior(math.radians(10.0), 0.1)
"""prior without a board: marker poses and pivots must determine the table"""


def corrected_camera(camera: CameraModel, table: Array) -> CameraModel:
    """Camera with its pose in the table's own frame, whose z = 0 is the table, instead of in W.

    Args:
        camera: camera with its recorded pose in the world frame W.
        table: (3,) tilts of the table about W's x and y [rad], and its height [m].
    """
    T_world_table = np.eye(4)
    T_world_table[:3, :3] = table_rotation(table)
    T_world_table[2, 3] = table[2]
    return replace(camera, T_world_camera=np.linalg.inv(T_world_table) @ camera.T_world_camera)


def table_rotation(table: Array) -> Array:
    """Rotation (3, 3) from the table's own frame to the recorded world frame W.

    Args:
        table: (3,) tilts about W's x and y [rad], and the height [m], which is not used.
    """
    return matrix_from_vector(np.array([table[0], table[1], 0.0]))


def tilt_axes(table: Array) -> Array:
    """Axes (2, 3) in the world frame W about which the table turns as each of its two tilts changes.

    A small change of a tilt turns the table by this change times the axis of that tilt; the axes are not
    exactly W's x and y because the two tilts do not commute. They are a series up to the squares of the
    tilts, which is accurate below 20 deg. Row 0 is for the tilt about x, row 1 for that about y; unitless.

    Args:
        table: (3,) tilts about W's x and y [rad], and the height [m], which is not used.
    """
    K = hat(np.array([table[0], table[1], 0.0]))
    return (np.eye(3) + K / 2 + K @ K / 6)[:, :2].T
