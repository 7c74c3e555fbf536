"""Pose of a square marker from its corners: two solutions, and the choice of one by the motion.

The first guess is infinitesimal plane-based pose estimation (Collins and Bartoli 2014, "Infinitesimal
Plane-Based Pose Estimation"), OpenCV's SOLVEPNP_IPPE_SQUARE; both solutions are refined on the reprojection
error. One image of a small tag does not determine which of them is true. As a body moves smoothly, the
sequence through all frames with the least cost (misfit and turn from frame to frame) is taken (Viterbi).
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from analyze.types import Array

_FRAME_TURN_SD = 0.05
"""standard deviation of the turn between neighbouring frames [rad]; a tip at 6 rad/s turns by 0.05 at 120 fps
"""
_POSE_STEPS = 12
"""most Levenberg-Marquardt steps"""
_POSE_TOLERANCE = 1e-6
"""relative decrease of the sum of squares below which the refinement ends"""


@dataclass(frozen=True)
class PosePair:
    """Both poses (marker frame M to camera frame C) that fit a view of a square marker, the better first."""

    R_camera_marker: Array
    """(2, 3, 3) rotations from M to C"""
    p_camera_marker: Array
    """(2, 3) marker centre in C [m]"""
    error_px: Array
    """(2,) root mean square reprojection error [px]"""


def marker_corners(size: float) -> Array:
    """Corners (4, 3) of a marker in its own frame M [m]: top-left, top-right, bottom-right, bottom-left.

    M has its origin in the marker's centre, x to the right, y up, z towards the viewer.

    Args:
        size: edge of the marker's black square [m].
    """
    h = 0.5 * size
    return np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])


def solve_pose(corners_ideal: Array, size: float, K: Array) -> PosePair | None:
    """Both poses of a square marker in the camera frame C; None if its corners give no pose in front.

    A square seen in one image has two poses that fit about as well.

    Args:
        corners_ideal: (4, 2) distortion-free corners [ideal px]: top-left, top-right, bottom-right,
            bottom-left.
        size: edge of the marker [m].
        K: (3, 3) camera matrix [px].

    Returns:
        Rotations from the marker frame to C, centres in C [m], and rms reprojection errors [px] of both
        solutions, the better first, each refined by Levenberg-Marquardt; twice the same if there is only one.
        None if there is none, as for collinear corners, or if one is not finite or behind the camera. Other
        corners that are no view of a square may give poses with a large error.
    """
    points = marker_corners(size)
    count, rotations, translations, _ = cv2.solvePnPGeneric(
        points, corners_ideal, K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if count < 1:
        return None
    R: list[Array] = []
    p: list[Array] = []
    error: list[float] = []
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
    return (
        pair
        if bool(np.all(np.isfinite(pair.p_camera_marker))) and bool(np.all(pair.p_camera_marker[:, 2] > 0))
        else None
    )


def solve_poses(corners_ideal: Array, size: float, K: Array) -> list[PosePair | None]:
    """Both poses of a square marker in each of n views, refined; None where there is no pose in front.

    The poses are those of `solve_pose` in a fifth of the time; only a second pose that fits badly may be
    refined less far.

    Args:
        corners_ideal: (n, 4, 2) distortion-free corners [ideal px]: top-left, top-right, bottom-right,
            bottom-left.
        size: edge of the marker [m].
        K: (3, 3) camera matrix [px].

    Returns:
        n entries: rotations from the marker frame to the camera frame C, centres in C [m] and rms
        reprojection errors [px] of both poses, the better first; None where the corners give no finite pose
        in front of the camera, as when collinear.
    """
    points = marker_corners(size)
    starts = [
        cv2.solvePnPGeneric(points, corners, K, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)[:3]
        for corners in corners_ideal
    ]
    view = [i for i, (count, rotations, _) in enumerate(starts) if count for _ in rotations]
    found: list[PosePair | None] = [None] * len(starts)
    if not view:
        return found
    rotation = np.array([r for _, rotations, _ in starts for r in rotations], dtype=float).reshape(-1, 3)
    translation = np.array([p for _, _, translations in starts for p in translations], dtype=float).reshape(
        -1, 3
    )
    R, p = _refined(Rotation.from_rotvec(rotation).as_matrix(), translation, points, corners_ideal[view], K)
    off = _reprojected(R, p, points, K)[0] - corners_ideal[view]
    error = np.sqrt(np.mean(off**2, axis=(1, 2)))
    first = np.searchsorted(view, np.arange(len(starts)))
    last = np.searchsorted(view, np.arange(len(starts)), side="right")
    for i, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        if a == b:
            continue
        order = a + np.argsort(error[a:b], kind="stable")
        order = order[[0, -1]]
        if np.all(np.isfinite(p[order])) and np.all(p[order, 2] > 0):
            found[i] = PosePair(R[order], p[order], error[order])
    return found


def _reprojected(R: Array, p: Array, points: Array, K: Array) -> tuple[Array, Array]:
    """Ideal pixels (m, 4, 2) and positions in the camera frame C (m, 4, 3) [m] of marker corners.

    Args:
        R: (m, 3, 3) rotations from the marker frame M to C, one per pose.
        p: (m, 3) positions of the marker in C [m].
        points: (4, 3) corners in M [m].
        K: (3, 3) camera matrix [px].
    """
    in_camera = points @ R.transpose(0, 2, 1) + p[:, None]
    image = in_camera @ K.T
    return image[..., :2] / image[..., 2:], in_camera


def _refined(R: Array, p: Array, points: Array, corners: Array, K: Array) -> tuple[Array, Array]:
    """Marker poses refined on the reprojection error: rotations (m, 3, 3) and positions (m, 3) [m].

    The nearest minimum is found by Levenberg-Marquardt. Rotation and position map the marker frame M to the
    camera frame C.

    Args:
        R: (m, 3, 3) first rotations.
        p: (m, 3) first positions [m].
        points: (4, 3) corners in M [m].
        corners: (m, 4, 2) corners in the images [ideal px].
        K: (3, 3) camera matrix [px].
    """
    many, turn, place = len(R), R, p
    damping = np.full(many, 1e-3)
    seen, in_camera = _reprojected(turn, place, points, K)
    off: Array = corners - seen
    cost = np.sum(off**2, axis=(1, 2))
    for _ in range(_POSE_STEPS):
        J = _by_pose(seen, in_camera, place, K)
        normal = J.transpose(0, 2, 1) @ J
        gradient = (J.transpose(0, 2, 1) @ off.reshape(many, 8, 1))[..., 0]
        diagonal = np.einsum("mii->mi", normal)
        damped = normal + (damping[:, None] * diagonal)[..., None] * np.eye(6)
        step = np.asarray(np.linalg.solve(damped, gradient[..., None]), dtype=np.float64)[..., 0]
        turn_new, place_new = Rotation.from_rotvec(step[:, :3]).as_matrix() @ turn, place + step[:, 3:]
        seen_new, in_camera_new = _reprojected(turn_new, place_new, points, K)
        off_new = corners - seen_new
        cost_new = np.sum(off_new**2, axis=(1, 2))
        better = cost_new <= cost
        gained = np.where(better, cost - cost_new, 0.0)
        turn = np.where(better[:, None, None], turn_new, turn)
        place = np.where(better[:, None], place_new, place)
        seen = np.where(better[:, None, None], seen_new, seen)
        in_camera = np.where(better[:, None, None], in_camera_new, in_camera)
        off = np.asarray(corners - seen, dtype=np.float64)
        cost = np.minimum(cost, cost_new)
        damping = np.clip(np.where(better, 0.1 * damping, 10.0 * damping), 1e-12, 1e6)
        if np.all(better & (gained <= _POSE_TOLERANCE * cost + 1e-18)):
            break
    return turn, place


def _by_pose(seen: Array, in_camera: Array, p: Array, K: Array) -> Array:
    """Derivatives (m, 8, 6) of a square's corner pixels by turns and shifts of its pose, for m poses.

    The pixels are ideal (distortion-free) ones, x and y of four corners. Turns (first) are about the axes of
    the camera frame C through the marker's centre [px/rad], shifts along these axes [px/m].

    Args:
        seen: (m, 4, 2) ideal pixels of the corners.
        in_camera: (m, 4, 3) corners in C [m].
        p: (m, 3) positions of the marker in C [m].
        K: (3, 3) camera matrix [px].
    """
    by_point = (K[:2] - seen[..., None] * K[2]) / in_camera[..., 2, None, None]
    # A turn w moves the point by w x arm.
    by_turn = np.cross((in_camera - p[:, None])[:, :, None, :], by_point)
    J = np.concatenate([by_turn, by_point], axis=-1).reshape(len(p), 8, 6)
    return np.asarray(J, dtype=np.float64)


def position_covariance(R: Array, p: Array, corner_sd_px: Array, size: float, K: Array) -> Array:
    """Covariance (m, 3, 3) [m^2] of marker positions in the camera frame C, caused by corner noise.

    Args:
        R: (m, 3, 3) rotations from the marker frame to C.
        p: (m, 3) positions in C [m].
        corner_sd_px: (m,) standard deviation of the corners [px].
        size: edge of the marker [m].
        K: (3, 3) camera matrix [px].
    """
    seen, in_camera = _reprojected(R, p, marker_corners(size), K)
    J = _by_pose(seen, in_camera, p, K)
    return np.linalg.inv(J.transpose(0, 2, 1) @ J)[:, 3:, 3:] * (corner_sd_px**2)[:, None, None]


def choose_by_motion(pairs: list[PosePair], time_ns: Array, corner_sd_px: Array) -> list[int]:
    """Index (0 or 1) of the pose solution in each frame, by fit to the corners and least turn.

    The path through all frames of least total cost is chosen (Viterbi). Cost of a frame: (reprojection error
    / corner sd)^2 summed over eight coordinates; of a step from frame to frame: (angle between the two
    rotations / 0.05 rad)^2 / elapsed frames.

    Args:
        pairs: both solutions of n frames.
        time_ns: (n,) times [ns].
        corner_sd_px: (n,) standard deviation of the corners [px].

    Returns:
        n indices; empty if there are no frames.
    """
    if not pairs:
        return []
    frame_ns = float(np.median(np.diff(time_ns))) if len(time_ns) > 1 else 1.0
    cost = np.array(
        [8.0 * (pair.error_px / max(sd, 0.01)) ** 2 for pair, sd in zip(pairs, corner_sd_px, strict=True)]
    )
    total = cost[0].copy()
    back = np.zeros((len(pairs), 2), dtype=int)
    for i in range(1, len(pairs)):
        # tr(A^T B) = 1 + 2 cos(angle)
        cosine = 0.5 * (
            np.einsum("aij,bij->ab", pairs[i - 1].R_camera_marker, pairs[i].R_camera_marker) - 1.0
        )
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        steps = max(1.0, float(time_ns[i] - time_ns[i - 1]) / frame_ns)
        path = total[:, None] + (angle / _FRAME_TURN_SD) ** 2 / steps
        back[i] = np.argmin(path, axis=0)
        total = path[back[i], [0, 1]] + cost[i]
    chosen = [int(np.argmin(total))]
    for i in range(len(pairs) - 1, 0, -1):
        chosen.append(int(back[i, chosen[-1]]))
    return chosen[::-1]
