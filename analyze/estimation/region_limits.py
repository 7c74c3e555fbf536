"""Bounds of the regions' masses for any filling of a uniform shell, from the moments alone.

The interior may have any density between zero and that of lead. The smallest and the largest mass of each
region that agree with the measured moments are a linear programme (moment problems: Karlin and Studden 1966).
Only an assumption about the filling narrows these bounds.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from analyze.estimation.region_problem import RegionProblem
from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import Array


def region_limits(problem: RegionProblem, normal: Array, height: float) -> Array:
    """Smallest and largest share (3, 2) of the body's mass in the shell and in the two interior parts.

    Rows are the shell and the interior above and below the dividing plane; above is the side of its normal.
    The limits hold for any filling of the interior. They are 0 and 1 if no filling has the measured moments
    (each within 1.96 sd).

    Args:
        problem: Model of the moments by region, and the measured moments.
        normal: (3,) unit normal n of the dividing plane n.(x - middle) = height, in the object frame O.
        height: Height of the plane over the body's middle (centroid of the uniform solid) [m].
    """
    pieces = problem.pieces(normal, height)
    rows = np.vstack([pieces.explaining.T, -pieces.explaining.T])
    bounds = np.concatenate([problem.target + SIGMAS_95, SIGMAS_95 - problem.target])
    whole = np.ones((1, len(pieces.region)))
    most = np.stack([np.zeros(len(pieces.region)), np.minimum(pieces.most, 1.0)], axis=1)
    limits = np.tile([0.0, 1.0], (3, 1))
    for region in range(3):
        mine = (pieces.region == region).astype(np.float64)
        for end, sign in enumerate((1.0, -1.0)):
            found = linprog(
                sign * mine, A_ub=rows, b_ub=bounds, A_eq=whole, b_eq=[1.0], bounds=most, method="highs"
            )
            if found.status == 0:
                limits[region, end] = np.clip(sign * found.fun, 0.0, 1.0)
    return limits
