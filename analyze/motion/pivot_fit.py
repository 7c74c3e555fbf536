"""phi and k of one strike: the pendulum's solution fitted to theta(t) over the window in which only gravity acts.

Levenberg-Marquardt with exact derivatives; Huber's loss by re-weighting (Huber 1964), because a wrong frame is no Gaussian error.
The covariance is that of the linearised fit, scaled by the residuals' own variance and by their correlation from frame to frame, so
that it stays honest where the camera's noise was guessed wrong or the contact is not quite a hinge. Where it makes phi uncertain by more
than 0.3 deg it is no longer believed, and stretched to the profile likelihood's interval. The uncertain zero of theta moves phi by
as much as itself, and is added at the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.motion.pendulum import first_guess, trajectory, trajectory_with_drag
from analyze.motion.profile import Tip, profile_sd
from analyze.types import MotionFit

if TYPE_CHECKING:
    from analyze.types import Array, TipAngle

    Model = Callable[[Array], tuple[Array, Array]]
    """theta (n,) [rad] of parameters (p,), and its derivatives (n, p)"""

MIN_FRAMES = 8
_HUBER = 2.5
_STEPS = 40
_LINEAR_SD = math.radians(0.3)
_SCALE = np.array([0.1, 20.0, 0.02, 0.2, 0.1])
"""rad, rad/s^2, rad, rad/s, 1: sizes of the parameters' changes, for conditioning"""


@dataclass(frozen=True)
class Solution:
    """Where a minimum was found."""

    parameters: Array
    """(p,) phi, k, theta0, omega0[, drag]"""
    residual: Array
    """(n,) rad"""
    jacobian: Array
    """(n, p)"""
    weight: Array
    """(n,) of Huber's loss, 0..1"""


@dataclass(frozen=True)
class Sample:
    """The part of theta(t) that is fitted."""

    time0_ns: int
    time: Array
    """(n,) s from time0_ns on"""
    theta: Array
    """(n,) rad"""
    sd: Array
    """(n,) rad"""
    guess: Array
    """(5,) phi, k, theta0, omega0, drag, good enough to start from"""
    radius: float = 0.0
    """m, of the edge's rounding, where the fit lets it roll"""


@dataclass(frozen=True)
class Fitted:
    """A model that was fitted to a Sample."""

    parameters: Array
    """(p,) phi, k, theta0, omega0[, more]"""
    residual: Array
    """(n,) rad"""
    covariance: Array
    """(2, 2) of (phi, k)"""


def pivot_fit(angle: TipAngle, window: tuple[int, int], radius: float = 0.0) -> MotionFit:
    """Fit phi, k, theta0, omega0 without drag over angle[window[0]:window[1]].

    Args:
        angle: of the strike.
        window: range of frames in which only gravity acts.
        radius: of the edge's rounding [m], on which it rolls.

    Raises:
        EstimationError: the window is too short or holds no tipping motion.
    """
    cut = replace(sample(angle, window, 4), radius=radius)

    def model(x: Array) -> tuple[Array, Array]:
        theta, _, jacobian = trajectory(cut.time, *_numbers(x), radius)
        return theta, jacobian

    fitted = fit_model(cut, model, cut.guess[:4])
    return motion_fit("pivot_fit", angle, window, cut, fitted)


def pivot_fit_with_drag(angle: TipAngle, window: tuple[int, int]) -> MotionFit:
    """The same of a hinge, with a drag term c theta' |theta'|, whose c is fitted too."""
    cut = sample(angle, window, 5)

    def model(x: Array) -> tuple[Array, Array]:
        theta, _, jacobian = trajectory_with_drag(cut.time, *_numbers(x), float(x[4]))
        return theta, jacobian

    fitted = fit_model(cut, model, cut.guess)
    return motion_fit("pivot_fit_with_drag", angle, window, cut, fitted, damping=float(fitted.parameters[4]))


def _numbers(x: Array) -> tuple[float, float, float, float]:
    return float(x[0]), float(x[1]), float(x[2]), float(x[3])


def sample(angle: TipAngle, window: tuple[int, int], parameters: int) -> Sample:
    """Cut out what is fitted.

    Raises:
        EstimationError: the window is too short.
    """
    first, last = window
    if last - first < max(MIN_FRAMES, parameters + 3):
        raise EstimationError(
            f"only {last - first} frames of free tipping, {MIN_FRAMES} are needed: raise the frame rate or strike less hard"
        )
    time0 = int(angle.time_ns[first])
    time = np.asarray((angle.time_ns[first:last] - time0) * 1e-9, dtype=np.float64)
    theta, sd = angle.theta[first:last], np.maximum(angle.sd[first:last], 1e-6)
    guess = np.array([*first_guess(time, theta), 0.0])
    if not (0.0 < guess[0] < 2.0 and guess[1] > 1.0):
        guess = np.array(
            [max(0.3, 0.8 * float(np.max(theta))), 60.0, float(theta[0]), float(theta[2] - theta[0]) / float(time[2] - time[0]), 0.0]
        )
    return Sample(time0, time, theta, sd, guess)


def fit_model(cut: Sample, model: Model, start: Array, profiled: bool = True) -> Fitted:
    """Fit a model of theta(t) whose first two parameters are phi and k.

    Args:
        cut: the data.
        model: gives theta and its derivatives.
        start: (p,) parameters to start from.
        profiled: the model is the pendulum itself, so that a vague phi can be stretched to its profile likelihood's interval.

    Raises:
        EstimationError: what fits is no tip.
    """
    solution = minimise(cut, model, start, _SCALE[: len(start)])
    phi, k = float(solution.parameters[0]), float(solution.parameters[1])
    if not (0.0 < phi < 2.5 and 0.5 < k < 5000.0):
        raise EstimationError(f"the motion is no tip over an edge (phi {math.degrees(phi):.1f} deg, k {k:.1f} rad/s^2): look at the images")
    return Fitted(solution.parameters, solution.residual, covariance_of(solution, cut, _SCALE[: len(start)], profiled)[:2, :2])


def motion_fit(estimator: str, angle: TipAngle, window: tuple[int, int], cut: Sample, fitted: Fitted, damping: float = 0.0) -> MotionFit:
    """As a result; the uncertain zero of theta is added."""
    covariance = fitted.covariance.copy()
    covariance[0, 0] += angle.zero_sd**2
    phi, k, theta0, omega0 = (float(x) for x in fitted.parameters[:4])
    return MotionFit(
        estimator=estimator,
        phi=phi,
        k=k,
        covariance=covariance,
        theta0=theta0,
        omega0=omega0,
        time0_ns=cut.time0_ns,
        damping=damping,
        window=window,
        residual=fitted.residual,
    )


def minimise(cut: Sample, model: Model, start: Array, scale: Array, positive: int = 1) -> Solution:
    """Levenberg-Marquardt with Huber's loss.

    Args:
        cut: the data.
        model: gives what is expected of them, and its derivatives.
        start: (p,) parameters to start from.
        scale: (p,) sizes of their changes, for conditioning.
        positive: number of the one that must stay above 0.1.
    """
    theta, sd = cut.theta, cut.sd
    x = start.copy()
    weight = np.ones_like(theta)
    damping = 1e-3

    def evaluate(x: Array) -> tuple[Array, Array]:
        expected, jacobian = model(x)
        return theta - expected, jacobian

    residual, jacobian = evaluate(x)
    weight = _huber(residual / sd)
    cost = float(np.sum(weight * (residual / sd) ** 2))
    for _ in range(_STEPS):
        J = jacobian * (np.sqrt(weight) / sd)[:, None] * scale
        r = residual * np.sqrt(weight) / sd
        normal, gradient = J.T @ J, J.T @ r
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), gradient) * scale
        trial = x + step
        if trial[positive] <= 0.1:
            damping *= 10
            continue
        new_residual, new_jacobian = evaluate(trial)
        new_cost = float(np.sum(weight * (new_residual / sd) ** 2))
        if not math.isfinite(new_cost) or new_cost > cost * (1 + 1e-9) + 1e-12:
            damping *= 8
            if damping > 1e9:
                break
            continue
        x, residual, jacobian = trial, new_residual, new_jacobian
        damping = max(damping / 8, 1e-12)
        done = bool(np.all(np.abs(step) < 1e-5 * scale))
        new_weight = _huber(residual / sd)
        settled = bool(np.max(np.abs(new_weight - weight)) < 1e-3)
        weight = new_weight
        cost = float(np.sum(weight * (residual / sd) ** 2))
        if done and settled:
            break
    return Solution(x, residual, jacobian, weight)


def _huber(standardised: Array) -> Array:
    """Weights of Huber's loss; the scale is the residuals' own where that is larger than the camera's."""
    scale = max(1.0, 1.4826 * float(np.median(np.abs(standardised))))
    return np.minimum(1.0, _HUBER * scale / np.maximum(np.abs(standardised), 1e-9))


def covariance_of(solution: Solution, cut: Sample, scale: Array, profiled: bool) -> Array:
    """(p, p); `scale` as in `minimise`; `profiled` as in `fit_model`."""
    n, p = solution.jacobian.shape
    sd = cut.sd
    weight = np.sqrt(solution.weight) / sd
    J = solution.jacobian * weight[:, None]
    r = solution.residual / sd
    # Huber's asymptotic variance: sum psi^2 / (n - p) over (mean psi')^2.
    psi = solution.weight * r
    share = max(0.5, float(np.mean(solution.weight > 0.999)))
    # n - p - 2 instead of n - p: the variance that Student's t has, because intervals are drawn as if it were normal.
    variance = float(np.sum(psi**2)) / max(n - p - 2, 1) / share**2 * correlation_factor(psi)
    normal = (J * scale).T @ (J * scale)
    inverse = np.asarray(np.linalg.pinv(normal, rcond=1e-14, hermitian=True) * np.outer(scale, scale), dtype=np.float64)
    linear_sd = math.sqrt(float(inverse[0, 0]) * variance)
    if linear_sd <= _LINEAR_SD or not profiled:
        return inverse * variance
    profile = profile_sd(Tip(cut.time, cut.theta, weight, solution.parameters, inverse, cut.radius), variance)
    return inverse * variance * max(1.0, profile / linear_sd) ** 2


def correlation_factor(r: Array) -> float:
    """Variance inflation (1 + a) / (1 - a) of residuals with lag-1 correlation a; 1 where a is within its own noise.

    The fit takes up part of the slow variation, which leaves a at about -p / n for white noise; that is no reason to deflate.
    """
    n = len(r)
    correlation = float(np.sum(r[1:] * r[:-1]) / max(float(np.sum(r * r)), 1e-30))
    if correlation < 2.0 / math.sqrt(n):
        return 1.0
    correlation = min(correlation, 0.9)
    return (1.0 + correlation) / (1.0 - correlation)
