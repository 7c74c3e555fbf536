"""Bundle adjustment: fit of a lens and of the board's poses to the corners in all views.

Weighted least squares with covariance: Levenberg-Marquardt on the normal equations, poses eliminated view by
view (Schur complement; Triggs et al. 2000, "Bundle adjustment: a modern synthesis"). Each corner is weighted
by its own covariance, and by Huber's loss. Weak priors keep undetermined numbers finite: see `lens.prior_sd`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.calibration.lens import Lens, plain_lens, prior_sd, project
from analyze.least_squares.gauss_newton import Linearised, gauss_newton
from analyze.least_squares.robust import huber_weights
from analyze.tracking.camera_model import undistort
from schemas.session_manifest import LensModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.calibration.detect import View
    from analyze.types import Array

MODEL_PX = 0.003
"""least sd of a corner [px]; a worse print or lens shows in the residuals, which then scale the sd"""
_HUBER_SIGMAS = 3.0
"""threshold of Huber's loss, in standard deviations of a corner"""
_START_VIEWS = 8
"""number of views that suffice to choose the first focal length"""
_NO_HUBER = float("inf")
"""threshold without robust weights"""
_START_FOCALS = (0.25, 0.4, 0.6, 0.9, 1.4, 2.2, 3.5)
"""first focal lengths that are tried [image widths]"""
MEDIAN_CHI = 1.177
"""median of chi (distance over standard deviation) with two degrees of freedom"""
_MAX_STEPS = 80
_STEP_TOLERANCE = 1e-6
"""step of the lens's numbers, over their prior sd, below which the iteration ends"""


@dataclass(frozen=True)
class Pose:
    """Pose of the board in the camera's frame: x_camera = R x_board + translation, R from `rotation`."""

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
    """Corners of the board in one view (image), with their weights in the fit."""

    points: Array
    """(n, 3) corners in the board's frame B [m]"""
    place: Array
    """(n, 2) observed positions of the corners [px]"""
    root: Array
    """(n, 2, 2) matrices that whiten a residual, with root^T root the inverse covariance [1/px]"""


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

        It is the root of the sum of squared `sigmas` over the degrees of freedom.
        """
        chi2 = np.concatenate(self.sigmas) ** 2
        freedom = 2 * len(chi2) - len(self.lens.numbers) - 6 * len(self.poses)
        return float(np.sqrt(max(1.0, chi2.sum() / max(freedom, 1))))


def weighted_corners(view: View, points: Array) -> ObservedView:
    """Corners of a view with their weights in the fit.

    The weight is the inverse of the corner's covariance, to which `MODEL_PX` squared is added.

    Args:
        view: corners of the board in one image.
        points: (n, 3) all corners of the board in the board's frame [m].
    """
    covariance = view.covariance + MODEL_PX**2 * np.eye(2)
    return ObservedView(
        points[view.index],
        view.place,
        np.asarray(np.linalg.cholesky(np.linalg.inv(covariance)), dtype=np.float64).transpose(0, 2, 1),
    )


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
        The better of the two fits.
    """
    some = views[:: -(-len(views) // _START_VIEWS)]
    found: list[tuple[float, Lens]] = []
    for share in _START_FOCALS:
        lens = plain_lens(model, width, height, share * width)
        lens, _, cost = _minimise(some, lens, [_first_pose(view, lens) for view in some], 6, _HUBER_SIGMAS)
        found.append((cost, lens))
    found.sort(key=lambda each: each[0])
    bundles = [
        refine_bundle(views, lens, [_first_pose(view, lens) for view in views]) for _, lens in found[:2]
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
    lens, settled, cost = _minimise(views, lens, list(poses), _MAX_STEPS, _HUBER_SIGMAS)
    turned = [_better_pose(view, lens, pose) for view, pose in zip(views, settled, strict=True)]
    if any(new is not old for new, old in zip(turned, settled, strict=True)):
        again = _minimise(views, lens, turned, _MAX_STEPS, _HUBER_SIGMAS)
        if again[2] < cost:
            lens, settled, cost = again
    # If all corners lie farther off than their own noise, outliers are relative to that scale.
    chi = [_chi(view, lens, pose) for view, pose in zip(views, settled, strict=True)]
    usual = float(np.median(np.concatenate(chi))) / MEDIAN_CHI
    if usual > 1.1:
        lens, settled, _ = _minimise(views, lens, settled, _MAX_STEPS, _HUBER_SIGMAS * usual)
    pairs = list(zip(views, settled, strict=True))
    residuals = tuple(
        view.place - project(lens, view.points, pose.rotation, pose.translation)[0] for view, pose in pairs
    )
    sigmas = tuple(_chi(view, lens, pose) for view, pose in pairs)
    information = _normal(views, lens, settled, prior_sd(lens), _NO_HUBER).reduced
    return Bundle(lens, tuple(settled), residuals, sigmas, _inverse(information), cost)


def pose_covariance(view: ObservedView, lens: Lens, pose: Pose, lens_covariance: Array) -> Array:
    """Covariance (6, 6) of a board pose's rotation vector and translation [rad, m].

    It includes the errors of the corners and of the lens.

    Args:
        view: corners of the view, whose stated covariance is used.
        lens: the lens, with p numbers.
        pose: best fit of the board's pose in the camera's frame.
        lens_covariance: (p, p) covariance of the lens's numbers.
    """
    _, by_pose, by_lens = _whitened(view, lens, pose, _NO_HUBER)
    inverse = _inverse(by_pose.T @ by_pose)
    gain = inverse @ by_pose.T @ by_lens
    return inverse + gain @ lens_covariance @ gain.T


def fit_pose(view: ObservedView, lens: Lens) -> Pose:
    """Pose of the board in the camera's frame that fits one view best, by Huber's loss, for a known lens."""
    return _refined_pose(view, lens, _first_pose(view, lens), 30, 1e-10)


def _refined_pose(view: ObservedView, lens: Lens, start: Pose, max_steps: int, tolerance: float) -> Pose:
    """Pose of the board near `start` that fits a view's corners best by Huber's loss, by Gauss-Newton.

    The iteration ends after `max_steps`, or at a step below `tolerance` [rad, m].
    """

    def linearise(pose: Pose) -> Linearised:
        residual, by_pose, _ = _whitened(view, lens, pose, _HUBER_SIGMAS)
        return Linearised(residual, by_pose)

    return gauss_newton(start, linearise, Pose.moved, max_steps, tolerance)


@dataclass(frozen=True)
class _Normal:
    """Normal equations of a fit of lens (p numbers) and poses, with the poses eliminated.

    The parts from which the poses follow are kept.
    """

    reduced: Array
    """(p, p) normal matrix of the lens after elimination of the poses"""
    gradient: Array
    """(p,) right-hand side of the lens after elimination of the poses"""
    pose_information: list[Array]
    """per view (6, 6) normal matrix of the pose"""
    cross: list[Array]
    """per view (p, 6) block of the normal matrix that couples lens and pose"""
    pose_gradient: list[Array]
    """per view (6,) right-hand side of the pose"""


def _inverse(matrix: Array) -> Array:
    """Pseudo-inverse (p, p) of a normal matrix, computed on the matrix scaled to a unit diagonal."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return np.linalg.pinv(matrix / np.outer(scale, scale), hermitian=True, rcond=1e-15) / np.outer(
        scale, scale
    )


def _chi(view: ObservedView, lens: Lens, pose: Pose) -> Array:
    """Distance (n,) of each corner of a view from its prediction, over the corner's sd."""
    image, _, _ = project(lens, view.points, pose.rotation, pose.translation)
    return np.asarray(
        np.linalg.norm(np.einsum("nij,nj->ni", view.root, view.place - image), axis=1), dtype=np.float64
    )


def _whitened(view: ObservedView, lens: Lens, pose: Pose, huber: float) -> tuple[Array, Array, Array]:
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
        prior: (p,) prior standard deviations of the lens's numbers about the undistorted lens.
        huber: threshold of Huber's loss, in standard deviations.
        damping: factor of Levenberg and Marquardt.
    """
    start = plain_lens(lens.model, lens.width, lens.height, float(lens.numbers[:2].mean()))
    information = np.diag(1.0 / prior**2)
    gradient = (start.numbers - lens.numbers) / prior**2
    pose_information: list[Array] = []
    cross: list[Array] = []
    pose_gradient: list[Array] = []
    for view, pose in zip(views, poses, strict=True):
        residual, by_pose, by_lens = _whitened(view, lens, pose, huber)
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
        chi = _chi(view, lens, pose)
        total += float(np.sum(np.where(chi < huber, chi**2, huber * (2 * chi - huber))))
    return total if np.isfinite(total) else float("inf")


def _minimise(
    views: Sequence[ObservedView], lens: Lens, poses: list[Pose], max_steps: int, huber: float
) -> tuple[Lens, list[Pose], float]:
    """Fit lens and poses by Levenberg-Marquardt: minimise Huber's loss plus the prior's.

    Args:
        views: corners of each view.
        lens: first guess of the lens, whose focal length also sets the prior.
        poses: first guess of the board's pose per view.
        max_steps: largest number of iterations.
        huber: threshold of Huber's loss, in standard deviations.

    Returns:
        Lens, poses and cost (loss with prior, in squared standard deviations) at the end of the iteration.
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


def _rays(lens: Lens, place: Array) -> Array:
    """Viewing directions (n, 2) of pixels, as X/Z and Y/Z in the camera's frame.

    Pixels beyond the lens's range, which have no direction, get one far outside the image (5 image widths).

    Args:
        lens: the lens.
        place: (n, 2) pixels.
    """
    ideal = np.nan_to_num(undistort(lens.camera(), place), nan=5.0 * lens.width)
    return (ideal - lens.numbers[2:4]) / lens.numbers[:2]


def _planar(view: ObservedView, lens: Lens) -> list[Pose]:
    """Poses of the board, in front of the camera, that a plane through a view's corners may have.

    A plane seen in perspective may have two such poses; the list has none, one or two.
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
    """Sum of squared distances between a view's observed and predicted corners [px^2]."""
    image, _, _ = project(lens, view.points, pose.rotation, pose.translation)
    return float(np.sum((view.place - image) ** 2))


def _first_pose(view: ObservedView, lens: Lens) -> Pose:
    """First guess of the board's pose in a view: of the two poses that a plane may have, the better fit.

    If there is no such pose, the board faces the camera at the distance that follows from its image size.
    """
    found = _planar(view, lens)
    if not found:
        depth = float(np.ptp(view.points[:, :2])) * lens.numbers[0] / max(float(np.ptp(view.place)), 1.0)
        return Pose(np.array([np.pi, 0.0, 0.0]), np.array([0.0, 0.0, depth]))
    return min(found, key=lambda pose: _misfit(view, lens, pose))


def _better_pose(view: ObservedView, lens: Lens, pose: Pose) -> Pose:
    """Second pose that a plane may have in a view, if it fits clearly better (2 % less squared error).

    Returns:
        That pose of the board, refined; the object `pose` itself if none fits better.
    """
    best, least = pose, _misfit(view, lens, pose)
    for other in _planar(view, lens):
        refined = _refined_pose(view, lens, other, 8, 1e-7)
        if refined.translation[2] > 0 and _misfit(view, lens, refined) < 0.98 * least:
            best, least = refined, _misfit(view, lens, refined)
    return best
