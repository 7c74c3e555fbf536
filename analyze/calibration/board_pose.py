"""Pose of the board in one view: first guess, best fit for a known lens, covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.calibration.lens import Lens, project
from analyze.least_squares.gauss_newton import Linearised, gauss_newton
from analyze.least_squares.robust import huber_weights
from analyze.tracking.camera_model import undistort

if TYPE_CHECKING:
    from analyze.calibration.detect import View
    from analyze.types import Array

MODEL_PX = 0.003
"""least sd of a corner [px]; a worse print or lens shows in the residuals, which then scale the sd"""
HUBER_SIGMAS = 3.0
"""threshold of Huber's loss, in standard deviations of a corner"""
NO_HUBER = float("inf")
"""threshold without robust weights"""


@dataclass(frozen=True)
class Pose:
    """Pose of the board in the camera's frame, as rotation vector and translation.

    x_camera = R x_board + translation [m], R the matrix of the rotation vector.
    """

    rotation: Array
    """(3,) rotation vector [rad]"""
    translation: Array
    """(3,) translation [m]"""

    @property
    def matrix(self) -> Array:
        """Rotation matrix R (3, 3) from the board's frame to the camera's frame."""
        return np.asarray(cv2.Rodrigues(self.rotation)[0], dtype=float)

    def moved(self, step: Array) -> Pose:
        """Copy with `step` (6,) added: 3 entries to the rotation vector [rad], 3 to the translation [m]."""
        return Pose(self.rotation + step[:3], self.translation + step[3:])


@dataclass(frozen=True)
class ObservedView:
    """Corners of the board in one view (image): on the board [m] and in the image [raw px], with weights.

    The weights of a corner are a (2, 2) root of its inverse covariance, in 1/px.
    """

    points: Array
    """(n, 3) corners in the board's frame B [m]"""
    place: Array
    """(n, 2) observed positions of the corners [px]"""
    root: Array
    """(n, 2, 2) matrices that whiten a residual, with root^T root the inverse covariance [1/px]"""


def weighted_corners(view: View, points: Array) -> ObservedView:
    """Corners of the board in a view, with the matrices that weight them in the fit.

    A corner's weight is the inverse of its covariance matrix [px^2]. To the covariance, `MODEL_PX` squared is
    added along both image axes first, so that no corner counts as more accurate than `MODEL_PX`.

    Args:
        view: the m corners seen in one image.
        points: (n, 3) all corners of the board in the board's frame [m].

    Returns:
        Of the corners seen: places in the board's frame (m, 3) [m] and in the image (m, 2) [raw px], and
        matrices root (m, 2, 2) [1/px], with root^T root the weight.
    """
    covariance = view.covariance + MODEL_PX**2 * np.eye(2)
    return ObservedView(
        points[view.index],
        view.place,
        np.asarray(np.linalg.cholesky(np.linalg.inv(covariance)), dtype=np.float64).transpose(0, 2, 1),
    )


def pose_covariance(view: ObservedView, lens: Lens, pose: Pose, lens_covariance: Array) -> Array:
    """Covariance (6, 6) of a board's pose in the camera's frame: rotation vector [rad], translation [m].

    The rotation vector, first in the order, is that from the board's to the camera's frame. The covariance
    includes the errors of the corners and of the lens.

    Args:
        view: corners of the view, whose stated covariance is used.
        lens: the lens, with p numbers.
        pose: best fit of the board's pose in the camera's frame.
        lens_covariance: (p, p) covariance of the lens's numbers.
    """
    _, by_pose, by_lens = whitened(view, lens, pose, NO_HUBER)
    inverse = pseudo_inverse(by_pose.T @ by_pose)
    gain = inverse @ by_pose.T @ by_lens
    return inverse + gain @ lens_covariance @ gain.T


def fit_pose(view: ObservedView, lens: Lens) -> Pose:
    """Pose of the board in the camera's frame that fits one view best, by Huber's loss, for a known lens.

    Args:
        view: corners of the board found in one image.
        lens: the lens, which is not changed.

    Returns:
        Rotation vector (3,) [rad] and translation (3,) [m] from the board's frame to the camera's.
    """
    return _refined_pose(view, lens, first_pose(view, lens), 30, 1e-10)


def _refined_pose(view: ObservedView, lens: Lens, start: Pose, max_steps: int, tolerance: float) -> Pose:
    """Pose of the board near `start` that fits a view's corners best by Huber's loss, by Gauss-Newton.

    The pose maps the board's frame to the camera's: rotation vector [rad] and translation [m]. The lens is
    held fixed. The iteration ends after `max_steps`, or at a step below `tolerance` [rad, m].
    """

    def linearise(pose: Pose) -> Linearised:
        residual, by_pose, _ = whitened(view, lens, pose, HUBER_SIGMAS)
        return Linearised(residual, by_pose)

    return gauss_newton(start, linearise, Pose.moved, max_steps, tolerance)


def pseudo_inverse(matrix: Array) -> Array:
    """Pseudo-inverse (p, p) of a normal matrix, computed on the matrix scaled to a unit diagonal."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix / np.outer(scale, scale), hermitian=True, rcond=1e-15) / np.outer(
        scale, scale
    )


def corner_chi(view: ObservedView, lens: Lens, pose: Pose) -> Array:
    """Distance (n,) of each corner of a view from its projection by lens and pose, in standard deviations.

    A corner's covariance is the inverse of its weight in the fit (`weighted_corners`).
    """
    image, _, _ = project(lens, view.points, pose.rotation, pose.translation)
    return np.asarray(
        np.linalg.norm(np.einsum("nij,nj->ni", view.root, view.place - image), axis=1), dtype=np.float64
    )


def whitened(view: ObservedView, lens: Lens, pose: Pose, huber: float) -> tuple[Array, Array, Array]:
    """Residuals of a view's n corners and their predictions' derivatives, in standard deviations.

    They are whitened (multiplied by the root of the inverse covariance) and weighted by Huber's loss.

    Args:
        view: corners of the view.
        lens: the lens, with p numbers.
        pose: pose of the board.
        huber: threshold of Huber's loss, in standard deviations.

    Returns:
        Residuals (2n,), observed less predicted; derivatives of the predictions by the pose (2n, 6: rotation
        vector, translation) and by the lens's numbers (2n, p).
    """
    image, by_pose, by_lens = project(lens, view.points, pose.rotation, pose.translation)
    residual = np.einsum("nij,nj->ni", view.root, view.place - image)
    weight = np.sqrt(huber_weights(np.linalg.norm(residual, axis=1), huber))
    root = view.root * weight[:, None, None]
    return (
        (residual * weight[:, None]).reshape(-1),
        (root @ by_pose).reshape(-1, 6),
        (root @ by_lens).reshape(2 * len(image), -1),
    )


def _rays(lens: Lens, place: Array) -> Array:
    """Viewing directions (n, 2) of pixels, as X/Z and Y/Z in the camera's frame.

    Pixels beyond the lens's range, which have no direction, get one far outside the image (5 image widths).

    Args:
        lens: the lens.
        place: (n, 2) raw pixels, column and row, as in the image.
    """
    ideal = np.nan_to_num(undistort(lens.camera(), place), nan=5.0 * lens.width)
    return (ideal - lens.numbers[2:4]) / lens.numbers[:2]


def _planar(view: ObservedView, lens: Lens) -> list[Pose]:
    """Poses of the board that fit a view's corners: none, one or two, all in front of the camera.

    A pose maps the board's frame to the camera's: rotation vector [rad] and translation [m]. One image of a
    plane can often be explained by two poses, tilted in opposite ways. They are computed in closed form from
    the corners' viewing directions.
    """
    rays = _rays(lens, view.place)
    middle = view.points.mean(axis=0)
    count, rotations, translations, _ = cv2.solvePnPGeneric(
        view.points - middle, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
    )
    found: list[Pose] = []
    for rotation, translation in zip(rotations[:count], translations[:count], strict=True):
        R = np.asarray(cv2.Rodrigues(rotation)[0], dtype=float)
        moved = np.asarray(translation, dtype=float).ravel() - R @ middle
        if np.all(np.isfinite(moved)) and translation[2] > 0:
            found.append(Pose(np.asarray(rotation, dtype=float).ravel(), moved))
    return found


def _misfit(view: ObservedView, lens: Lens, pose: Pose) -> float:
    """Sum of squared distances [raw px^2] between a view's observed and predicted corners.

    The corners are predicted with `lens` (including its distortion) and the board's pose `pose`.
    """
    image, _, _ = project(lens, view.points, pose.rotation, pose.translation)
    return float(np.sum((view.place - image) ** 2))


def first_pose(view: ObservedView, lens: Lens) -> Pose:
    """First guess of the board's pose in a view: the better of the two poses that may explain its image.

    If neither can be computed, the board is taken to face the camera, at the distance that follows from its
    size in the image.
    """
    found = _planar(view, lens)
    if not found:
        depth = float(np.ptp(view.points[:, :2])) * lens.numbers[0] / max(float(np.ptp(view.place)), 1.0)
        return Pose(np.array([np.pi, 0.0, 0.0]), np.array([0.0, 0.0, depth]))
    return min(found, key=lambda pose: _misfit(view, lens, pose))


def better_pose(view: ObservedView, lens: Lens, pose: Pose) -> Pose:
    """Try the other pose that may explain a view's image of the board; return it if it fits better.

    An image of a plane can often be explained by two poses, tilted in opposite ways. Better means a sum of
    squared distances (observed to predicted corners) that is at least 2 % smaller.

    Args:
        view: corners of the view.
        lens: the lens.
        pose: pose of the board found so far.

    Returns:
        The other pose, refined; the object `pose` itself if none fits better.
    """
    best, least = pose, _misfit(view, lens, pose)
    for other in _planar(view, lens):
        refined = _refined_pose(view, lens, other, 8, 1e-7)
        if refined.translation[2] > 0 and _misfit(view, lens, refined) < 0.98 * least:
            best, least = refined, _misfit(view, lens, refined)
    return best
