"""Pose of a marker at rest, from all still frames together, and the check of the object's placement.

If the marker's place on the object is known, the pose is also fitted to the planned orientation of the
object, as a prior with standard deviations of 0.02 rad (tilt) and 0.3 rad (direction in the marker's plane).
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.least_squares.gauss_newton import Linearised, gauss_newton
from analyze.tracking.camera_model import project_ideal, project_jacobian
from analyze.tracking.pose import marker_corners, solve_pose
from analyze.types import MARKER_TURN_SD, RestTurn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.types import Array, CameraModel, Marker, MarkerTrack

_TILT_SD = 0.02
"""prior standard deviation of the tilt [rad], by placement and marker mounting together"""
_DIRECTION_SD = 0.3
"""prior standard deviation of the direction in the marker's plane [rad], which the image determines well by
itself"""
MODEL_PX = 0.01
"""floor of the mean corners' sd [px]: lens model and printing of the code, which do not average out"""
UNMEASURED_TURN_SD = 0.1
"""standard deviation [rad] of a marker's turn on the object that nobody measured: none is stated, or one as
large as that which is then assumed"""
_SAME_SIDE = math.radians(30.0)
"""range of the angle between the camera's direction of sight and the pivot edge that is one side [rad]"""
_MAX_STEPS, _STEP_TOLERANCE = 12, 1e-9
"""Gauss-Newton steps, and the step [rad, m] that ends them"""


@dataclass(frozen=True)
class RestPose:
    """Pose of a marker at rest in the camera frame, and the error of its rotation."""

    R: Array
    """(3, 3) rotation R_camera_marker"""
    p: Array
    """(3,) position p_camera_marker [m]"""
    turn_covariance: Array | None = None
    """(3, 3) covariance of small turns about the marker's own axes [rad^2]; None if the marker's place on the
    object is unknown"""


def rest_pose(
    corners_ideal: Array,
    track: MarkerTrack,
    still: NDArray[np.bool_],
    marker: Marker,
    camera: CameraModel,
    R_world_object: Array,
) -> RestPose:
    """Pose of a marker at rest in the camera frame.

    It fits the median corners, with the planned orientation as a prior. If the marker's place on the object
    is unknown there is no prior: of the two poses that fit a square, the one nearer to the tracked pose is
    taken; if the corners give no pose, the tracked one.

    Args:
        corners_ideal: (n, 4, 2) corners in the still frames (object at rest) [ideal px: without lens
            distortion].
        track: the marker's track, with the pose solution chosen by the motion.
        still: (frames of the track,) True for its still frames, of which there is at least one.
        marker: marker with its place on the object, if known.
        camera: camera with its pose in the world frame W.
        R_world_object: (3, 3) nominal rotation from object frame O to W.
    """
    mean = np.median(corners_ideal, axis=0)
    middle = int(np.flatnonzero(still)[np.count_nonzero(still) // 2])
    R_start, p_start = track.R_camera_marker[middle], track.p_camera_marker[middle]
    if marker.T_object_marker is None:
        pair = solve_pose(mean, marker.size, camera.K)
        if pair is None:
            return RestPose(R_start, p_start)
        turns = [float(np.trace(R.T @ R_start)) for R in pair.R_camera_marker]
        best = int(np.argmax(turns))
        return RestPose(pair.R_camera_marker[best], pair.p_camera_marker[best])
    R_nominal = camera.T_world_camera[:3, :3].T @ R_world_object @ marker.T_object_marker[:3, :3]
    sd = max(MODEL_PX, float(np.median(track.corner_sd_px[still])) / np.sqrt(max(1, np.count_nonzero(still))))
    prior_sd = np.array([_TILT_SD, _TILT_SD, _DIRECTION_SD])
    points = marker_corners(marker.size)

    def linearise(pose: tuple[Array, Array]) -> Linearised:
        # The rotation is R exp(w): derivatives about the marker's own axes, so that the prior separates tilt
        # from direction.
        """Residuals (11,) of a marker's pose, observed less expected; derivatives (11, 6) of the expected.

        Rows: x and y of four corners [ideal px, without lens distortion], then three angles [rad] from the
        planned orientation (the prior), all over their standard deviations. Columns: a turn about the
        marker's own axes [rad], and its position in the camera frame [m]. `pose` is the rotation (3, 3) and
        position (3,) of the marker in the camera frame.
        """
        R, p = pose
        in_camera = points @ R.T + p
        by_translation = project_jacobian(camera, in_camera)
        lever = np.cross(np.eye(3)[None], points[:, None, :]) @ R.T
        by_turn = np.einsum("kij,kaj->kia", by_translation, lever).reshape(8, 3)
        residual = (mean - project_ideal(camera, in_camera)).ravel() / sd
        away = Rotation.from_matrix(R_nominal.T @ R).as_rotvec() / prior_sd
        seen = np.hstack([by_turn, by_translation.reshape(8, 3)]) / sd
        prior = np.hstack([np.diag(1.0 / prior_sd), np.zeros((3, 3))])
        return Linearised(np.concatenate([residual, -away]), np.concatenate([seen, prior]))

    found = gauss_newton((R_nominal.copy(), p_start.copy()), linearise, _moved, _MAX_STEPS, _STEP_TOLERANCE)
    rows = linearise(found).jacobian
    if not np.all(np.isfinite(rows)):
        return RestPose(*found)
    return RestPose(*found, np.asarray(np.linalg.pinv(rows.T @ rows)[:3, :3], dtype=np.float64))


def rest_turn(
    pose: RestPose, marker: Marker, camera: CameraModel, R_world_object: Array, systematic_sd: float
) -> RestTurn | None:
    """Turn of the object at rest about the pivot axis (y of W) by one marker; None if it shows none.

    A marker with an unknown place on the object, or turned by more than 0.3 rad, shows nothing.

    Args:
        pose: the marker's pose at rest.
        marker: marker with its place on the object, if known.
        camera: camera with its pose in the world frame W.
        R_world_object: (3, 3) planned rotation from object frame O to W.
        systematic_sd: standard deviation [rad] of the angle's error by lens and printing.
    """
    if marker.T_object_marker is None or pose.turn_covariance is None:
        return None
    R_world_marker = camera.T_world_camera[:3, :3] @ pose.R
    turned = R_world_marker @ marker.T_object_marker[:3, :3].T @ R_world_object.T
    vector = Rotation.from_matrix(turned).as_rotvec()
    if not float(np.linalg.norm(vector)) < _DIRECTION_SD:
        return None
    axis = R_world_marker[1]
    by_image = math.sqrt(float(axis @ pose.turn_covariance @ axis))
    return RestTurn(
        angle=float(vector[1]),
        sd=math.hypot(by_image, systematic_sd, 0.5 * camera.strain_sd),
        marker=str(marker.id),
        marker_sd=marker.turn_sd if marker.turn_sd < MARKER_TURN_SD else UNMEASURED_TURN_SD,
        camera=_camera_side(camera.T_world_camera),
    )


def _camera_side(T_world_camera: Array) -> str:
    """Name of a camera's tilt and height, and of the side from which it sees the pivot edge.

    Strikes whose headings differ by a few degrees see the edge from one side: they share the error of the
    camera's roll. An object that is turned by 180 degrees shows it with the other sign.

    Args:
        T_world_camera: (4, 4) pose of the camera in the world frame of a strike [m].
    """
    sight = math.atan2(float(T_world_camera[0, 2]), float(T_world_camera[1, 2]))
    side = round(sight / _SAME_SIDE) % round(2 * math.pi / _SAME_SIDE)
    return " ".join([*(f"{value:.6f}" for value in T_world_camera[2].tolist()), str(side)])


def _moved(pose: tuple[Array, Array], step: Array) -> tuple[Array, Array]:
    """Pose (R, p) after a step (6,) of rotation [rad] and position [m], each angle limited to 0.3 rad.

    R (3, 3) and p (3,) [m] are the marker's rotation and position in the camera frame; the rotation is about
    the marker's own axes.
    """
    R, p = pose
    return R @ Rotation.from_rotvec(np.clip(step[:3], -0.3, 0.3)).as_matrix(), p + step[3:]


def placement_error(
    R_camera_marker: Sequence[Array], markers: Sequence[Marker], camera: CameraModel, R_world_object: Array
) -> tuple[float, Array] | None:
    """Angle [rad] between the object's orientation and the planned one, and its correction.

    Args:
        R_camera_marker: (3, 3) rotations from marker to camera frame, one per entry of `markers`.
        markers: the markers seen; markers without a known place on the object are ignored.
        camera: camera with its pose in the world frame W.
        R_world_object: (3, 3) planned rotation from object frame O to W.

    Returns:
        The angle [rad] and the rotation vector (3,) in W [rad] from the present to the planned orientation;
        None if no marker's place on the object is known.
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
