"""The paper's estimator of phi: theta at the second sign change of its acceleration.

Source: VISAPP 2013, 3.2.1.

phi is the balance angle. The tipping angle theta is differentiated twice. The first sign change is the end of
the impact, the second the passage of the centre of mass over the pivot edge. Smoothing is a parameter,
because noise that is differentiated twice requires it and because it shifts the result. The result is
reported beside that of `pivot_fit`, and not used.
"""
# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from analyze.errors import EstimationError
from analyze.types import MotionFit

if TYPE_CHECKING:
    from analyze.motion.phases import Course
    from analyze.types import Array, TipAngle

_MAX_FRAME_GAP = 1.5
"""time between neighbouring frames, in median intervals, from which a frame is missing"""
_FAST_FRAME_NS = 1e9 / 180
"""frame interval [ns] below which smoothing is extended over more frames"""


def _smooth(values: Array, points: int) -> Array:
    """Moving mean (n,) of `values` (n,) over an odd number of points, fewer towards the ends."""
    half = points // 2
    sums = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(len(values))
    reach = np.minimum(np.minimum(index, len(values) - 1 - index), half)
    return (sums[index + reach + 1] - sums[index - reach]) / (2 * reach + 1)


def angular_acceleration(angle: TipAngle, points: int = 5) -> tuple[Array, Array]:
    """Angular velocity (n,) [rad/s] and acceleration (n,) [rad/s^2] of the tipping angle theta(t).

    They are central differences of moving means. A moving mean across missing frames would be biased: missing
    frames are interpolated by a cubic spline first, and left out of the result.

    Args:
        angle: theta(t) of n frames.
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
    """First (n,) [rad/s] and second derivative (n,) [rad/s^2] of an angle by time, smoothed.

    Before each of the two differentiations a moving mean is applied.

    Args:
        theta: (n,) angle [rad].
        time: (n,) time [s].
        points: width of the moving mean [frames].
    """
    omega = np.gradient(_smooth(theta, points), time)
    return omega, np.gradient(_smooth(omega, points), time)


def acceleration_noise(points: int) -> float:
    """Noise of the angular acceleration for an angle of sd 1 and frame interval 1, dimensionless.

    It is sd(alpha) dt^2 / sd(theta), with alpha the acceleration, theta the angle and dt the frame interval.

    Args:
        points: width of the moving mean [frames].
    """
    once = np.convolve(np.full(points, 1.0 / points), [0.5, 0.0, -0.5])
    return float(np.linalg.norm(np.convolve(once, once)))


def sign_change(
    angle: TipAngle, window: tuple[int, int], points: int = 5, fit: MotionFit | None = None
) -> MotionFit:
    """Balance angle phi by the paper's estimator (VISAPP 2013, 3.2.1), from theta(t) over one window.

    phi is the tipping angle theta at the second sign change of its acceleration alpha. The sd of phi is
    sd(alpha) over the slope of alpha by theta, at the crossing. With a `fit` of the same motion the slope is
    its rate constant k [rad/s^2] and the noise at least its residual (video coding adds to the noise);
    without one the slope is that of the noisy crossing itself.

    Args:
        angle: theta(t) of the strike.
        window: frames [start, stop), from the impact or just after it.
        points: width of the moving mean [frames].
        fit: pendulum fit of the same motion; None if there is none.

    Returns:
        A fit with phi [rad] and its variance [rad^2]; its rate constant k is None and its residuals are 0.

    Raises:
        EstimationError: the window has fewer than `points` + 4 frames, or the acceleration has no second sign
            change in it (the object rocked back, or the window starts after the balance).
    """
    first, last = window
    if last - first < points + 4:
        raise EstimationError(
            f"{last - first} frames are too few to differentiate twice with {points}-point smoothing,"
            f" {points + 4} are needed: raise the frame rate"
        )
    omega, alpha = angular_acceleration(angle, points)
    inside = alpha[first:last]
    negative = np.flatnonzero(inside < 0)
    if not len(negative):
        raise EstimationError(
            "the angular acceleration never turns negative: the window starts after the balance point;"
            " start it earlier"
        )
    rising = negative[0] + np.flatnonzero((inside[negative[0] : -1] < 0) & (inside[negative[0] + 1 :] >= 0))
    if not len(rising):
        raise EstimationError(
            "the angular acceleration has no second sign change: the object did not pass its balance point;"
            " strike harder"
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
        window=window,
        residual=np.zeros(last - first),
        note=f"{points}-point smoothing",
    )


def sign_change_alternatives(
    angle: TipAngle, course: Course, fit: MotionFit, smoothing_points: int
) -> tuple[MotionFit, ...]:
    """Fit of a strike's motion by the paper's estimator `sign_change`, to compare with the chosen fit.

    That estimator takes as balance angle the tipping angle at the second sign change of the angular
    acceleration.

    Args:
        angle: tipping angle theta(t) of the strike.
        course: events of the strike; the fitted frames begin at its first motion.
        fit: the chosen fit; the fitted frames end with its own.
        smoothing_points: width of the moving mean [frames] at up to 180 Hz.

    Returns:
        The one fit; empty if the estimator fails or no motion was found.
    """
    if course.moved_frame is None:
        return ()
    try:
        return (
            sign_change(
                angle,
                (course.moved_frame, fit.window[1]),
                _smoothing_points(angle, smoothing_points),
                fit,
            ),
        )
    except EstimationError:
        return ()


def _smoothing_points(angle: TipAngle, usual: int) -> int:
    """Width of the moving mean [frames]; above 180 Hz it spans the same time as `usual` frames at 120 Hz.

    The noise of a second derivative grows with the square of the frame rate.

    Args:
        angle: tipping angle with the times of its frames.
        usual: width [frames] at up to 180 Hz.
    """
    frame_ns = float(np.median(np.diff(angle.time_ns)))
    return usual if frame_ns > _FAST_FRAME_NS else 2 * round(usual * 1e9 / 120 / frame_ns / 2) + 1
