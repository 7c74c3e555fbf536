"""Where the fit of a rolling contact begins: linear least squares on the twice integrated equation, as pendulum.first_guess for a hinge.

    theta + x . G(theta) + x . II f (g - rho theta'^2) = theta0 + c t

with the terms of rolling_motion, G the integral of m over theta and II the double one over time; only the small term with rho needs a
speed, of a polynomial.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.rolling_motion import G, columns

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.types import Array

_DEGREE = 6
_GRID = 200
_UNSURE = 0.5
"""1 sigma of 1 / J over what is expected"""
_DRIFT, _LOOSE = 2e-3, 5.0
"""rad, and times the noise: what integrals of noisy angles are off"""


@dataclass(frozen=True)
class Expected:
    """About where c is, from the pivot point, at rest."""

    ahead: float
    """m"""
    above: float
    """m"""
    sd: float
    """m"""
    J: float
    """m^2, within its half"""

    def rows(self) -> Array:
        """(3, 3): times 1 / J, a / J, b / J it is what `values` says, each within 1."""
        by_sd = self.J / self.sd
        return np.array(
            [
                [-self.above * by_sd, by_sd, 0.0],
                [self.ahead * by_sd, 0.0, by_sd],
                [self.J / _UNSURE, 0.0, 0.0],
            ]
        )

    def values(self) -> Array:
        """(3,): c is there, and J that."""
        return np.array([0.0, 0.0, 1.0 / _UNSURE])


def first_guess(time: Array, theta: Array, sd: Array, flank: SupportFunction, expected: Expected) -> Array:
    """(5,) 1 / J, a / J, b / J, theta0, omega0.

    Args:
        time: (n,) s.
        theta: (n,) rad.
        sd: (n,) rad.
        flank: what it rolls on.
        expected: where c may be.
    """
    t = time - time[0]
    speed = np.polynomial.Polynomial.fit(t, theta, min(_DEGREE, len(t) - 2)).deriv()(t)
    grid = np.linspace(float(theta.min()), float(theta.max()), _GRID)
    gathered = _integrated(grid, columns(flank, grid)[0])
    by_turn: Array = np.stack([np.interp(theta, grid, gathered[:, i]) for i in range(3)], axis=-1)
    _, pull, radius = columns(flank, theta)
    twice = _integrated(t, _integrated(t, pull * (G - radius * speed**2)[:, None]))
    loose = (_LOOSE * sd + _DRIFT)[:, None]
    rows = np.column_stack([-by_turn - twice, np.ones_like(t), t]) / loose
    prior = np.column_stack([expected.rows(), np.zeros((3, 2))])
    x = np.linalg.lstsq(
        np.concatenate([rows, prior]), np.concatenate([theta / loose[:, 0], expected.values()]), rcond=None
    )[0]
    x[0] = max(x[0], 0.2 / expected.J)
    # The integral over theta begins at the least theta, the speed is what the constant leaves of it.
    m = columns(flank, theta[:1])[0][0]
    start = float(x[3] - by_turn[0] @ x[:3])
    return np.array([*x[:3], start, float(x[4]) / max(1.0 + float(m @ x[:3]), 0.1)])


def _integrated(at: Array, values: Array) -> Array:
    """(n, 3) from the first on, by the trapezoidal rule."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(at)[:, None]
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
