"""Pose of a marker while the object is at rest: all still frames together, with the plan's orientation as the prior for its tilt."""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.tracking.camera_model import project_ideal, project_jacobian
from analyze.tracking.pose import marker_corners, solve_pose

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.types import Array, CameraModel, Marker, MarkerTrack

_TILT_SD = 0.02
"""rad, of placement and marker mounting together"""
_DIRECTION_SD = 0.3
"""rad in the marker's plane, which the image shows well by itself"""
MODEL_PX = 0.01
"""px, floor of the mean corners' sd: lens model and printing of the code, which do not average out"""


def rest_pose(
    corners_ideal: Array,
    track: MarkerTrack,
    still: NDArray[np.bool_],
    marker: Marker,
    camera: CameraModel,
    R_world_object: Array,
) -> tuple[Array, Array]:
    """R_camera_marker (3, 3) and p_camera_marker (3,) [m] at rest.

    Args:
        corners_ideal: (n, 4, 2) ideal px, the still frames.
        track: the marker's track, for the solution that the motion chose.
        still: (frames of the track,) which of its frames are still.
        marker: with its place on the object, if that is known.
        camera: with its place in W.
        R_world_object: nominal orientation.
    """
    mean = np.median(corners_ideal, axis=0)
    middle = int(np.flatnonzero(still)[np.count_nonzero(still) // 2])
    R_start, p_start = track.R_camera_marker[middle], track.p_camera_marker[middle]
    if marker.T_object_marker is None:
        pair = solve_pose(mean, marker.size, camera.K)
        if pair is None:
            return R_start, p_start
        turns = [float(np.trace(R.T @ R_start)) for R in pair.R_camera_marker]
        best = int(np.argmax(turns))
        return pair.R_camera_marker[best], pair.p_camera_marker[best]
    R_nominal = camera.T_world_camera[:3, :3].T @ R_world_object @ marker.T_object_marker[:3, :3]
    sd = max(MODEL_PX, float(np.median(track.corner_sd_px[still])) / np.sqrt(max(1, np.count_nonzero(still))))
    prior_sd = np.array([_TILT_SD, _TILT_SD, _DIRECTION_SD])
    points = marker_corners(marker.size)
    turn, p = R_nominal.copy(), p_start.copy()
    for _ in range(12):
        # turn = turn exp(w): derivatives in the marker's own axes, so that the prior tells tilt from direction.
        in_camera = points @ turn.T + p
        by_translation = project_jacobian(camera, in_camera)
        lever = np.cross(np.eye(3)[None], points[:, None, :]) @ turn.T
        by_turn = np.einsum("kij,kaj->kia", by_translation, lever).reshape(8, 3)
        residual = (mean - project_ideal(camera, in_camera)).ravel() / sd
        away = Rotation.from_matrix(R_nominal.T @ turn).as_rotvec() / prior_sd
        J = np.concatenate(
            [
                np.hstack([by_turn, by_translation.reshape(8, 3)]) / sd,
                np.hstack([np.diag(1.0 / prior_sd), np.zeros((3, 3))]),
            ]
        )
        step = np.linalg.lstsq(J, np.concatenate([residual, -away]), rcond=None)[0]
        turn = turn @ Rotation.from_rotvec(np.clip(step[:3], -0.3, 0.3)).as_matrix()
        p = p + step[3:]
        if float(np.max(np.abs(step))) < 1e-9:
            break
    return turn, p


def placement_error(
    R_camera_marker: Sequence[Array], markers: Sequence[Marker], camera: CameraModel, R_world_object: Array
) -> tuple[float, Array] | None:
    """Angle [rad] between where the object lies and where the plan wants it, and the turn (3,) in W that would put it right.

    Args:
        R_camera_marker: (3, 3) each, one per entry of `markers`.
        markers: the markers seen; those without a known place on the object say nothing.
        camera: with its place in W.
        R_world_object: the plan's orientation.

    Returns:
        None where no marker's place on the object is known.
    """
    turns = [
        Rotation.from_matrix(
            R_world_object @ (camera.T_world_camera[:3, :3] @ R @ marker.T_object_marker[:3, :3].T).T
        )
        for R, marker in zip(R_camera_marker, markers, strict=True)
        if marker.T_object_marker is not None
    ]
    if not turns:
        return None
    correction = Rotation.concatenate(turns).mean().as_rotvec()
    return float(np.linalg.norm(correction)), correction
