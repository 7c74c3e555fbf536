"""How the table lies against the W that a recorded T_world_camera speaks of: two tilts and a height."""

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
    """1 sigma of how the table lies against the recorded T_world_camera."""

    tilt_sd: float
    """rad, about W's x and y"""
    height_sd: float
    """m"""


LAID_BOARD = TablePrior(math.radians(0.1), 5e-4)
"""as well as a board is laid by hand"""
UNKNOWN_TABLE = TablePrior(math.radians(10.0), 0.1)
"""no board was seen: poses and pivots must tell"""


def table_transform(table: Array) -> Array:
    """E (4, 4): where points of the table's own frame are in the W that the recorded T_world_camera speaks of."""
    E = np.eye(4)
    E[:3, :3] = tilted(table)
    E[2, 3] = table[2]
    return E


def corrected_camera(camera: CameraModel, table: Array) -> CameraModel:
    """The camera in the frame whose z = 0 is the table."""
    return replace(camera, T_world_camera=np.linalg.inv(table_transform(table)) @ camera.T_world_camera)


def tilted(table: Array) -> Array:
    """Rotation (3, 3) of E by its two tilts."""
    return matrix_from_vector(np.array([table[0], table[1], 0.0]))


def tilt_axes(table: Array) -> Array:
    """Axes (2, 3) in W about which E turns as its two tilts change: the exponential's derivative, to third order of tilts below 20 deg."""
    K = hat(np.array([table[0], table[1], 0.0]))
    return (np.eye(3) + K / 2 + K @ K / 6)[:, :2].T
