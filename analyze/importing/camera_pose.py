"""Estimates the camera's pose from the object, which rests before each strike where the plan puts it.

    T_world_camera = T_world_object T_object_marker T_camera_marker^-1

(T_a_b is the pose of b in a.) A hand places an object to a degree and a few millimetres; the mean over the
strikes is better, and the strikes' scatter measures its accuracy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.errors import ImportRefused
from analyze.geometry.rotations import angle_between, inverse_transform, nearest_rotation, transform
from analyze.geometry.station import turned_camera
from analyze.importing.tip_view import TipView
from analyze.types import Array, CameraModel
from schemas.strike_plan import PlannedStrike

MAX_DEVIATION_RAD, MAX_DEVIATION_M = math.radians(6.0), 0.04
"""largest deviation of a strike's camera pose from the strikes' median, rotation [rad] and position [m];
above it the object was not placed as planned, or the camera was moved"""


@dataclass(frozen=True)
class StrikeCameraPose:
    """Pose of the camera in the world frame, estimated from the resting object of one strike."""

    strike_id: str
    """id of the strike in the recording"""
    T_world_camera: Array
    """(4, 4) pose of the camera in the world frame, translation in m"""


@dataclass(frozen=True)
class EstimatedCameraPose:
    """Mean pose of the camera in the world frame over all strikes, with the strikes' rms deviation."""

    T_world_camera: Array
    """(4, 4) pose of the camera in the world frame, translation in m"""
    deviation_rad: float
    """root mean square deviation of the strikes' orientations from the mean [rad]"""
    deviation_m: float
    """root mean square deviation of the strikes' positions from the mean [m]"""
    views: int
    """number of strikes that were averaged"""


def camera_pose_from_strike(
    view: TipView, camera: CameraModel, planned: PlannedStrike, strike_id: str
) -> StrikeCameraPose:
    """Pose of the camera in the world frame W from the object at rest before one strike.

    Args:
        view: the object at rest in the camera's view.
        camera: model of the same camera; neither its lens nor its pose changes the result.
        planned: planned strike with the object's resting pose and its heading (rotation about the vertical).
        strike_id: id of the strike in the recording, copied to the result.
    """
    T_world_object = transform(np.array(planned.R_world_object), np.array(planned.p_world_object))
    turned = T_world_object @ inverse_transform(view.T_camera_object)
    # The plan describes a strike with a heading in W rotated by that heading.
    standing = turned_camera(replace(camera, T_world_camera=turned), -planned.heading_rad)
    return StrikeCameraPose(strike_id, standing.T_world_camera)


def mean_camera_pose(views: Sequence[StrikeCameraPose]) -> EstimatedCameraPose:
    """Mean camera pose over the strikes, with the root mean square deviation of the strikes' poses.

    The pose is T_world_camera (4, 4) [m]; the deviations are of orientation [rad] and of position [m]. The
    number of strikes comes with them.

    Args:
        views: camera pose estimated from each strike.

    Raises:
        ImportRefused: `views` is empty, or one strike's pose deviates from the others' by more than the error
            of an object placed by hand. Allowed are `MAX_DEVIATION_RAD` from the orientation that is nearest
            to the others, and `MAX_DEVIATION_M` from the median position.
    """
    if not views:
        raise ImportRefused(
            "the camera's pose is unknown: the camera file has no T_world_camera, and no tag with "
            "T_object_marker in the object file is at rest in view: take an image of the board on the table "
            "(`analyze calibrate --table`), or measure T_object_marker"
        )
    poses = np.array([view.T_world_camera for view in views])
    R, p = poses[:, :3, :3], poses[:, :3, 3]
    # The median pose, which an outlier does not move.
    middle = int(np.argmin([np.median(angle_between(R, one)) for one in R]))
    turned, shifted = angle_between(R, R[middle]), np.linalg.norm(p - np.median(p, axis=0), axis=1)
    worst = int(np.argmax(np.maximum(turned / MAX_DEVIATION_RAD, shifted / MAX_DEVIATION_M)))
    if turned[worst] > MAX_DEVIATION_RAD or shifted[worst] > MAX_DEVIATION_M:
        raise ImportRefused(
            f"strike {views[worst].strike_id}: its camera pose differs by {math.degrees(turned[worst]):.0f} "
            f"deg and {1000 * shifted[worst]:.0f} mm from the other strikes': the object was not placed as "
            "planned, or the camera was moved: leave that strike out (--strike -), or measure the pose with "
            "the board (`analyze calibrate --table`)"
        )
    mean = transform(nearest_rotation(R.mean(axis=0)), p.mean(axis=0))
    deviation_rad = float(np.sqrt(np.mean(angle_between(R, mean[:3, :3]) ** 2)))
    return EstimatedCameraPose(
        mean, deviation_rad, float(np.sqrt(np.mean(np.sum((p - mean[:3, 3]) ** 2, axis=1)))), len(views)
    )
