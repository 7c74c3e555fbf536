"""Bundle adjustment: fit of a lens and of the board's poses to the corners in all views.

Weighted least squares with covariance: Levenberg-Marquardt on the normal equations, poses eliminated view by
view (Schur complement; Triggs et al. 2000, "Bundle adjustment: a modern synthesis"). Each corner is weighted
by its own covariance, and by Huber's loss. Weak priors keep undetermined numbers finite: see `lens.prior_sd`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.calibration.board_pose import (
    HUBER_SIGMAS,
    NO_HUBER,
    ObservedView,
    Pose,
    better_pose,
    corner_chi,
    first_pose,
    pseudo_inverse,
    whitened,
)
from analyze.calibration.lens import Lens, plain_lens, prior_sd, project
from schemas.session_manifest import LensModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import Array

_START_VIEWS = 8
"""number of views that suffice to choose the first focal length"""
_START_FOCALS = (0.25, 0.4, 0.6, 0.9, 1.4, 2.2, 3.5)
"""first focal lengths that are tried [image widths]"""
MEDIAN_CHI = 1.177
"""median of chi (distance over standard deviation) with two degrees of freedom"""
_MAX_STEPS = 80
_STEP_TOLERANCE = 1e-6
"""step of the lens's numbers, over their prior sd, below which the iteration ends"""


@dataclass(frozen=True)
class Bundle:
    """Best fit of the lens and of the board's pose in each view, with the corners' residuals."""

    lens: Lens
    """best fit of the lens, with p numbers (focal lengths, principal point, distortion)"""
    poses: tuple[Pose, ...]
    """pose of the board per view"""
    residuals: tuple[Array, ...]
    """per view (n, 2) residuals, observed less predicted position [px]"""
    sigmas: tuple[Array, ...]
    """per view (n,) distance of each corner from its prediction over its sd: chi with 2 degrees of freedom"""
    covariance: Array
    """(p, p) covariance of the lens's numbers, from the corners' stated sd and the priors"""
    cost: float
    """least value of Huber's loss with priors, in squared standard deviations, before a refit with a wider
    threshold"""

    def scatter(self) -> float:
        """Factor, at least 1, by which the residuals exceed the corners' stated standard deviation.

        It is the root of chi^2 per degree of freedom; chi^2 is the sum of squares of all corners' distances
        from their predictions, in standard deviations.
        """
        chi2 = np.concatenate(self.sigmas) ** 2
        freedom = 2 * len(chi2) - len(self.lens.numbers) - 6 * len(self.poses)
        return float(np.sqrt(max(1.0, chi2.sum() / max(freedom, 1))))


def solve(views: Sequence[ObservedView], model: LensModel, width: int, height: int) -> Bundle:
    """Fit a lens and the board's poses to views, without a first guess.

    Several focal lengths (`_START_FOCALS`) are tried on some of the views; the fit to all views starts from
    each of the two best.

    Args:
        views: corners of each view, at least one view.
        model: lens model.
        width: image width [px].
        height: image height [px].

    Returns:
        The better of the two fits: lens with covariance, pose of the board and corners' residuals [px] per
        view.
    """
    some = views[:: -(-len(views) // _START_VIEWS)]
    found: list[tuple[float, Lens]] = []
    for share in _START_FOCALS:
        lens = plain_lens(model, width, height, share * width)
        lens, _, cost = _minimise(some, lens, [first_pose(view, lens) for view in some], 6, HUBER_SIGMAS)
        found.append((cost, lens))
    found.sort(key=lambda each: each[0])
    bundles = [
        refine_bundle(views, lens, [first_pose(view, lens) for view in views]) for _, lens in found[:2]
    ]
    return min(bundles, key=lambda bundle: bundle.cost)


def refine_bundle(views: Sequence[ObservedView], lens: Lens, poses: Sequence[Pose]) -> Bundle:
    """Fit a lens and the board's poses to views, from a good first guess.

    A board seen nearly face-on has a second pose that fits nearly as well: both are tried. If the corners
    scatter more than stated, Huber's threshold is widened accordingly.

    Args:
        views: corners of each view.
        lens: first guess of the lens.
        poses: first guess of the board's pose per view.

    Returns:
        The best fit of lens and poses, with residuals and the lens's covariance.
    """
    lens, settled, cost = _minimise(views, lens, list(poses), _MAX_STEPS, HUBER_SIGMAS)
    turned = [better_pose(view, lens, pose) for view, pose in zip(views, settled, strict=True)]
    if any(new is not old for new, old in zip(turned, settled, strict=True)):
        again = _minimise(views, lens, turned, _MAX_STEPS, HUBER_SIGMAS)
        if again[2] < cost:
            lens, settled, cost = again
    # If all corners lie farther off than their own noise, outliers are relative to that scale.
    chi = [corner_chi(view, lens, pose) for view, pose in zip(views, settled, strict=True)]
    usual = float(np.median(np.concatenate(chi))) / MEDIAN_CHI
    if usual > 1.1:
        lens, settled, _ = _minimise(views, lens, settled, _MAX_STEPS, HUBER_SIGMAS * usual)
    pairs = list(zip(views, settled, strict=True))
    residuals = tuple(
        view.place - project(lens, view.points, pose.rotation, pose.translation)[0] for view, pose in pairs
    )
    sigmas = tuple(corner_chi(view, lens, pose) for view, pose in pairs)
    information = _normal(views, lens, settled, prior_sd(lens), NO_HUBER).reduced
    return Bundle(lens, tuple(settled), residuals, sigmas, pseudo_inverse(information), cost)


@dataclass(frozen=True)
class _Normal:
    """Normal equations of a fit of lens (p numbers) and poses, with the poses eliminated.

    The parts from which the poses follow are kept.
    """

    reduced: Array
    """(p, p) normal matrix of the lens's p numbers after elimination of the poses"""
    gradient: Array
    """(p,) right-hand side of the lens's p numbers after elimination of the poses"""
    pose_information: list[Array]
    """per view (6, 6) normal matrix of the pose"""
    cross: list[Array]
    """per view (p, 6) block of the normal matrix that couples lens and pose"""
    pose_gradient: list[Array]
    """per view (6,) right-hand side of the pose"""


def _normal(
    views: Sequence[ObservedView],
    lens: Lens,
    poses: Sequence[Pose],
    prior: Array,
    huber: float,
    damping: float = 0.0,
) -> _Normal:
    """Normal equations of a fit of lens and poses, with the poses eliminated.

    `damping` times its diagonal is added to each normal matrix.

    Args:
        views: corners of each view.
        lens: present lens.
        poses: present pose of the board per view.
        prior: (p,) prior standard deviations of the lens's p numbers about the undistorted lens.
        huber: threshold of Huber's loss, in standard deviations.
        damping: factor of Levenberg and Marquardt.

    Returns:
        Normal matrix (p, p) and right-hand side (p,) of the lens alone; and per view the blocks from which
        the change of its pose follows: normal matrix (6, 6) and right-hand side (6,) of the pose, and the
        block (p, 6) that couples lens and pose.
    """
    start = plain_lens(lens.model, lens.width, lens.height, float(lens.numbers[:2].mean()))
    information = np.diag(1.0 / prior**2)
    gradient = (start.numbers - lens.numbers) / prior**2
    pose_information: list[Array] = []
    cross: list[Array] = []
    pose_gradient: list[Array] = []
    for view, pose in zip(views, poses, strict=True):
        residual, by_pose, by_lens = whitened(view, lens, pose, huber)
        own = by_pose.T @ by_pose
        own[np.diag_indices(6)] *= 1.0 + damping
        information += by_lens.T @ by_lens
        gradient += by_lens.T @ residual
        pose_information.append(own)
        cross.append(by_lens.T @ by_pose)
        pose_gradient.append(by_pose.T @ residual)
    reduced = information.copy()
    reduced[np.diag_indices(len(reduced))] += damping * np.diag(information)
    for V, W, g in zip(pose_information, cross, pose_gradient, strict=True):
        gain = np.linalg.solve(V, W.T).T
        reduced -= gain @ W.T
        gradient = gradient - gain @ g
    return _Normal(reduced, gradient, pose_information, cross, pose_gradient)


def _cost(
    views: Sequence[ObservedView], lens: Lens, poses: Sequence[Pose], prior: Array, huber: float
) -> float:
    """Cost of a fit: Huber's loss over all corners plus the squared deviations from the prior lens.

    Both are in squared standard deviations. Infinite for a board behind the camera, and where the loss is
    not a number.

    Args:
        views: corners of each view.
        lens: the lens.
        poses: pose of the board per view.
        prior: (p,) prior standard deviations of the lens's numbers about the undistorted lens.
        huber: threshold of Huber's loss, in standard deviations.
    """
    start = plain_lens(lens.model, lens.width, lens.height, float(lens.numbers[:2].mean()))
    total = float(np.sum(((lens.numbers - start.numbers) / prior) ** 2))
    for view, pose in zip(views, poses, strict=True):
        if pose.translation[2] <= 0:
            return float("inf")
        chi = corner_chi(view, lens, pose)
        total += float(np.sum(np.where(chi < huber, chi**2, huber * (2 * chi - huber))))
    return total if np.isfinite(total) else float("inf")


def _minimise(
    views: Sequence[ObservedView], lens: Lens, poses: list[Pose], max_steps: int, huber: float
) -> tuple[Lens, list[Pose], float]:
    """Fit lens and poses by Levenberg-Marquardt, starting from a first guess.

    The sum of Huber's loss over all corners and of the squared deviations of the lens from its prior is
    minimised, both in squared standard deviations.

    Args:
        views: corners of each view.
        lens: first guess of the lens, whose focal length also sets the prior.
        poses: first guess of the board's pose per view.
        max_steps: largest number of iterations.
        huber: threshold of Huber's loss, in standard deviations.

    Returns:
        Lens, board's pose (rotation vector [rad], translation [m]) per view, and the minimised sum, all at
        the end of the iteration.
    """
    prior = prior_sd(lens)
    cost, damping = _cost(views, lens, poses, prior, huber), 1e-3
    for _ in range(max_steps):
        normal = _normal(views, lens, poses, prior, huber, damping)
        try:
            step: Array = np.asarray(np.linalg.solve(normal.reduced, normal.gradient), dtype=np.float64)
        except np.linalg.LinAlgError:
            break
        moved = lens.moved(step)
        turned = [
            pose.moved(np.asarray(np.linalg.solve(V, g - W.T @ step), dtype=np.float64))
            for pose, V, W, g in zip(
                poses, normal.pose_information, normal.cross, normal.pose_gradient, strict=True
            )
        ]
        focal = moved.numbers[:2]
        focal_fits = bool(np.all((focal > 0.05 * lens.width) & (focal < 50.0 * lens.width)))
        new = _cost(views, moved, turned, prior, huber) if focal_fits else float("inf")
        if new < cost:
            still = float(np.max(np.abs(step) / prior)) < _STEP_TOLERANCE and cost - new < 1e-9 * cost
            lens, poses, cost, damping = moved, turned, new, max(damping / 10.0, 1e-12)
            if still:
                break
        else:
            damping *= 10.0
            if damping > 1e8:
                break
    return lens, poses, cost
