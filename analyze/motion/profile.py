"""Profile likelihood of phi, for fits whose linearised covariance cannot be trusted.

phi is the balance angle, k the rate of the fitted pendulum, theta(t) the tipping angle. Where a strike rocked
back far below the top, or flew over it, theta(t) bends little and phi and k nearly replace each other: the
sum of squares is a curved valley, and its curvature at the bottom does not give its length. So phi is held at
values away from the best one, all other parameters are fitted again, and the value is sought at which the sum
has grown by 1.96^2 variances (Venzon and Moolgavkar 1988).
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from analyze.least_squares.intervals import SIGMAS_95
from analyze.motion.pendulum_motion import trajectory

if TYPE_CHECKING:
    from analyze.types import Array

_SEARCH_STEPS = 4
"""largest number of steps in the search for an end of the interval"""
_GROWTH_TOLERANCE = 0.1
"""relative error of the sum's growth: the interval's end is then accurate to 5 %"""
_PHI_RANGE = (math.radians(0.5), math.radians(130.0))
"""range of phi [rad] within which the interval ends"""
_K_RANGE = (0.5, 5000.0)
"""range of k [rad/s^2] of a trial"""


@dataclass(frozen=True)
class FittedTip:
    """Measured tipping angle theta(t) [rad] of one strike, with the pendulum fitted to it.

    The pendulum is theta'' = -k sin(phi - theta). Its four parameters and their covariance are in the order
    balance angle phi [rad], rate k [rad/s^2], and angle theta0 [rad] and speed omega0 [rad/s] at time 0.
    """

    time: Array
    """(n,) time [s]"""
    theta: Array
    """(n,) measured theta [rad]"""
    weight: Array
    """(n,) factor on the residuals [1/rad]; 0 if not used"""
    parameters: Array
    """(4,) best phi, k, theta0, omega0 [rad, rad/s^2, rad, rad/s]; the last two at time 0"""
    covariance: Array
    """(4, 4) linearised covariance for weighted residuals of variance 1"""
    radius: float = 0.0
    """radius of the edge's rounding [m]"""


def profile_sd(tip: FittedTip, variance: float) -> float:
    """Standard deviation of balance angle phi [rad] by the profile likelihood of a fitted tip.

    It is the rms length of the two sides of the 95 % interval of phi, over 1.96. A side on which the sum of
    squares never grows enough ends at phi = 0.5 or 130 deg.

    Args:
        tip: the fit.
        variance: variance of the residuals of theta over their stated sd, increased by a factor for the
            correlation of neighbouring frames.
    """
    lowest = _sum_of_squares(tip, float(tip.parameters[0]))
    return math.hypot(*(_side(tip, variance, lowest, sign) for sign in (-1.0, 1.0))) / math.sqrt(2.0)


def _side(tip: FittedTip, variance: float, lowest: float, sign: float) -> float:
    """Length [rad] of one side of the 95 % interval of the balance angle phi, divided by 1.96.

    Args:
        tip: the fit of the tipping angle.
        variance: variance of the weighted residuals, correlation included.
        lowest: weighted sum of squares at the best phi.
        sign: -1 for the side of smaller phi, 1 for that of larger phi.
    """
    phi = float(tip.parameters[0])
    room = (_PHI_RANGE[1] - phi) if sign > 0 else (phi - _PHI_RANGE[0])
    wanted = SIGMAS_95**2 * variance
    away = min(SIGMAS_95 * math.sqrt(float(tip.covariance[0, 0]) * variance), room)
    for _ in range(_SEARCH_STEPS):
        grown = _sum_of_squares(tip, phi + sign * away) - lowest
        if abs(grown / wanted - 1.0) < _GROWTH_TOLERANCE or (away >= room and grown < wanted):
            break
        # The sum grows about as the square of the distance.
        away = min(away * min(max(math.sqrt(wanted / max(grown, 1e-12)), 0.3), 3.0), room)
    return away / SIGMAS_95


def _sum_of_squares(tip: FittedTip, phi: float) -> float:
    """Least weighted sum of squares of a tip's residuals with the balance angle held at phi [rad].

    The other parameters (rate k, and angle and speed at time 0) are fitted again.

    Args:
        tip: the measured tipping angle, with the parameters at which the search starts.
        phi: balance angle [rad].
    """
    best = tip.parameters
    start = best[1:] + tip.covariance[1:, 0] / tip.covariance[0, 0] * (phi - best[0])
    # In log k, from a start with the same k sin(phi): the data determine that product, and k must stay
    # positive.
    x = np.array(
        [math.log(best[1]) + math.log(max(math.sin(best[0]), 0.02) / max(math.sin(phi), 0.02)), *start[1:]]
    )
    columns = np.empty(0)

    def rate(x: Array) -> float:
        """Rate constant k [rad/s^2] of the tip from x = (ln k, theta0, omega0), limited to 0.5 to 5000.

        k is that of theta'' = -k sin(phi - theta), theta the tipping angle, phi the balance angle. theta0 and
        omega0, angle and angular speed at the start, are not used.
        """
        return math.exp(min(max(float(x[0]), math.log(_K_RANGE[0])), math.log(_K_RANGE[1])))

    def residual(x: Array) -> Array:
        """Measured less modelled tipping angle theta over its sd (n,), with the balance angle phi held.

        The sd is that of a frame, 1 / `tip.weight`; frames that are not used have 0.

        Args:
            x: (3,) ln k (rate constant k [rad/s^2]), and theta [rad] and its rate [rad/s] at time 0.
        """
        nonlocal columns
        model, _, columns = trajectory(tip.time, phi, rate(x), float(x[1]), float(x[2]), tip.radius)
        return np.clip((tip.theta - model) * tip.weight, -1e6, 1e6)

    def jacobian(x: Array) -> Array:
        """Derivatives (n, 3) of measured less modelled tipping angle theta, over its sd, by x.

        x (3,) is ln k (k: the tip's rate constant [rad/s^2]), and theta [rad] and its rate [rad/s] at time 0.
        The last call of `residual` must have had the same x: the derivatives of the angle come from there.
        """
        part = -columns[:, 1:] * tip.weight[:, None]
        part[:, 0] *= rate(x)
        return np.clip(part, -1e9, 1e9)

    # scipy's type hints admit only the names of its built-in derivatives.
    found = least_squares(
        residual,
        x,
        jacobian,  # pyright: ignore[reportArgumentType]
        x_scale=np.array([0.2, 0.02, 0.2]),
        max_nfev=15,
        xtol=1e-6,
        ftol=1e-6,
    )
    return 2.0 * float(found.cost)  # pyright: ignore[reportUnknownArgumentType]
