"""Computes the camera's pose in the world frame W from one image of a board on the table.

The board lies or stands at a known place.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.calibration.board import corner_points
from analyze.calibration.board_pose import Pose, fit_pose, pose_covariance, weighted_corners
from analyze.calibration.lens import project
from analyze.calibration.straight import refit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.calibration.detect import View
    from analyze.calibration.lens import Lens
    from analyze.tags.sheet import Board
    from analyze.types import Array

LYING = np.eye(3)
"""rotation (3, 3) from the board's frame to the world frame W of a board that lies printed side up, its x
arrow along W's x (where objects tip), its y arrow away from the camera"""
STANDING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""rotation (3, 3) from the board's frame to the world frame W of a board that stands on its lower edge, face
to the camera, its x arrow along W's x"""


@dataclass(frozen=True)
class CameraPlace:
    """Pose of the camera in the world frame W (z up, table at z = 0), with 1 sigma in rad and m."""

    T_world_camera: Array
    """(4, 4) pose of the camera's frame in W, translation in m"""
    turn_sd: Array
    """(3,) standard deviation of the rotation about W's axes [rad]"""
    position_sd: Array
    """(3,) standard deviation of the position along W's axes [m]"""
    corners: int
    """number of corners of the board that were used"""
    rms_px: float
    """root mean square distance of the board's corners from their predictions [px]"""


def place_camera(
    image: NDArray[np.uint8],
    view: View,
    board: Board,
    lens: Lens,
    lens_covariance: Array,
    scatter: float,
    R_world_board: Array,
    p_world_board: Array,
) -> CameraPlace:
    """Compute the camera's pose in the world frame W from an image of the board at a known place.

    The corners are first refitted with the lens, if enough of them are found again.

    Args:
        image: (height, width) grey values with the board.
        view: corners of the board in the image.
        board: the board.
        lens: lens of the camera, with p numbers.
        lens_covariance: (p, p) covariance of the lens's numbers.
        scatter: factor by which the corners' errors exceed their stated sd, from the calibration; it is
            already included in `lens_covariance`.
        R_world_board: (3, 3) rotation from the board's frame B to W: LYING or STANDING.
        p_world_board: (3,) origin of B in W [m].

    Returns:
        The pose with its standard deviations, which include errors of corners and lens, but not of the
        board's placement.
    """
    points = corner_points(board)
    seen = weighted_corners(view, points)
    pose = fit_pose(seen, lens)
    refitted = refit(image, board, view, points, lens, pose)
    if refitted is not None:
        seen = weighted_corners(refitted, points)
        pose = fit_pose(seen, lens)
    covariance = pose_covariance(seen, lens, pose, lens_covariance / scatter**2) * scatter**2
    T = _world_camera(pose, R_world_board, p_world_board)
    steps = np.concatenate([np.full(3, 1e-6), np.full(3, 1e-7)])
    J = np.zeros((6, 6))
    for i, step in enumerate(steps):
        nudge = np.zeros(6)
        nudge[i] = step
        moved = _world_camera(pose.moved(nudge), R_world_board, p_world_board)
        J[:3, i] = Rotation.from_matrix(moved[:3, :3] @ T[:3, :3].T).as_rotvec() / step
        J[3:, i] = (moved[:3, 3] - T[:3, 3]) / step
    carried: Array = np.asarray(J @ covariance @ J.T, dtype=np.float64)
    sd = np.sqrt(np.diag(carried))
    return CameraPlace(T, sd[:3], sd[3:], len(seen.points), residual_px(seen.points, seen.place, lens, pose))


def residual_px(points: Array, place: Array, lens: Lens, pose: Pose) -> float:
    """Root mean square distance [px] of observed corners from their projections by lens and pose.

    Args:
        points: (n, 3) corners in the board's frame [m].
        place: (n, 2) observed corners [px].
        lens: lens of the camera.
        pose: pose of the board in the camera's frame.
    """
    image, _, _ = project(lens, points, pose.rotation, pose.translation)
    squared: Array = np.asarray(np.sum((place - image) ** 2, axis=1), dtype=np.float64)
    return math.sqrt(float(np.mean(squared)))


def implausibilities(T_world_camera: Array) -> list[str]:
    """Reason why a camera's pose in the world frame W (z up) is implausible, as a list for the user.

    Implausible is a camera below the table, or one that looks over 60 degrees off W's y.

    Args:
        T_world_camera: (4, 4) pose of the camera in W.

    Returns:
        At most one sentence with the remedy; empty if the pose is plausible.
    """
    sight, position = T_world_camera[:3, 2], T_world_camera[:3, 3]
    found: list[str] = []
    if position[2] < 0:
        found.append(
            "the camera would be below the table: the printed side must face up (--upright: face the camera),"
            " y arrow away from the camera"
        )
    elif sight[1] < 0.5:
        found.append(
            f"the camera would look along ({sight[0]:.1f}, {sight[1]:.1f}, {sight[2]:.1f}) in W,"
            " where a rig's looks along +y: lay the board with its x arrow where objects tip"
            " and its y arrow away from the camera"
        )
    return found


def _world_camera(pose: Pose, R_world_board: Array, p_world_board: Array) -> Array:
    """Pose (4, 4) of the camera in the world frame W, from two poses of the board.

    Args:
        pose: pose of the board in the camera's frame.
        R_world_board: (3, 3) rotation from the board's frame to W.
        p_world_board: (3,) origin of the board's frame in W [m].
    """
    R_board_camera = pose.matrix.T
    T = np.eye(4)
    T[:3, :3] = R_world_board @ R_board_camera
    T[:3, 3] = p_world_board - T[:3, :3] @ pose.translation
    return T
