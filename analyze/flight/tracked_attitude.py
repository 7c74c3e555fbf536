"""Attitude of a thrown body in each frame alone, by all tags in view: no law of motion smooths it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.geometry.rotations import hat, matrix_from_vector
from analyze.tracking.camera_model import project_ideal, project_jacobian, world_to_camera

if TYPE_CHECKING:
    from analyze.flight.views import TagSet, TossViews
    from analyze.motion.body_motion import BodyMotion
    from analyze.types import Array, CameraModel

_MAX_STEPS = 12
"""Gauss-Newton steps of a frame"""
_LEAST_STEP = 1e-7
"""step [rad, m] that ends them"""


@dataclass(frozen=True)
class TrackedAttitudes:
    """Poses of the object frame O in W in n frames, each from its own corners, with the attitudes' errors."""

    time: Array
    """(n,) times of the frames since the flight's first [s]"""
    R_world_object: Array
    """(n, 3, 3) rotations from O to W"""
    p_world_object: Array
    """(n, 3) origin of O in W [m]"""
    turn_covariance: Array
    """(n, 3, 3) covariance of the attitude as a turn in W, by the corners' noise [rad^2]"""

    def __len__(self) -> int:
        return len(self.time)

    @property
    def sd(self) -> Array:
        """Standard deviation (n,) of the attitude: root of the sum over the three axes [rad]."""
        return np.sqrt(np.trace(self.turn_covariance, axis1=1, axis2=2))

    def part(self, chosen: slice) -> TrackedAttitudes:
        """Some of the frames."""
        return TrackedAttitudes(
            self.time[chosen],
            self.R_world_object[chosen],
            self.p_world_object[chosen],
            self.turn_covariance[chosen],
        )


def tracked_attitudes(
    views: TossViews, near: BodyMotion, tags: TagSet, camera: CameraModel, max_sd: float
) -> TrackedAttitudes:
    """Pose of a body in each frame of its flight, by least squares on the corners of that frame alone.

    A square seen alone has a second, mirrored pose: each fit begins from the pose of a motion known
    roughly, which decides between the two and has no other influence.

    Args:
        views: corners of the tags in the flight's frames.
        near: rough motion at the same frames.
        tags: the object's tags, at their stated places.
        camera: camera that took the frames.
        max_sd: standard deviation [rad] above which a frame's attitude is left out.
    """
    R_camera_world, p_camera_world = world_to_camera(camera)
    kept: list[tuple[float, Array, Array, Array]] = []
    for frame in range(len(views)):
        mine = np.flatnonzero(views.frame == frame)
        points = tags.corners[views.tag[mine]].reshape(-1, 3)
        seen = views.corners[mine].reshape(-1, 2)
        weight = np.repeat(1.0 / views.sd[mine], 8)
        turn, p = near.R_world_object[frame], near.position[frame]
        information = np.zeros((6, 6))
        for _ in range(_MAX_STEPS):
            arms = points @ turn.T
            in_camera = (arms + p) @ R_camera_world.T + p_camera_world
            into = project_jacobian(camera, in_camera) @ R_camera_world
            by = np.concatenate([-into @ hat(arms), into], axis=2).reshape(-1, 6) * weight[:, None]
            off = weight * (seen - project_ideal(camera, in_camera)).ravel()
            information = by.T @ by
            step: Array = np.asarray(np.linalg.lstsq(by, off, rcond=None)[0], dtype=np.float64)
            turn, p = matrix_from_vector(step[:3]) @ turn, p + step[3:]
            if float(np.abs(step).max()) < _LEAST_STEP:
                break
        else:
            continue
        covariance = np.asarray(np.linalg.inv(information)[:3, :3], dtype=np.float64)
        if np.sqrt(np.trace(covariance)) <= max_sd:
            kept.append((float(views.seconds[frame]), turn, p, covariance))
    if not kept:
        return TrackedAttitudes(np.zeros(0), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    time, R_all, p_all, covariances = (np.array(each) for each in zip(*kept, strict=True))
    return TrackedAttitudes(time, R_all, p_all, covariances)
