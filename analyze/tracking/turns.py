"""Rotations by their rotation vectors, as OpenCV converts them (Rodrigues 1840)."""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from analyze.types import Array


def rotation_matrix(vector: Array) -> Array:
    """Rotation (3, 3) by a rotation vector (3,) [rad]."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=np.float64))[0], dtype=np.float64)


def rotation_vector(matrix: Array) -> Array:
    """Rotation vector (3,) [rad] of a rotation (3, 3)."""
    return np.asarray(cv2.Rodrigues(matrix)[0], dtype=np.float64).ravel()
