"""Lens and poses of the board together: weighted least squares on the corners (bundle adjustment), with the lens's covariance.

Levenberg-Marquardt on the normal equations, poses eliminated view by view (Schur complement; Triggs et al. 2000, "Bundle adjustment:
a modern synthesis"). Each corner counts by its own covariance, and less the farther it lies from the rest (Huber). Weak priors keep what
the views do not show finite: see `lens.prior_sd`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.calibration.lens import Lens, plain_lens, prior_sd, project
from analyze.tracking.camera_model import undistort
from schemas.session_manifest import LensModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.calibration.detect import View
    from analyze.types import Array

MODEL_PX = 0.003
"""px, what no corner is better than; a print or a lens that is worse shows in the residuals, and is scaled for"""
_HUBER = 3.0
"""sigmas, of the scatter that most corners show"""
_FEW_VIEWS = 8
"""enough to tell which focal length to begin with"""
_PLAIN = float("inf")
_STARTS = (0.25, 0.4, 0.6, 0.9, 1.4, 2.2, 3.5)
"""focal lengths to begin with, in image widths"""
MEDIAN_CHI = 1.177
"""with two degrees of freedom"""
_MOST_STEPS = 80
_CONVERGED = 1e-6
"""of a prior's sd or a hundredth of a parameter's own"""


@dataclass(frozen=True)
class Pose:
    """Of the board: x_camera = R x_board + translation."""

    rotation: Array
    """(3,) rotation vector"""
    translation: Array
    """(3,) m"""

    @property
    def matrix(self) -> Array:
        """(3, 3)."""
        return np.asarray(cv2.Rodrigues(self.rotation)[0], dtype=float)


@dataclass(frozen=True)
class Observed:
    """One view as the solver takes it."""

    points: Array
    """(n, 3) m in B"""
    place: Array
    """(n, 2) px"""
    root: Array
    """(n, 2, 2) 1/px: whitens a residual"""


@dataclass(frozen=True)
class Bundle:
    """What fits best."""

    lens: Lens
    poses: tuple[Pose, ...]
    residuals: tuple[Array, ...]
    """per view (n, 2) px"""
    sigmas: tuple[Array, ...]
    """per view (n,) how many of its own sd each corner lies off, over both directions: chi, 2 degrees of freedom"""
    covariance: Array
    """(p, p) of the lens's numbers, by the corners' own sd"""
    cost: float

    def scatter(self) -> float:
        """Factor on the corners' own sd that the residuals show, at least 1."""
        chi2 = np.concatenate(self.sigmas) ** 2
        freedom = 2 * len(chi2) - len(self.lens.numbers) - 6 * len(self.poses)
        return float(np.sqrt(max(1.0, chi2.sum() / max(freedom, 1))))


def observed(view: View, points: Array) -> Observed:
    """The view's corners with their weights; `points` are all of the board's (n, 3)."""
    covariance = view.covariance + MODEL_PX**2 * np.eye(2)
    return Observed(
        points[view.index], view.place, np.asarray(np.linalg.cholesky(np.linalg.inv(covariance)), dtype=np.float64).transpose(0, 2, 1)
    )


def solve(views: Sequence[Observed], model: LensModel, width: int, height: int) -> Bundle:
    """From nothing: the best of several focal lengths to begin with."""
    some = views[:: -(-len(views) // _FEW_VIEWS)]
    found: list[tuple[float, Lens]] = []
    for share in _STARTS:
        lens = plain_lens(model, width, height, share * width)
        lens, _, cost = _minimise(some, lens, [_first_pose(view, lens) for view in some], 6, _HUBER)
        found.append((cost, lens))
    found.sort(key=lambda each: each[0])
    bundles = [resolve(views, lens, [_first_pose(view, lens) for view in views]) for _, lens in found[:2]]
    return min(bundles, key=lambda bundle: bundle.cost)


def resolve(views: Sequence[Observed], lens: Lens, poses: Sequence[Pose]) -> Bundle:
    """From a good start. A board seen nearly face-on has a second pose that fits nearly as well: both are tried."""
    lens, settled, cost = _minimise(views, lens, list(poses), _MOST_STEPS, _HUBER)
    turned = [_better_pose(view, lens, pose) for view, pose in zip(views, settled, strict=True)]
    if any(new is not old for new, old in zip(turned, settled, strict=True)):
        again = _minimise(views, lens, turned, _MOST_STEPS, _HUBER)
        if again[2] < cost:
            lens, settled, cost = again
    # Where all corners lie farther off than their own noise, that is the scale by which one of them is an outlier.
    usual = float(np.median(np.concatenate([_chi(view, lens, pose) for view, pose in zip(views, settled, strict=True)]))) / MEDIAN_CHI
    if usual > 1.1:
        lens, settled, _ = _minimise(views, lens, settled, _MOST_STEPS, _HUBER * usual)
    pairs = list(zip(views, settled, strict=True))
    residuals = tuple(view.place - project(lens, view.points, pose.rotation, pose.translation)[0] for view, pose in pairs)
    sigmas = tuple(_chi(view, lens, pose) for view, pose in pairs)
    information = _normal(views, lens, settled, prior_sd(lens), _PLAIN).reduced
    return Bundle(lens, tuple(settled), residuals, sigmas, _inverse(information), cost)


def pose_covariance(view: Observed, lens: Lens, pose: Pose, lens_covariance: Array) -> Array:
    """(6, 6) of rotation vector and translation, with what the lens's own error does to them."""
    _, by_pose, by_lens = _whitened(view, lens, pose, _PLAIN)
    inverse = _inverse(by_pose.T @ by_pose)
    gain = inverse @ by_pose.T @ by_lens
    return inverse + gain @ lens_covariance @ gain.T


def fit_pose(view: Observed, lens: Lens) -> Pose:
    """The board's pose by a lens that is known."""
    pose = _first_pose(view, lens)
    for _ in range(30):
        residual, by_pose, _ = _whitened(view, lens, pose, _HUBER)
        step = _inverse(by_pose.T @ by_pose) @ (by_pose.T @ residual)
        pose = Pose(pose.rotation + step[:3], pose.translation + step[3:])
        if float(np.abs(step).max()) < 1e-10:
            break
    return pose


# --- inside -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Normal:
    reduced: Array
    """(p, p)"""
    gradient: Array
    """(p,)"""
    pose_information: list[Array]
    cross: list[Array]
    pose_gradient: list[Array]


def _inverse(matrix: Array) -> Array:
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix / np.outer(scale, scale), hermitian=True, rcond=1e-15) / np.outer(scale, scale)


def _chi(view: Observed, lens: Lens, pose: Pose) -> Array:
    image, _, _ = project(lens, view.points, pose.rotation, pose.translation)
    return np.asarray(np.linalg.norm(np.einsum("nij,nj->ni", view.root, view.place - image), axis=1), dtype=np.float64)


def _whitened(view: Observed, lens: Lens, pose: Pose, huber: float) -> tuple[Array, Array, Array]:
    """Residual (2n,), derivatives by pose (2n, 6) and lens (2n, p), in sigmas, each corner weighted as Huber says."""
    image, by_pose, by_lens = project(lens, view.points, pose.rotation, pose.translation)
    residual = np.einsum("nij,nj->ni", view.root, view.place - image)
    weight = np.sqrt(np.minimum(1.0, huber / np.maximum(np.linalg.norm(residual, axis=1), 1e-9)))
    root = view.root * weight[:, None, None]
    return (residual * weight[:, None]).reshape(-1), (root @ by_pose).reshape(-1, 6), (root @ by_lens).reshape(2 * len(image), -1)


def _normal(views: Sequence[Observed], lens: Lens, poses: Sequence[Pose], prior: Array, huber: float, damping: float = 0.0) -> _Normal:
    start = plain_lens(lens.model, lens.width, lens.height, float(lens.numbers[:2].mean()))
    information = np.diag(1.0 / prior**2)
    gradient = (start.numbers - lens.numbers) / prior**2
    pose_information: list[Array] = []
    cross: list[Array] = []
    pose_gradient: list[Array] = []
    for view, pose in zip(views, poses, strict=True):
        residual, by_pose, by_lens = _whitened(view, lens, pose, huber)
        V = by_pose.T @ by_pose
        V[np.diag_indices(6)] *= 1.0 + damping
        information += by_lens.T @ by_lens
        gradient += by_lens.T @ residual
        pose_information.append(V)
        cross.append(by_lens.T @ by_pose)
        pose_gradient.append(by_pose.T @ residual)
    reduced = information.copy()
    reduced[np.diag_indices(len(reduced))] += damping * np.diag(information)
    for V, W, g in zip(pose_information, cross, pose_gradient, strict=True):
        gain = np.linalg.solve(V, W.T).T
        reduced -= gain @ W.T
        gradient = gradient - gain @ g
    return _Normal(reduced, gradient, pose_information, cross, pose_gradient)


def _cost(views: Sequence[Observed], lens: Lens, poses: Sequence[Pose], prior: Array, huber: float) -> float:
    start = plain_lens(lens.model, lens.width, lens.height, float(lens.numbers[:2].mean()))
    total = float(np.sum(((lens.numbers - start.numbers) / prior) ** 2))
    for view, pose in zip(views, poses, strict=True):
        if pose.translation[2] <= 0:
            return float("inf")
        chi = _chi(view, lens, pose)
        total += float(np.sum(np.where(chi < huber, chi**2, huber * (2 * chi - huber))))
    return total if np.isfinite(total) else float("inf")


def _minimise(views: Sequence[Observed], lens: Lens, poses: list[Pose], most: int, huber: float) -> tuple[Lens, list[Pose], float]:
    prior = prior_sd(lens)
    cost, damping = _cost(views, lens, poses, prior, huber), 1e-3
    for _ in range(most):
        normal = _normal(views, lens, poses, prior, huber, damping)
        try:
            step: Array = np.asarray(np.linalg.solve(normal.reduced, normal.gradient), dtype=np.float64)
        except np.linalg.LinAlgError:
            break
        moved = lens.moved(step)
        turned = [
            _stepped(pose, np.asarray(np.linalg.solve(V, g - W.T @ step), dtype=np.float64))
            for pose, V, W, g in zip(poses, normal.pose_information, normal.cross, normal.pose_gradient, strict=True)
        ]
        focal_fits = bool(np.all((moved.numbers[:2] > 0.05 * lens.width) & (moved.numbers[:2] < 50.0 * lens.width)))
        new = _cost(views, moved, turned, prior, huber) if focal_fits else float("inf")
        if new < cost:
            still = float(np.max(np.abs(step) / prior)) < _CONVERGED and cost - new < 1e-9 * cost
            lens, poses, cost, damping = moved, turned, new, max(damping / 10.0, 1e-12)
            if still:
                break
        else:
            damping *= 10.0
            if damping > 1e8:
                break
    return lens, poses, cost


def _stepped(pose: Pose, step: Array) -> Pose:
    return Pose(pose.rotation + step[:3], pose.translation + step[3:])


def _rays(lens: Lens, place: Array) -> Array:
    """(n, 2) X/Z, Y/Z; what a lens cannot see is put at its rim."""
    ideal = np.nan_to_num(undistort(lens.camera(), place), nan=5.0 * lens.width)
    return (ideal - lens.numbers[2:4]) / lens.numbers[:2]


def _planar(view: Observed, lens: Lens) -> list[Pose]:
    rays = _rays(lens, view.place)
    middle = view.points.mean(axis=0)
    count, rotations, translations, _ = cv2.solvePnPGeneric(view.points - middle, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
    found: list[Pose] = []
    for rotation, translation in zip(rotations[:count], translations[:count], strict=True):
        R = np.asarray(cv2.Rodrigues(rotation)[0], dtype=float)
        moved = np.asarray(translation, dtype=float).ravel() - R @ middle
        if np.all(np.isfinite(moved)) and translation[2] > 0:
            found.append(Pose(np.asarray(rotation, dtype=float).ravel(), moved))
    return found


def _misfit(view: Observed, lens: Lens, pose: Pose) -> float:
    image, _, _ = project(lens, view.points, pose.rotation, pose.translation)
    return float(np.sum((view.place - image) ** 2))


def _first_pose(view: Observed, lens: Lens) -> Pose:
    found = _planar(view, lens)
    if not found:
        depth = float(np.ptp(view.points[:, :2])) * lens.numbers[0] / max(float(np.ptp(view.place)), 1.0)
        return Pose(np.array([np.pi, 0.0, 0.0]), np.array([0.0, 0.0, depth]))
    return min(found, key=lambda pose: _misfit(view, lens, pose))


def _better_pose(view: Observed, lens: Lens, pose: Pose) -> Pose:
    """The other of the two poses of a plane, where it fits better."""
    best, least = pose, _misfit(view, lens, pose)
    for other in _planar(view, lens):
        refined = other
        for _ in range(8):
            residual, by_pose, _ = _whitened(view, lens, refined, _HUBER)
            step = _inverse(by_pose.T @ by_pose) @ (by_pose.T @ residual)
            refined = _stepped(refined, step)
            if float(np.abs(step).max()) < 1e-7:
                break
        if refined.translation[2] > 0 and _misfit(view, lens, refined) < 0.98 * least:
            best, least = refined, _misfit(view, lens, refined)
    return best
