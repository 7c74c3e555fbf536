"""Fit of a tip with a second impact: the pendulum with a jump in speed at one fitted frame.

Whether a strike counts as struck twice is decided in fit_choice.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.least_squares.levenberg_marquardt import with_differences
from analyze.motion.balance_fit import driven_theta
from analyze.motion.pendulum_fit import cut_sample, fit_model, motion_fit
from analyze.motion.pendulum_motion import first_guess_with_jump

if TYPE_CHECKING:
    from analyze.types import Array, MotionFit, TipAngle

_END_FRAMES = 3
"""number of frames at either end at which no jump is tried"""
_REFINED_JUMPS = 5
"""number of jump frames for which the full fit is made, the best by a linear guess"""
_MAX_CHI2 = 6.0
"""largest mean of the squared residuals over their variance of an accepted fit: an impact lasts part of a
frame"""
_STEPS = np.array([1e-6, 1e-3, 1e-6, 1e-5, 1e-5])
"""differentiation steps of phi, k, theta0, omega0 and the jump [rad, rad/s^2, rad, rad/s, rad/s]"""


@dataclass(frozen=True)
class TwoImpactFit:
    """Pendulum fitted to a tip whose angular speed jumps at one frame."""

    fit: MotionFit
    """balance angle phi, rate k of the tip, and theta0 and omega0 at the window's first frame"""
    index: int
    """index, into the strike's frames, of the frame at which the speed jumped"""
    size: float
    """jump in angular speed [rad/s]"""
    gain: float
    """squared ratio of the jump to its standard deviation, a chi^2 with one degree of freedom"""


def fit_two_impacts(angle: TipAngle, window: tuple[int, int], radius: float = 0.0) -> TwoImpactFit | None:
    """Best fit of a pendulum's motion with one jump in speed, as by a second impact, to theta(t).

    The pendulum is the object that tips over its edge.

    Args:
        angle: tipping angle theta(t) of the strike.
        window: frames [start, stop).
        radius: radius of the edge's rounding [m]; 0 for a sharp edge.

    Returns:
        The fit, and the jump: its frame, size [rad/s], and squared ratio to its standard deviation. None if
        the window has fewer than 8 frames, no such motion fits, or the mean squared residual of the best fit
        is at least 6 times the frames' variance.
    """
    try:
        sample = cut_sample(angle, window, 5)
    except EstimationError:
        return None
    frames = range(_END_FRAMES, len(sample.time) - _END_FRAMES)
    guesses = first_guess_with_jump(sample.time, sample.theta, frames)
    plausible = [(frame, start) for _, frame, start in guesses if 0 < start[0] < 2 and start[1] > 1]
    best: TwoImpactFit | None = None
    least = math.inf
    for frame, start in plausible[:_REFINED_JUMPS]:
        model = with_differences(partial(_theta_with_jump, sample.time, frame, radius), _STEPS)
        try:
            fitted = fit_model(sample, model, start)
        except (EstimationError, np.linalg.LinAlgError):
            continue
        cost = float(np.sum((fitted.residual / sample.sd) ** 2))
        if cost < least:
            rows = model(fitted.parameters)[1] / sample.sd[:, None]
            variance = float(np.linalg.pinv(rows.T @ rows)[4, 4]) * max(
                1.0, cost / max(len(sample.time) - 5, 1)
            )
            size = float(fitted.parameters[4])
            fit = replace(motion_fit("pivot_fit", angle, window, fitted), note="with a jump in speed")
            best, least = TwoImpactFit(fit, window[0] + frame, size, size * size / max(variance, 1e-12)), cost
    return best if least < _MAX_CHI2 * len(sample.time) else None


def _theta_with_jump(time: Array, frame: int, radius: float, sets: Array) -> Array:
    """Tipping angles (n, c) [rad] of c pendulums with a jump in angular speed at one frame.

    Args:
        time: (n,) times [s].
        frame: index of the jump.
        radius: radius of the edge's rounding [m].
        sets: (c, 5) balance angle phi, rate constant k of theta'' = -k sin(phi - theta), theta0 and omega0
            (tipping angle and speed at the first time), and jump in speed [rad, rad/s^2, rad, rad/s, rad/s].
    """
    still = np.zeros_like(time)
    return driven_theta(time, sets, still, still, radius, jump=(frame, sets[:, 4]))
