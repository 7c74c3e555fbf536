"""A tip that was struck again on its way: the pendulum's motion with a jump in speed at one frame, fitted together with that frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.motion.balance_fit import driven
from analyze.motion.pendulum import first_guess_with_kick
from analyze.motion.pivot_fit import Sample, fit_model, motion_fit, sample

if TYPE_CHECKING:
    from analyze.types import Array, MotionFit, TipAngle

_FROM_END = 3
"""frames, of the first and last place that is tried"""
_REFINED = 5
"""places that are fitted, the best by a linear guess"""
_WORST = 6.0
"""mean square of the residuals over their variance, up to which it explains the motion: a blow takes a part of a frame"""
_STEPS = np.array([1e-6, 1e-3, 1e-6, 1e-5, 1e-5])


@dataclass(frozen=True)
class KickedFit:
    """The best of them."""

    fit: MotionFit
    index: int
    """frame of the angle before which the blow came"""
    size: float
    """rad/s"""
    gain: float
    """size over its own sd, squared"""


def kicked_fit(angle: TipAngle, window: tuple[int, int], radius: float = 0.0) -> KickedFit | None:
    """The pendulum with one jump in speed that fits theta best, or None where none does.

    Args:
        angle: of the strike.
        window: frames [start, stop).
        radius: of the edge's rounding [m].
    """
    try:
        cut = sample(angle, window, 5)
    except EstimationError:
        return None
    places = range(_FROM_END, len(cut.time) - _FROM_END)
    plausible = [(at, start) for _, at, start in first_guess_with_kick(cut.time, cut.theta, places) if 0 < start[0] < 2 and start[1] > 1]
    best: KickedFit | None = None
    least = math.inf
    for at, start in plausible[:_REFINED]:
        model = _model(cut, at, radius)
        try:
            fitted = fit_model(cut, model, start, profiled=False)
        except (EstimationError, np.linalg.LinAlgError):
            continue
        cost = float(np.sum((fitted.residual / cut.sd) ** 2))
        if cost < least:
            rows = model(fitted.parameters)[1] / cut.sd[:, None]
            variance = float(np.linalg.pinv(rows.T @ rows)[4, 4]) * max(1.0, cost / max(len(cut.time) - 5, 1))
            size = float(fitted.parameters[4])
            fit = replace(motion_fit("pivot_fit", angle, window, cut, fitted), note="with a jump in speed")
            best, least = KickedFit(fit, window[0] + at, size, size * size / max(variance, 1e-12)), cost
    return best if least < _WORST * len(cut.time) else None


def _model(cut: Sample, at: int, radius: float):
    still = np.zeros_like(cut.time)

    def model(x: Array) -> tuple[Array, Array]:
        steps = np.concatenate([np.zeros((1, 5)), np.diag(_STEPS), -np.diag(_STEPS)])
        theta = driven(cut.time, x + steps, still, still, radius, kick=(at, (x + steps)[:, 4]))
        return theta[:, 0], (theta[:, 1:6] - theta[:, 6:]) / (2 * _STEPS)

    return model
