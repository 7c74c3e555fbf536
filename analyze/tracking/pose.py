"""Pose of one square marker, with the second solution that a square seen face-on always has, and the choice between them by the motion.

Start: infinitesimal plane-based pose estimation (Collins and Bartoli 2014, "Infinitesimal Plane-Based Pose Estimation"), OpenCV's
SOLVEPNP_IPPE_SQUARE; both solutions are refined on the reprojection error. One image cannot tell them apart where the tag is small;
a body moves smoothly, so the cheapest path through all frames can (Viterbi).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from analyze.types import Array

_TURN_SD = 0.05
"""rad between neighbouring frames; a tip at 6 rad/s turns by 0.05 at 120 fps"""


@dataclass(frozen=True)
class PosePair:
    """Both solutions of one view, the better one first."""

    R_camera_marker: Array
    """(2, 3, 3)"""
    p_camera_marker: Array
    """(2, 3) m"""
    error_px: Array
    """(2,) root mean square reprojection error"""


def marker_corners(size: float) -> Array:
    """Corners (4, 3) in M [m]: top-left, top-right, bottom-right, bottom-left."""
    h = 0.5 * size
    return np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])


def solve_pose(corners_ideal: Array, size: float, K: Array) -> PosePair | None:
    """Both poses of a square marker from its ideal (distortion-free) corners (4, 2), or None where the four points are no square's view."""
    points = marker_corners(size)
    count, rotations, translations, _ = cv2.solvePnPGeneric(points, corners_ideal, K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    if count < 1:
        return None
    R, p, error = [], [], []
    for rotation, translation in zip(rotations, translations, strict=True):
        refined_r, refined_t = cv2.solvePnPRefineLM(points, corners_ideal, K, None, rotation, translation)
        matrix = np.asarray(cv2.Rodrigues(refined_r)[0], dtype=float)
        position = np.asarray(refined_t, dtype=float).ravel()
        image = (points @ matrix.T + position) @ K.T
        R.append(matrix)
        p.append(position)
        error.append(float(np.sqrt(np.mean((image[:, :2] / image[:, 2:] - corners_ideal) ** 2))))
    order = np.argsort(error, kind="stable")
    if len(order) == 1:
        order = np.array([0, 0])
    pair = PosePair(np.array(R)[order], np.array(p)[order], np.array(error)[order])
    return pair if bool(np.all(np.isfinite(pair.p_camera_marker))) and bool(np.all(pair.p_camera_marker[:, 2] > 0)) else None


def choose_by_motion(pairs: list[PosePair], time_ns: Array, corner_sd_px: Array) -> list[int]:
    """Index (0 or 1) of the solution per frame along the path that fits the corners and turns least.

    Cost of a frame: (error / sd)^2 summed over eight coordinates; of a step: (angle / turn sd)^2 / elapsed frames.
    """
    if not pairs:
        return []
    frame_ns = float(np.median(np.diff(time_ns))) if len(time_ns) > 1 else 1.0
    cost = np.array([8.0 * (pair.error_px / max(sd, 0.01)) ** 2 for pair, sd in zip(pairs, corner_sd_px, strict=True)])
    total = cost[0].copy()
    back = np.zeros((len(pairs), 2), dtype=int)
    for i in range(1, len(pairs)):
        # tr(A^T B) = 1 + 2 cos(angle)
        cosine = 0.5 * (np.einsum("aij,bij->ab", pairs[i - 1].R_camera_marker, pairs[i].R_camera_marker) - 1.0)
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        steps = max(1.0, float(time_ns[i] - time_ns[i - 1]) / frame_ns)
        path = total[:, None] + (angle / _TURN_SD) ** 2 / steps
        back[i] = np.argmin(path, axis=0)
        total = path[back[i], [0, 1]] + cost[i]
    chosen = [int(np.argmin(total))]
    for i in range(len(pairs) - 1, 0, -1):
        chosen.append(int(back[i, chosen[-1]]))
    return chosen[::-1]
