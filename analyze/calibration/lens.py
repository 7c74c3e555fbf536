"""A lens as numbers: fx, fy, cx, cy and its distortion, points to pixels with derivatives, and what a lens can plausibly be."""

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
_SHARES = {
    LensModel.PINHOLE: {"k1": (1.0, 2), "k2": (0.5, 4), "p1": (0.02, 1), "p2": (0.02, 1), "k3": (0.05, 6)},
    LensModel.FISHEYE: {"k1": (1.0, 2), "k2": (0.5, 4), "k3": (0.3, 6), "k4": (0.2, 8)},
}
"""how far a term may move the image's corner, in parts of its distance from the middle (1 sigma), and its power of the angle"""
_FOCAL_SHARE, _MIDDLE_SHARE = 1.0, 0.25
"""of the focal length; of the image's size"""


@dataclass(frozen=True)
class Lens:
    """A lens and its image."""

    model: LensModel
    width: int
    height: int
    numbers: Array
    """(9,) as PINHOLE_NAMES, or (8,) as FISHEYE_NAMES"""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the numbers."""
        return FISHEYE_NAMES if self.model is LensModel.FISHEYE else PINHOLE_NAMES

    @property
    def camera_matrix(self) -> Array:
        """(3, 3) px."""
        fx, fy, cx, cy = self.numbers[:4]
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Array:
        """(5,) k1, k2, p1, p2, k3, or (4,)."""
        return self.numbers[4:]

    def moved(self, step: Array) -> Lens:
        """With other numbers."""
        return replace(self, numbers=self.numbers + step)

    def camera(self, T_world_camera: Array | None = None) -> CameraModel:
        """As tracking takes it."""
        place = np.eye(4) if T_world_camera is None else T_world_camera
        return CameraModel(self.width, self.height, self.camera_matrix, self.distortion, place, self.model)


def plain_lens(model: LensModel, width: int, height: int, focal_px: float) -> Lens:
    """Without distortion, its middle that of the image."""
    many = FISHEYE_COEFFICIENTS if model is LensModel.FISHEYE else 5
    return Lens(model, width, height, np.array([focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, *[0.0] * many]))


def prior_sd(lens: Lens) -> Array:
    """1 sigma of each number (p,) before any image is seen: so wide that views which show a number leave nothing of it.

    It keeps what they do not show finite, so that it can be said how little is known.
    """
    focal = float(lens.numbers[:2].mean())
    radius = 0.5 * math.hypot(lens.width, lens.height) / focal
    shares = _SHARES[lens.model]
    bend = [shares[name][0] / radius ** shares[name][1] for name in lens.names[4:]]
    middle = _MIDDLE_SHARE * max(lens.width, lens.height)
    return np.array([_FOCAL_SHARE * focal, _FOCAL_SHARE * focal, middle, middle, *bend])


def project(lens: Lens, points: Array, rotation: Array, translation: Array) -> tuple[Array, Array, Array]:
    """Pixels (n, 2) of points (n, 3), their derivatives by the pose (n, 2, 6), and by the lens's numbers (n, 2, p)."""
    shaped = np.ascontiguousarray(points, dtype=float).reshape(-1, 1, 3)
    if lens.model is LensModel.FISHEYE:
        image, J = cv2.fisheye.projectPoints(shaped, rotation, translation, lens.camera_matrix, lens.distortion)
        derivatives: Array = np.asarray(J, dtype=np.float64).reshape(-1, 2, 15)
        return np.asarray(image, dtype=np.float64).reshape(-1, 2), derivatives[..., 8:14], derivatives[..., :8]
    image, J = cv2.projectPoints(shaped, rotation, translation, lens.camera_matrix, lens.distortion)
    derivatives = np.asarray(J, dtype=np.float64).reshape(len(points), 2, -1)
    return np.asarray(image, dtype=np.float64).reshape(-1, 2), derivatives[..., :6], derivatives[..., 6:15]
