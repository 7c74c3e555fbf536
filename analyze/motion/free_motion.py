"""Clean part of a tip: the stretch in which the edge stays in place and only gravity acts.

An edge that slides a little under the impact spoils the start; a bevel or a facet that touches the table
before the next face spoils the end. Both cause a jump in speed; the stretch between them is as good as any
other tip.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analyze.errors import EstimationError
from analyze.least_squares.robust import median_scale
from analyze.motion.pendulum_fit import MIN_FRAMES, pivot_fit
from analyze.motion.pendulum_motion import trajectory
from analyze.motion.phases import speed_jump
from analyze.motion.settings import VerdictLimits
from analyze.types import Array, MotionFit, TipAngle

Estimator = Callable[[TipAngle, tuple[int, int]], MotionFit]
"""function that fits theta(t) over a window [start, stop) of its frames"""
START_STEP, END_STEP = 2, 3
"""spacing of the starts and ends that are tried [frames]"""
LATEST_START = 8
"""number of frames after release by which a sliding edge has come to rest (0.07 s at 120 fps); later jumps
are a second impact"""
CLEAN_CHI2 = 14.0
"""largest gain in chi^2 by a jump in speed within a clean stretch, as VerdictLimits.speed_jump_chi2"""
CLEAN_SCATTER = 2.5
"""largest mean squared residual over the frames' own variance"""

UNSETTLED_RATIO = 1.8
"""rms residual over the frames' own scatter above which a fit is unsettled; 1.0 +- 0.3 where only gravity
acts"""
SETTLED_RATIO = 1.25
"""largest rms residual of a settled fit, over the least rms residual of any later start"""


def largest_jump(angle: TipAngle, fit: MotionFit) -> tuple[int, float, float]:
    """Jump in angular speed that would improve a fit the most, as frame, size and gain.

    Args:
        angle: tipping angle theta(t) of the strike.
        fit: fit of the pendulum to it.

    Returns:
        Index into the angle's frames, size [rad/s], and the decrease of chi^2; if no jump decreases it, the
        first frame of the fit, 0 and 0.
    """
    window = slice(*fit.window)
    time = np.asarray((angle.time_ns[window] - fit.time0_ns) * 1e-9, dtype=np.float64)
    _, _, jacobian = trajectory(time, fit.phi, fit.k or 1.0, fit.theta0, fit.omega0)
    index, size, gain = speed_jump(time, fit.residual, angle.sd[window], jacobian)
    return fit.window[0] + index, size, gain


def is_jump(fit: MotionFit, size: float, gain: float, limits: VerdictLimits) -> bool:
    """True if a jump in angular speed is both significant and large for the fit.

    Args:
        fit: the fit without the jump.
        size: jump in speed [rad/s].
        gain: decrease of chi^2 by the jump.
        limits: least gain, and least ratio of the jump to the speed at the start of the fit.
    """
    return gain >= limits.speed_jump_chi2 and abs(size) >= limits.speed_jump_ratio * abs(fit.omega0)


def longest_clean_fit(
    angle: TipAngle, window: tuple[int, int], estimator: Estimator = pivot_fit
) -> MotionFit | None:
    """Fit of the motion over the longest stretch of frames without a jump in speed; None if there is none.

    The stretch begins in the window's first 9 frames, has at least 16 frames and a mean squared residual of
    theta below 2.5 times its stated variance, and passes the balance point or turns back below it.

    Args:
        angle: tipping angle theta(t).
        window: frames [start, stop) in which the stretch is sought.
        estimator: function that fits theta(t) over a stretch.
    """
    first, last = window
    shortest = 2 * MIN_FRAMES
    stretches = [
        (start, end)
        for start in range(first, min(first + LATEST_START, last) + 1, START_STEP)
        for end in range(last, start + shortest - 1, -END_STEP)
    ]
    for start, end in sorted(stretches, key=lambda s: (s[0] - s[1], s[0])):
        try:
            fit = estimator(angle, (start, end))
        except EstimationError:
            continue
        chi2 = float(np.mean(np.square(fit.residual / angle.sd[start:end])))
        if chi2 < CLEAN_SCATTER and largest_jump(angle, fit)[2] < CLEAN_CHI2 and holds_balance(angle, fit):
            return fit
    return None


def settled_fit(fit: MotionFit, refit: Callable[[tuple[int, int]], MotionFit]) -> MotionFit:
    """`fit`, or a fit that begins later if the striker still touched the object in the first frames.

    Contacts too light to show as a jump leave residuals far above the noise between neighbouring frames. The
    window then begins at the first frame from which the residuals are nearly as small as from any later
    start. (Measured on a strike with four such contacts, of 4-8 % of the first one's impulse, the last 11 ms
    after the window's start: balance angle phi off by 0.17 deg before, 0.001 deg after.)

    Args:
        fit: fit over the whole window.
        refit: function that fits the same angle by the same estimator over another window [start, stop).

    Returns:
        `fit` itself if its residuals are small or no later start makes them much smaller; otherwise the later
        fit, with a note that states the delay.
    """
    if _rms(fit) < UNSETTLED_RATIO * frame_noise(fit.residual):
        return fit
    first, last = fit.window
    later: list[MotionFit] = []
    for start in range(first + 1, min(first + LATEST_START, last - 2 * MIN_FRAMES) + 1):
        try:
            later.append(refit((start, last)))
        except EstimationError:
            break
    least = min((_rms(other) for other in later), default=math.inf)
    if UNSETTLED_RATIO * least > _rms(fit):
        return fit
    chosen = next(other for other in later if _rms(other) <= SETTLED_RATIO * least)
    waited = 1e-6 * (chosen.time0_ns - fit.time0_ns)
    return replace(
        chosen,
        note=f"begins {waited:.0f} ms after the first free frame, until when the striker still touched",
    )


def _rms(fit: MotionFit) -> float:
    """Root mean square of a fit's residuals of the tipping angle [rad], 4 degrees of freedom deducted."""
    return math.sqrt(float(np.sum(fit.residual**2)) / max(len(fit.residual) - 4, 1))


def frame_noise(residual: Array) -> float:
    """Standard deviation of a frame's noise, from second differences of `residual` (n,), in its unit.

    It is insensitive to slow drift. NaN if n < 3.
    """
    if len(residual) < 3:
        return math.nan
    return median_scale(np.diff(residual, 2)) / math.sqrt(6.0)


def holds_balance(angle: TipAngle, fit: MotionFit) -> bool:
    """True if the object, in a fit's window, passes the balance point or turns back below it.

    In both cases the balance angle phi is not extrapolated.

    Args:
        angle: tipping angle theta(t).
        fit: fit over part of it, with its phi and window.
    """
    start, end = fit.window
    inside = angle.theta[start] < fit.phi < angle.theta[end - 1]
    turned = float(np.max(angle.theta[start:end])) > max(angle.theta[start], angle.theta[end - 1]) + 0.02
    return bool(inside or turned)
