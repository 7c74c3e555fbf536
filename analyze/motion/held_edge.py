"""Friction that the table had to give while a pivot edge did not slide, and the loss of a body that rocked.

With the fitted motion theta'' = -k sin(phi - theta) and the distance R of the centre of mass from the edge,
horizontal and vertical force at the edge follow from Newton's law (`sliding_motion.held_forces`). An edge
that stuck shows mu >= |T| / N. A ratio counts that lasts `LASTING_S`: over that time a table that did not
give it would have let the edge slide by a tenth of a millimetre.

A rolling resistance of arm a (the load acts that far ahead of the contact) shifts the balance angle by a / R
one way while the body rises and the other way while it falls back. Only a body that turned back shows it.
"""

# scipy and numpy are only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.robust import correlation_factor
from analyze.motion.edge_offset import displacement_per_error
from analyze.motion.pendulum_motion import trajectory
from analyze.motion.sliding_motion import SlidingBodies, held_forces

if TYPE_CHECKING:
    from analyze.motion.sliding_fit import PivotBody
    from analyze.types import Array, EdgePath, MotionFit, TipAngle

LASTING_S = 0.025
"""time [s] over which a ratio of forces must last"""
_MODEL_SD = 0.005
"""relative standard deviation of the forces by what the model leaves out: air, an edge that hops"""
_SAMPLES = 60
"""instants at which the forces are computed"""
_LEAST_TURN = 0.035
"""least angle [rad] from which a body must fall back to show its rolling loss"""
_EDGE_SDS = np.array([5e-4, 5e-4, 3e-4])
"""standard deviation of the followed point's offset from the edge, along and off the table, and of the edge's
radius [m]"""


@dataclass(frozen=True)
class HeldRatio:
    """Friction that an edge needed and got, in the part of a strike in which it did not slide."""

    ratio: float
    """|T|/N that lasted"""
    sd: float
    """its standard deviation"""
    theta: float
    """tipping angle at its middle [rad]"""


@dataclass(frozen=True)
class RollingLoss:
    """Rolling resistance of one strike that rocked back."""

    arm: float
    """distance [m] by which the load acts ahead of the contact"""
    sd: float
    """its standard deviation [m]"""


def held_ratio(fit: MotionFit, body: PivotBody, last_s: float) -> HeldRatio | None:
    """Largest lasting |T|/N of an edge that sticks, from the start of a fit on; None if it is too short.

    Args:
        fit: fit of the motion.
        body: body and edge.
        last_s: end of the part in which the edge did not slide, since the fit's start [s].
    """
    if last_s < 2 * LASTING_S or fit.k is None:
        return None
    time = np.linspace(0.0, last_s, _SAMPLES)
    ratio, theta = _ratios(time, fit, body)
    width = max(2, round(LASTING_S / float(time[1])))
    lasting = np.lib.stride_tricks.sliding_window_view(ratio, width).min(axis=1)
    at = int(np.argmax(lasting))

    def of(changed: PivotBody) -> float:
        """The ratio at the same instant, for a changed body."""
        return float(_ratios(time, fit, changed)[0][at : at + width].min())

    base = float(lasting[at])
    by = np.array(
        [
            of(replace(body, phi=body.phi + 1e-4)) - base,
            of(replace(body, k=body.k * 1.0001)) - base,
        ]
    )
    by_r = (of(replace(body, R=body.R * 1.0001)) - base) / (1e-4 * body.R)
    by_tilt = (of(replace(body, tilt=body.tilt + 1e-4)) - base) / 1e-4
    variance = (
        float(by @ body.covariance @ by) / 1e-8 + (by_r * body.R_sd) ** 2 + (by_tilt * body.tilt_sd) ** 2
    )
    return HeldRatio(base, float(np.sqrt(variance + (_MODEL_SD * base) ** 2)), float(theta[at + width // 2]))


def _ratios(time: Array, fit: MotionFit, body: PivotBody) -> tuple[Array, Array]:
    """|T|/N (n,) and angle (n,) [rad] of an edge that sticks, at times (n,) [s] since a fit's start."""
    theta, omega, _ = trajectory(time, body.phi, body.k, fit.theta0, fit.omega0, body.radius)
    one = np.ones(1)
    bodies = SlidingBodies(
        one,
        (body.phi - body.tilt) * one,
        body.k * one,
        body.R * one,
        body.tilt * one,
        body.radius,
        body.gravity,
    )
    _, pull, load = held_forces(bodies, theta, omega)
    return np.where(load > 0.05 * body.gravity, np.abs(pull) / np.maximum(load, 1e-6), 0.0), theta


def slide_range(angle: TipAngle, path: EdgePath, window: tuple[int, int]) -> float:
    """Range [m] of an edge's sliding in frames [start, stop), less what offset, radius and noise explain."""
    used = slice(*window)
    theta, slip = angle.theta[used], path.slip[used]
    if len(theta) < 5:
        return 0.0
    sd = np.sqrt(path.covariance[used, 1, 1]) + 1e-5
    rows = np.column_stack([np.ones(len(theta)), displacement_per_error(theta)[:, 0]])
    weighted = np.concatenate([rows / sd[:, None], np.column_stack([np.zeros(3), np.diag(1 / _EDGE_SDS)])])
    found = np.linalg.lstsq(weighted, np.concatenate([slip / sd, np.zeros(3)]), rcond=None)[0]
    left = np.lib.stride_tricks.sliding_window_view(slip - rows @ found, 5).mean(axis=1)
    return max(0.0, float(np.ptp(left)) - 4.0 * float(np.median(sd)) / np.sqrt(5))


def rolling_loss(fit: MotionFit, angle: TipAngle, R: float) -> RollingLoss | None:
    """Rolling resistance from a strike that rocked back; None if it did not turn back far enough.

    The residuals of the fit are explained by the derivatives of the motion by the fit's own parameters and by
    the arm a, theta'' = -k sin(phi - theta) - sign(theta') k a / R.

    Args:
        fit: fit of the motion, with its residuals.
        angle: theta(t) of the strike.
        R: distance of the centre of mass from the edge [m].
    """
    used = slice(*fit.window)
    theta, sd = angle.theta[used], angle.sd[used]
    top = int(np.argmax(theta)) if len(theta) else 0
    if fit.k is None or len(fit.residual) != len(theta) or len(theta) < 12:
        return None
    if theta[top] - max(float(theta[0]), float(theta[-1])) < _LEAST_TURN or not 4 <= top <= len(theta) - 5:
        return None
    time = np.maximum((angle.time_ns[used] - fit.time0_ns) * 1e-9, 0.0)
    _, _, by = trajectory(time, fit.phi, fit.k, fit.theta0, fit.omega0)
    fine = np.linspace(0.0, float(time[-1]), 800)
    path, speed, _ = trajectory(fine, fit.phi, fit.k, fit.theta0, fit.omega0)
    response, rate, column, h = 0.0, 0.0, np.zeros(len(fine)), float(fine[1])
    for i in range(1, len(fine)):
        pull = fit.k * np.cos(fit.phi - path[i]) * response - np.sign(speed[i]) * fit.k / R
        rate += h * pull
        response += h * rate
        column[i] = response
    rows = np.column_stack([by, np.interp(time, fine, column)]) / sd[:, None]
    scale = np.linalg.norm(rows, axis=0)
    normal = (rows / scale).T @ (rows / scale)
    inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
    found = inverse @ ((rows / scale).T @ (fit.residual / sd))
    left = fit.residual / sd - rows / scale @ found
    variance = max(1.0, float(left @ left) / (len(left) - 5)) * correlation_factor(left)
    return RollingLoss(float(found[4] / scale[4]), float(np.sqrt(inverse[4, 4] * variance) / scale[4]))
