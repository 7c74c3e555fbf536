"""Pose in which an object was put down, against the plan, by the frames of its tip.

It is a turn about W's z at the pivot, and a shift along W's x and y. Turn and distance from the camera show
in how the print moves; the shift along the image shows in where the object turns, as its edge does not leave
the table.
"""

# numpy is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.tracking.print_follower import THETA, Z

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.tracking.print_follower import PrintPose
    from analyze.types import Array, CameraModel

REST_SD = np.array([math.radians(1.5), 3e-3, 3e-3])
"""1 sigma of the pose at rest against the plan: turn about W's z [rad], place along x and y [m]"""
_MOST = 3 * REST_SD
"""largest difference from the plan that is believed: a round wall without print may show any"""
_LIFT_SD = 3e-4
"""1 sigma of the lift of an edge that stays on the table, by its rounding and the camera [m]"""


def moved_camera(camera: CameraModel, pivot: Array, turned: Array) -> CameraModel:
    """Camera as seen from an object that was turned about W's z at the pivot, and shifted along x and y.

    Args:
        camera: camera with its pose in W.
        pivot: (3,) point of the planned pivot in W [m].
        turned: (3,) turn [rad] and shifts [m].
    """
    cos, sin = math.cos(turned[0]), math.sin(turned[0])
    R = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    pose = np.eye(4)
    pose[:3, :3] = R.T @ camera.T_world_camera[:3, :3]
    shift = np.array([turned[1], turned[2], 0.0])
    pose[:3, 3] = R.T @ (camera.T_world_camera[:3, 3] - pivot - shift) + pivot
    return replace(camera, T_world_camera=pose)


def rest_correction(poses: Sequence[PrintPose], turned: Array) -> Array:
    """Change (3,) of the pose at rest by the frames in motion, about its present difference from the plan."""
    information = _rest_information(poses, 1.0)
    gradient = sum((pose.shared[1] for pose in poses), -turned / REST_SD**2)
    shift, weight = _edge_shift(poses)
    information[1, 1] += weight
    gradient[1] += weight * shift
    changed = turned + np.linalg.solve(information, gradient)
    return np.asarray(np.clip(changed, -_MOST, _MOST) - turned, dtype=np.float64)


def _edge_shift(poses: Sequence[PrintPose]) -> tuple[float, float]:
    """Shift of the edge along x [m], and its information [1/m^2], by a lift that grows with the tip.

    The place of an edge that is supposed d before the true one rises by d sin(theta).
    """
    seen = [pose.x for pose in poses if pose.explained > 0]
    if not seen:
        return 0.0, 0.0
    lever = np.sin([x[THETA] for x in seen])
    square = float(lever @ lever)
    if square <= 0.0:
        return 0.0, 0.0
    return float(lever @ [x[Z] for x in seen]) / square, (float(np.abs(lever).max()) / _LIFT_SD) ** 2


def _rest_information(poses: Sequence[PrintPose], share: float) -> Array:
    """Information (3, 3) about the pose at rest: the plan's, and a share of that of the frames in motion."""
    return share * sum((pose.shared[0] for pose in poses), np.zeros((3, 3))) + np.diag(REST_SD**-2.0)


def theta_sd_by_rest(poses: Sequence[PrintPose], rested: int) -> float:
    """Standard deviation of theta [rad] by the uncertainty of the pose at rest, in the frame it affects most.

    The frames share the noise of the template, so that they count no more than the images at rest do.
    """
    moving = [pose for pose in poses[rested:] if pose.explained > 0]
    if not moving:
        return 0.0
    covariance = np.linalg.inv(_rest_information(moving, 1.0 / (1.0 + len(moving) / rested)))
    change = np.array([pose.by_rest[THETA] for pose in moving]) - poses[0].by_rest[THETA]
    return float(np.sqrt(np.einsum("ni,ij,nj->n", change, covariance, change).max()))
