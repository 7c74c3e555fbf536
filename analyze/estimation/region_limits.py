"""Between which limits the regions' masses lie whatever is inside: moments alone, and an even wall.

Any distribution of mass in the interior, no part lighter than nothing nor denser than lead, that has the moments measured: the least and
the greatest mass of each region is a linear programme (moment problems: Karlin and Studden 1966). What lies between is open; nothing but an
assumption about the filling narrows it.
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from analyze.estimation.region_problem import RegionProblem
from analyze.types import Array

SIGMAS95 = 1.96
"""of each moment, in directions in which their errors are independent"""


def region_limits(problem: RegionProblem, normal: Array, height: float) -> Array:
    """Least and greatest share (3, 2) of the mass in wall, upper and lower part of the border n.(x - middle) = height.

    0 and 1 where no filling has the moments.
    """
    pieces = problem.pieces(normal, height)
    rows = np.vstack([pieces.explaining.T, -pieces.explaining.T])
    bounds = np.concatenate([problem.target + SIGMAS95, SIGMAS95 - problem.target])
    whole = np.ones((1, len(pieces.region)))
    most = np.stack([np.zeros(len(pieces.region)), np.minimum(pieces.most, 1.0)], axis=1)
    limits = np.tile([0.0, 1.0], (3, 1))
    for region in range(3):
        mine = (pieces.region == region).astype(np.float64)
        for end, sign in enumerate((1.0, -1.0)):
            found = linprog(sign * mine, A_ub=rows, b_ub=bounds, A_eq=whole, b_eq=[1.0], bounds=most, method="highs")
            if found.status == 0:
                limits[region, end] = np.clip(sign * found.fun, 0.0, 1.0)
    return limits
