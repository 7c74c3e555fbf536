"""Lens of a calibration with its numbers (fx, fy, cx, cy, distortion), projection and weak priors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.types import CameraModel
from schemas.session_manifest import FISHEYE_COEFFICIENTS, LensModel

if TYPE_CHECKING:
    from analyze.types import Array

PINHOLE_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
FISHEYE_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
_DISTORTION_PRIORS = {
    LensModel.PINHOLE: {"k1": (1.0, 2), "k2": (0.5, 4), "p1": (0.02, 1), "p2": (0.02, 1), "k3": (0.05, 6)},
    LensModel.FISHEYE: {"k1": (1.0, 2), "k2": (0.5, 4), "k3": (0.3, 6), "k4": (0.2, 8)},
}
"""per distortion term: prior sd of its shift of the image's corner, as a share of the corner's distance from
the middle, and the power of the angle to which this share is proportional"""
_FOCAL_SD_SHARE, _MIDDLE_SD_SHARE = 1.0, 0.25
"""prior sd of the focal length over itself, and of the middle over the image's size"""


@dataclass(frozen=True)
class Lens:
    """Lens: pinhole or fisheye, image size [px], and p numbers.

    The numbers are, in this order, focal lengths and principal point fx, fy, cx, cy [px], then the distortion
    coefficients of OpenCV.
    """

    model: LensModel
    """pinhole with distortion, or fisheye"""
    width: int
    """image width [px]"""
    height: int
    """image height [px]"""
    numbers: Array
    """(p,) fx, fy, cx, cy [px], then k1, k2, p1, p2, k3 (pinhole, p = 9) or k1 to k4 (fisheye, p = 8)"""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the lens's numbers, in their order: fx, fy, cx, cy and the distortion coefficients."""
        return FISHEYE_NAMES if self.model is LensModel.FISHEYE else PINHOLE_NAMES

    @property
    def camera_matrix(self) -> Array:
        """Camera matrix (3, 3) [px]: focal lengths and principal point."""
        fx, fy, cx, cy = self.numbers[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Array:
        """Distortion coefficients (5,) k1, k2, p1, p2, k3, or for a fisheye (4,) k1, k2, k3, k4."""
        return self.numbers[4:]

    def moved(self, step: Array) -> Lens:
        """Copy of the lens with `step` (p,) added to its p numbers (focal length, distortion ...)."""
        return replace(self, numbers=self.numbers + step)

    def camera(self, T_world_camera: Array | None = None) -> CameraModel:
        """Camera model with this lens and a pose.

        Args:
            T_world_camera: (4, 4) pose of the camera in the world frame; None for the identity.
        """
        place = np.eye(4) if T_world_camera is None else T_world_camera
        return CameraModel(self.width, self.height, self.camera_matrix, self.distortion, place, self.model)


def plain_lens(model: LensModel, width: int, height: int, focal_px: float) -> Lens:
    """Lens without distortion, with its principal point in the image's middle and equal focal lengths.

    Args:
        model: lens model.
        width: image width [px].
        height: image height [px].
        focal_px: focal length [px].
    """
    many = FISHEYE_COEFFICIENTS if model is LensModel.FISHEYE else 5
    return Lens(
        model, width, height, np.array([focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, *[0.0] * many])
    )


def prior_sd(lens: Lens) -> Array:
    """Standard deviation (p,) that each of the lens's numbers has before views are used (prior).

    Order and units are those of the numbers: focal lengths fx, fy and principal point cx, cy [px], then the
    distortion coefficients. The expected values are those of `plain_lens`, a lens without distortion. The
    prior is so wide that views that determine a number override it. It keeps undetermined numbers finite,
    so that their uncertainty can be reported.
    """
    focal = float(lens.numbers[:2].mean())
    radius = 0.5 * math.hypot(lens.width, lens.height) / focal
    shares = _DISTORTION_PRIORS[lens.model]
    bend = [shares[name][0] / radius ** shares[name][1] for name in lens.names[4:]]
    middle = _MIDDLE_SD_SHARE * max(lens.width, lens.height)
    return np.array([_FOCAL_SD_SHARE * focal, _FOCAL_SD_SHARE * focal, middle, middle, *bend])


def project(lens: Lens, points: Array, rotation: Array, translation: Array) -> tuple[Array, Array, Array]:
    """Project points to the image of a camera with a lens: x_camera = R x + translation, then the lens.

    Args:
        lens: the lens, with p numbers.
        points: (n, 3) points [m].
        rotation: (3,) rotation vector of R, from the points' frame to the camera's [rad].
        translation: (3,) translation [m].

    Returns:
        Raw pixels (n, 2), their derivatives (n, 2, 6) by rotation vector and translation [px/rad, px/m], and
        their derivatives (n, 2, p) by the lens's numbers.
    """
    shaped = np.ascontiguousarray(points, dtype=float).reshape(-1, 1, 3)
    if lens.model is LensModel.FISHEYE:
        image, by = cv2.fisheye.projectPoints(
            shaped, rotation, translation, lens.camera_matrix, lens.distortion
        )
        derivatives: Array = np.asarray(by, dtype=np.float64).reshape(-1, 2, 15)
        return (
            np.asarray(image, dtype=np.float64).reshape(-1, 2),
            derivatives[..., 8:14],
            derivatives[..., :8],
        )
    image, by = cv2.projectPoints(shaped, rotation, translation, lens.camera_matrix, lens.distortion)
    derivatives = np.asarray(by, dtype=np.float64).reshape(len(points), 2, -1)
    return np.asarray(image, dtype=np.float64).reshape(-1, 2), derivatives[..., :6], derivatives[..., 6:15]
