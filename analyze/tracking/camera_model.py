"""Conversion between raw pixels, ideal (distortion-free) pixels and points, for pinhole and fisheye.

Integer pixel coordinates are pixel centres. Ideal pixels are those of a pinhole with the same camera matrix
and no distortion: straight edges are straight in them. Only `undistort` and `distort` depend on the lens; all
other code works on ideal pixels.

A fisheye (Kannala and Brandt 2006, as in OpenCV) images a ray at the angle theta off the optical axis at a
distance of theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) focal lengths from the middle, with
k1 to k4 the lens's distortion coefficients. Its ideal pixels grow with tan(theta): beyond
`MAX_FISHEYE_ANGLE_RAD` there are none (NaN).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.types import CameraModel
from schemas.session_manifest import FISHEYE_COEFFICIENTS, LensModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import Array
    from schemas.session_manifest import CameraCalibrationSpec

POSE_NUMBERS = 16
"""number of entries of a pose (4, 4) in a message"""
_NEWTON_STEPS = 12
"""number of Newton steps on a fisheye's theta"""
_UNDISTORT_CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
UNSTATED_STRAIN_SD = 1e-3
"""standard deviation of the image's strain by a calibration that does not state it: 0.2 px over 200 px, or fx
and fy that differ by a thousandth, as in calibrations that report no more than their residuals"""
MAX_FISHEYE_ANGLE_RAD = math.radians(80.0)
"""largest angle off a fisheye's axis [rad]; there an ideal pixel is 1/33 of a raw one, and a marker's edge
cannot be fitted"""


def camera_from_spec(spec: CameraCalibrationSpec) -> CameraModel:
    """Camera model (size, matrix, lens, pose in the world frame W, line time) of a stored calibration.

    The line time is the delay [s] from one image row to the next. A calibration that does not state how far
    it may strain the image is given `UNSTATED_STRAIN_SD`.
    """
    return CameraModel(
        width=spec.width,
        height=spec.height,
        K=np.array(spec.K, dtype=float),
        distortion=np.array(spec.distortion, dtype=float),
        T_world_camera=np.array(spec.T_world_camera, dtype=float),
        model=spec.model,
        line_time_s=spec.line_time_s,
        strain_sd=UNSTATED_STRAIN_SD if spec.strain_sd is None else spec.strain_sd,
    )


def camera_of_strike(spec: CameraCalibrationSpec, own_pose: Sequence[float]) -> CameraModel:
    """Camera model of a stored calibration, with the pose that one strike's record states, if it does.

    Args:
        spec: the session's calibration.
        own_pose: 16 numbers, row by row the camera's pose (4, 4) in the world frame W at heading 0 [m], as a
            mat in view shows it; empty for the session's pose.
    """
    camera = camera_from_spec(spec)
    if len(own_pose) != POSE_NUMBERS:
        return camera
    return replace(camera, T_world_camera=np.array(own_pose, dtype=float).reshape(4, 4))


def undistort(camera: CameraModel, points_px: Array) -> Array:
    """Ideal (distortion-free) pixels (..., 2) of raw image points (..., 2) [px].

    NaN beyond `MAX_FISHEYE_ANGLE_RAD` (80 deg) off the axis of a fisheye. A copy of the points for a pinhole
    without distortion.
    """
    points = np.ascontiguousarray(points_px, dtype=float)
    if camera.model is LensModel.FISHEYE:
        return _undistort_fisheye(camera, points)
    if not np.any(camera.distortion):
        return points.copy()
    ideal = cv2.undistortPoints(
        points.reshape(-1, 1, 2),
        camera.K,
        camera.distortion,
        None,
        None,
        camera.K,
        criteria=_UNDISTORT_CRITERIA,
    )
    return np.asarray(ideal, dtype=float).reshape(points.shape)


def fisheye_coefficients(distortion: Array) -> Array:
    """Distortion coefficients (4,) k1 to k4 of a fisheye; zeros if `distortion` has another length than 4."""
    return (
        np.asarray(distortion, dtype=float)
        if len(distortion) == FISHEYE_COEFFICIENTS
        else np.zeros(FISHEYE_COEFFICIENTS)
    )


def _undistort_fisheye(camera: CameraModel, points: Array) -> Array:
    """Ideal (distortion-free) pixels (..., 2) of raw points (..., 2) of a fisheye, by Newton's method.

    The method solves for theta, the angle between a point's ray and the optical axis. The result is NaN where
    there is no theta below `MAX_FISHEYE_ANGLE_RAD` (80 deg). OpenCV's cv2.fisheye.undistortPoints is not
    used: it stops at the first stationary point of the lens's polynomial and returns -1000000.
    """
    k = fisheye_coefficients(camera.distortion)
    drawn = (points - camera.K[:2, 2]) @ np.linalg.inv(camera.K[:2, :2]).T
    radius = np.hypot(drawn[..., 0], drawn[..., 1])
    theta = np.minimum(radius, MAX_FISHEYE_ANGLE_RAD)
    for _ in range(_NEWTON_STEPS):
        t2 = theta * theta
        value = theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
        slope = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])))
        theta = np.clip(theta - (value - radius) / np.maximum(slope, 0.1), 0.0, 0.5 * math.pi)
    t2 = theta * theta
    found = np.abs(theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))) - radius) < 1e-9
    scale = np.where(
        radius > 1e-9, np.tan(np.minimum(theta, MAX_FISHEYE_ANGLE_RAD)) / np.maximum(radius, 1e-9), 1.0
    )
    ideal = (drawn * scale[..., None]) @ camera.K[:2, :2].T + camera.K[:2, 2]
    return np.where((found & (theta < MAX_FISHEYE_ANGLE_RAD))[..., None], ideal, np.nan)


def distort(camera: CameraModel, ideal_px: Array) -> Array:
    """Raw image points (..., 2) [px] of ideal (distortion-free) pixels (..., 2).

    A copy of the pixels for a pinhole without distortion.
    """
    points = np.asarray(ideal_px, dtype=float)
    if camera.model is LensModel.FISHEYE:
        rays = (points - camera.K[:2, 2]) @ np.linalg.inv(camera.K[:2, :2]).T
        raw = cv2.fisheye.distortPoints(
            rays.reshape(-1, 1, 2), camera.K, fisheye_coefficients(camera.distortion)
        )
        return np.asarray(raw, dtype=float).reshape(points.shape)
    if not np.any(camera.distortion):
        return points.copy()
    rays = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ np.linalg.inv(camera.K).T
    raw, _ = cv2.projectPoints(rays.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), camera.K, camera.distortion)
    return np.asarray(raw, dtype=float).reshape(points.shape)


def world_to_camera(camera: CameraModel) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) [m] that map points from world frame W to camera frame C."""
    R_camera_world = camera.T_world_camera[:3, :3].T
    return R_camera_world, -R_camera_world @ camera.T_world_camera[:3, 3]


def project_ideal(camera: CameraModel, points_camera: Array) -> Array:
    """Ideal (distortion-free) pixels (..., 2) of points (..., 3) in the camera frame [m], by a pinhole."""
    image = points_camera @ camera.K.T
    return image[..., :2] / image[..., 2:]


def project(camera: CameraModel, points_camera: Array) -> Array:
    """Raw image points (..., 2) [px] of points (..., 3) in the camera frame [m], in front of the camera.

    Points far outside the image are projected as by a pinhole, because the lens's polynomial may fold back
    there: those farther from the principal point than the image's diagonal, or more than about 80 deg off the
    axis of a fisheye.
    """
    ideal = project_ideal(camera, points_camera)
    reach = math.hypot(camera.width, camera.height)
    if camera.model is LensModel.FISHEYE:
        reach = math.tan(MAX_FISHEYE_ANGLE_RAD) * min(camera.K[0, 0], camera.K[1, 1])
    near = np.linalg.norm(ideal - camera.K[:2, 2], axis=-1) < reach
    return np.where(
        near[..., None], distort(camera, np.where(near[..., None], ideal, camera.K[:2, 2])), ideal
    )


def project_jacobian(camera: CameraModel, points_camera: Array) -> Array:
    """Derivative (..., 2, 3) [px/m] of points' places in the image by their places in the camera frame.

    The places in the image are ideal pixels (free of lens distortion); those in the camera frame (..., 3) are
    in m.
    """
    K = camera.K
    X, Y, Z = points_camera[..., 0], points_camera[..., 1], points_camera[..., 2]
    zero = np.zeros_like(Z)
    return np.stack(
        [
            np.stack([K[0, 0] / Z, K[0, 1] / Z, -(K[0, 0] * X + K[0, 1] * Y) / Z**2], axis=-1),
            np.stack([zero, K[1, 1] / Z, -K[1, 1] * Y / Z**2], axis=-1),
        ],
        axis=-2,
    )


class PixelMap:
    """Look-up table of the ideal (distortion-free) coordinates [px] of all pixel centres of one camera.

    The table is the array `ideal` (height, width, 2).
    """

    def __init__(self, camera: CameraModel) -> None:
        """Compute the ideal (distortion-free) coordinates of all pixels of `camera`, once."""
        columns, rows = np.meshgrid(
            np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float)
        )
        self.ideal = undistort(camera, np.stack([columns, rows], axis=-1))
        """(height, width, 2) ideal px of each pixel centre; NaN beyond 80 deg off a fisheye's axis"""


@lru_cache(maxsize=4)
def _pixel_map(width: int, height: int, K: bytes, distortion: bytes, model: LensModel) -> PixelMap:
    """Table of the ideal (distortion-free) coordinates of all pixels of a camera, cached by the arguments.

    It holds column and row [ideal px] of each pixel's centre, (height, width, 2).

    Args:
        width: width of the image [px].
        height: height of the image [px].
        K: bytes of the (3, 3) camera matrix [px]; bytes, because arrays cannot be keys of a cache.
        distortion: bytes of the distortion coefficients, an array of floats.
        model: kind of lens.
    """
    return PixelMap(
        CameraModel(
            width, height, np.frombuffer(K).reshape(3, 3), np.frombuffer(distortion), np.eye(4), model
        )
    )


def pixel_map(camera: CameraModel) -> PixelMap:
    """Table of the ideal (distortion-free) coordinates [px] of every pixel centre of a camera.

    Tables are cached, because one takes 0.1 s to build.
    """
    K = np.asarray(camera.K, dtype=float)
    return _pixel_map(
        camera.width,
        camera.height,
        K.tobytes(),
        np.asarray(camera.distortion, dtype=float).tobytes(),
        camera.model,
    )
