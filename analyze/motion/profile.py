"""How far phi may lie from its best value: the profile likelihood, for fits whose linearised covariance cannot be believed.

Where a strike rocked back far below the top, or flew over it, theta(t) bends little and phi and k nearly replace each other: the sum of
squares is a curved valley, and its curvature at the bottom says nothing of its length. So phi is held at values away from the best one,
everything else is fitted again, and the place is sought where the sum has grown by 1.96^2 variances (Venzon and Moolgavkar 1988).
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from analyze.motion.pendulum import trajectory, trajectory_with_drag

if TYPE_CHECKING:
    from analyze.types import Array

_QUANTILE = 1.96
_SEARCH_STEPS = 4
_CLOSE = 0.1
"""relative, of the sum's growth: the interval's end is then known to 5 %"""
_PHI_RANGE = (math.radians(0.5), math.radians(130.0))
_K_RANGE = (0.5, 5000.0)


@dataclass(frozen=True)
class Tip:
    """A fitted tip."""

    time: Array
    """(n,) s"""
    theta: Array
    """(n,) rad"""
    weight: Array
    """(n,) 1/rad, of the residuals; 0 = not used"""
    parameters: Array
    """(p,) phi, k, theta0, omega0[, drag], the best"""
    covariance: Array
    """(p, p) linearised, for residuals of variance 1 after weighting"""
    radius: float = 0.0
    """m, of the edge's rounding, where it rolls"""


def profile_sd(tip: Tip, variance: float) -> float:
    """Root mean square of the sides of phi's 95 % interval over 1.96 [rad]; of a side that is open, what lies within 0.5..130 deg.

    Args:
        tip: the fit.
        variance: of the weighted residuals, correlation included.
    """
    lowest = _sum_of_squares(tip, float(tip.parameters[0]))
    return math.hypot(*(_side(tip, variance, lowest, sign) for sign in (-1.0, 1.0))) / math.sqrt(2.0)


def _side(tip: Tip, variance: float, lowest: float, sign: float) -> float:
    phi = float(tip.parameters[0])
    room = (_PHI_RANGE[1] - phi) if sign > 0 else (phi - _PHI_RANGE[0])
    wanted = _QUANTILE**2 * variance
    away = min(_QUANTILE * math.sqrt(float(tip.covariance[0, 0]) * variance), room)
    for _ in range(_SEARCH_STEPS):
        grown = _sum_of_squares(tip, phi + sign * away) - lowest
        if abs(grown / wanted - 1.0) < _CLOSE or (away >= room and grown < wanted):
            break
        # The sum grows about as the square of the distance.
        away = min(away * min(max(math.sqrt(wanted / max(grown, 1e-12)), 0.3), 3.0), room)
    return away / _QUANTILE


def _sum_of_squares(tip: Tip, phi: float) -> float:
    """Smallest weighted sum with phi held."""
    best = tip.parameters
    ahead = tip.covariance[1:, 0] / tip.covariance[0, 0] * (phi - best[0])
    start = best[1:] + ahead
    # In log k: k times sin(phi) is what the data know, and k must stay positive.
    x = np.array([math.log(best[1]) + math.log(max(math.sin(best[0]), 0.02) / max(math.sin(phi), 0.02)), *start[1:]])
    scale = np.array([0.2, 0.02, 0.2, 0.1])[: len(x)]

    def unpack(x: Array) -> tuple[float, float, float, float, float]:
        k = math.exp(min(max(float(x[0]), math.log(_K_RANGE[0])), math.log(_K_RANGE[1])))
        return phi, k, float(x[1]), float(x[2]), float(x[3]) if len(x) == 4 else 0.0

    columns = np.empty(0)

    def residual(x: Array) -> Array:
        nonlocal columns
        phi, k, theta0, omega0, drag = unpack(x)
        model, _, columns = (
            trajectory_with_drag(tip.time, phi, k, theta0, omega0, drag)
            if len(x) == 4
            else trajectory(tip.time, phi, k, theta0, omega0, tip.radius)
        )
        return np.clip((tip.theta - model) * tip.weight, -1e6, 1e6)

    def jacobian(x: Array) -> Array:
        part = -columns[:, 1 : 1 + len(x)] * tip.weight[:, None]
        part[:, 0] *= unpack(x)[1]
        return np.clip(part, -1e9, 1e9)

    # scipy's own hints know only the names of built-in derivatives.
    found = least_squares(residual, x, jacobian, x_scale=scale, max_nfev=15, xtol=1e-6, ftol=1e-6)  # pyright: ignore[reportArgumentType]
    return 2.0 * float(found.cost)  # pyright: ignore[reportUnknownArgumentType]
