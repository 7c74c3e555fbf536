"""First guess for a rolling contact, by linear least squares on the integrated equation of motion.

`pendulum_motion.first_guess` is the equivalent for a hinge. The section is the body's cross-section across
the pivot axis, on which it rolls. With theta the tipping angle, rho the section's radius of curvature, and
the unknowns x = (1, a, b) / J of the body (centre of mass at (-b, a) from the pivot point, J its inertia per
mass about that point),

    theta + x . M(theta) + x . II f (g - rho theta'^2) = theta0 + v t

Two functions of theta that depend on the section alone enter: m, such that J (1 + m . x) is the inertia per
mass about the contact, and f, such that J f . x is the horizontal distance from the centre of mass to the
contact. M is the integral of m over theta, II the double integral over time, theta0 and v are constants; only
the small term with rho needs a speed, taken from a polynomial.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_trapezoid

from analyze.motion.pendulum_motion import G
from analyze.motion.rolling_motion import columns

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.types import Array

_SPEED_DEGREE = 6
"""degree of the polynomial whose derivative is the speed"""
_GRID_ANGLES = 200
"""number of angles of the integral over theta"""
_INERTIA_SD_SHARE = 0.5
"""standard deviation of 1 / J over its expected value, with J the inertia per mass about the pivot point"""
_DRIFT_RAD, _NOISE_FACTOR = 2e-3, 5.0
"""error of the integrals over noisy angles: a constant [rad], and a multiple of the noise"""


@dataclass(frozen=True)
class ComPrior:
    """Prior of the centre of mass c across the pivot axis, relative to the pivot point at rest.

    Assumed are c's offsets ahead and upwards [m] with their sd, and the inertia per mass [m^2].
    """

    ahead: float
    """expected horizontal offset in the direction of tipping [m]"""
    above: float
    """expected offset upwards [m]"""
    sd: float
    """standard deviation of either offset [m]"""
    J: float
    """expected inertia per mass about the pivot point [m^2]; its reciprocal has a relative sd of 50 %"""

    def rows(self) -> Array:
        """Left side (3, 3) of the three linear equations that state this prior, each divided by its sd.

        The first two rows are of the height and the offset of the centre of mass, the third of the inertia.
        The columns are coefficients of the unknowns 1 / J, a / J and b / J: a [m] is the height of the centre
        of mass c above the pivot point, -b [m] the offset of c from it in the direction of tipping, J [m^2]
        the inertia per mass about it. `values` is the right side.
        """
        by_sd = self.J / self.sd
        return np.array(
            [
                [-self.above * by_sd, by_sd, 0.0],
                [self.ahead * by_sd, 0.0, by_sd],
                [self.J / _INERTIA_SD_SHARE, 0.0, 0.0],
            ]
        )

    def values(self) -> Array:
        """Right side (3,) of the three linear equations that state this prior, each divided by its sd.

        `rows` is the left side: `rows` @ (1 / J, a / J, b / J) = values. a [m] is the height of the centre of
        mass c above the pivot point, -b [m] the offset of c from it in the direction of tipping, J [m^2] the
        inertia per mass about it. The first two equations are of a and b, the third of J.
        """
        return np.array([0.0, 0.0, 1.0 / _INERTIA_SD_SHARE])


def first_rolling_guess(
    time: Array, theta: Array, sd: Array, section: SupportFunction, expected: ComPrior
) -> Array:
    """First guess (5,) of 1 / J, a / J, b / J, theta0, omega0 [1/m^2, 1/m, 1/m, rad, rad/s].

    They are the parameters of a body that tips by rolling. At rest its centre of mass c is a [m] above the
    pivot point and -b [m] from it in the direction of tipping. J = I_c / m + a^2 + b^2 [m^2], I_c / m the
    inertia per mass about c; theta0 and omega0 are the tipping angle and its rate at the first time.

    Args:
        time: (n,) time [s].
        theta: (n,) tipping angle [rad].
        sd: (n,) standard deviation of theta [rad].
        section: support function (the pivot point's height over the table by tipping angle) of the
            cross-section on which the body rolls.
        expected: prior of c.
    """
    t = time - time[0]
    speed = np.polynomial.Polynomial.fit(t, theta, min(_SPEED_DEGREE, len(t) - 2)).deriv()(t)
    grid = np.linspace(float(theta.min()), float(theta.max()), _GRID_ANGLES)
    gathered: Array = cumulative_trapezoid(columns(section, grid)[0], grid, axis=0, initial=0)
    by_turn: Array = np.stack([np.interp(theta, grid, gathered[:, i]) for i in range(3)], axis=-1)
    _, pull, radius = columns(section, theta)
    once = cumulative_trapezoid(pull * (G - radius * speed**2)[:, None], t, axis=0, initial=0)
    twice = cumulative_trapezoid(once, t, axis=0, initial=0)
    loose = (_NOISE_FACTOR * sd + _DRIFT_RAD)[:, None]
    rows = np.column_stack([-by_turn - twice, np.ones_like(t), t]) / loose
    prior = np.column_stack([expected.rows(), np.zeros((3, 2))])
    x = np.linalg.lstsq(
        np.concatenate([rows, prior]), np.concatenate([theta / loose[:, 0], expected.values()]), rcond=None
    )[0]
    x[0] = max(x[0], 0.2 / expected.J)
    # The integral over theta begins at the least theta, which shifts the constant; the speed follows from the
    # slope.
    m = columns(section, theta[:1])[0][0]
    start = float(x[3] - by_turn[0] @ x[:3])
    return np.array([*x[:3], start, float(x[4]) / max(1.0 + float(m @ x[:3]), 0.1)])
