"""The paper's estimator: differentiate theta twice.

phi is theta at the second sign change of the acceleration (VISAPP 2013, 3.2.1).

The first sign change is the end of the impact, the second the passage over the equi-plane. Smoothing is a
parameter because twice differentiated noise needs it, and because it shifts the result: this estimator is
printed beside `pivot_fit`, not used.
"""
# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from analyze.errors import EstimationError
from analyze.types import MotionFit

if TYPE_CHECKING:
    from analyze.types import Array, TipAngle

_MAX_FRAME_GAP = 1.5
"""time between frames, in median intervals, from which one is missing"""


def _smooth(values: Array, points: int) -> Array:
    """Moving mean (n,) over an odd number of points, shorter at the ends."""
    half = points // 2
    sums = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(len(values))
    reach = np.minimum(np.minimum(index, len(values) - 1 - index), half)
    return (sums[index + reach + 1] - sums[index - reach]) / (2 * reach + 1)


def angular_acceleration(angle: TipAngle, points: int = 5) -> tuple[Array, Array]:
    """Angular velocity (n,) [rad/s] and acceleration (n,) [rad/s^2] by central differences of moving means.

    A mean over frames of which some are missing is biased: they are interpolated by a cubic spline first, and
    removed again.

    Args:
        angle: theta(t).
        points: width of the moving mean [frames].
    """
    time: Array = (angle.time_ns - angle.time_ns[0]) * 1e-9
    steps = np.diff(time)
    step = float(np.median(steps))
    if float(np.max(steps)) < _MAX_FRAME_GAP * step:
        return _differentiated(angle.theta, time, points)
    end = float(time[-1])
    even: Array = np.linspace(0.0, end, round(end / step) + 1)
    omega, alpha = _differentiated(CubicSpline(time, angle.theta)(even), even, points)
    return np.interp(time, even, omega), np.interp(time, even, alpha)


def _differentiated(theta: Array, time: Array, points: int) -> tuple[Array, Array]:
    """First and second derivative (n,) of `theta` (n,) over `time` (n,) after smoothing."""
    omega = np.gradient(_smooth(theta, points), time)
    return omega, np.gradient(_smooth(omega, points), time)


def acceleration_noise(points: int) -> float:
    """Sd of the acceleration over that of a frame's theta, times the squared frame interval."""
    once = np.convolve(np.full(points, 1.0 / points), [0.5, 0.0, -0.5])
    return float(np.linalg.norm(np.convolve(once, once)))


def sign_change(
    angle: TipAngle, window: tuple[int, int], points: int = 5, fit: MotionFit | None = None
) -> MotionFit:
    """Find phi as the paper does, over angle[window[0]:window[1]] from the impact on or just after it.

    The sd is the smoothed noise at the crossing: sd(alpha) over the slope of alpha by theta. That slope is k
    at the balance, and the noise at least the residual of a `fit` of the same motion (a video's coding adds
    to it); without a fit the slope is that of the noisy crossing itself.

    Raises:
        EstimationError: the acceleration has no second sign change in the window (the object rocked back).
    """
    first, last = window
    if last - first < points + 4:
        raise EstimationError(
            f"{last - first} frames are too few to differentiate twice with {points}-point smoothing"
        )
    omega, alpha = angular_acceleration(angle, points)
    inside = alpha[first:last]
    negative = np.flatnonzero(inside < 0)
    if not len(negative):
        raise EstimationError(
            "the angular acceleration never turns negative: the window starts after the balance point"
        )
    rising = negative[0] + np.flatnonzero((inside[negative[0] : -1] < 0) & (inside[negative[0] + 1 :] >= 0))
    if not len(rising):
        raise EstimationError(
            "the angular acceleration has no second sign change: the object did not pass its balance point"
        )
    i = first + int(rising[0])
    share = float(alpha[i] / (alpha[i] - alpha[i + 1]))
    phi = float(angle.theta[i] + share * (angle.theta[i + 1] - angle.theta[i]))
    here = float(angle.time_ns[i + 1] - angle.time_ns[i]) * 1e-9
    slope = (
        abs(float(alpha[i + 1] - alpha[i])) / max(here * abs(float(omega[i])), 1e-9)
        if fit is None or fit.k is None
        else fit.k
    )
    step = float(np.median(np.diff(angle.time_ns))) * 1e-9
    left = 0.0 if fit is None else float(np.sqrt(np.mean(fit.residual**2)))
    sd = (
        max(float(np.median(angle.sd[first:last])), left)
        * acceleration_noise(points)
        / step**2
        / max(slope, 1e-9)
    )
    return MotionFit(
        estimator="sign_change",
        phi=phi,
        k=None,
        covariance=np.array([[sd**2, 0.0], [0.0, 0.0]]),
        theta0=float(angle.theta[first]),
        omega0=float(omega[first]),
        time0_ns=int(angle.time_ns[first]),
        damping=0.0,
        window=window,
        residual=np.zeros(last - first),
        note=f"{points}-point smoothing",
    )
