"""Bounds of the regions' masses for any filling of a uniform shell, from the moments alone.

The interior may have any density between zero and that of lead. The smallest and the largest mass of each
region that agree with the measured moments are a convex programme (moment problems: Karlin and Studden 1966).
Only an assumption about the filling narrows these bounds.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, chdtri

from analyze.estimation.cells import ShellCells
from analyze.estimation.mass_properties import InertialParameters
from analyze.estimation.region_problem import RegionProblem
from analyze.estimation.share_bounds import SharePolytope
from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import Array

COVERAGE = 0.95
"""Probability that the moments of the true body are among those that the bounds allow."""
MIN_PROBABILITY_ANY_FILLING = 1e-3
"""Probability of the least chi^2 below which no filling of a uniform shell has the measured moments."""


@dataclass(frozen=True)
class RegionBounds:
    """Bounds of the region masses for any filling of the interior and any possible thickness of the shell.

    The regions are the shell (outer wall) and the interior on either side of a dividing plane.
    """

    problem: RegionProblem
    """Moments of the regions for the shell's thickness, or for the thinnest possible one."""
    walls: tuple[RegionProblem, ...]
    """Moments of the regions for the other possible thicknesses; empty if the thickness is known."""
    mass: float
    """Mass of the object [kg]."""
    mass_sd: float
    """1 sigma of `mass` [kg]."""

    @classmethod
    def over_walls(
        cls,
        parameters: InertialParameters,
        problems: Sequence[tuple[float, RegionProblem]],
        walls: Sequence[ShellCells],
    ) -> RegionBounds:
        """Bounds for several possible thicknesses of the shell: those of `problems`, and of `walls`.

        `problems` holds pairs of thickness [m] and problem; `walls` holds the body's cells for further
        thicknesses, whose problems are made here from `parameters`. Walls that leave nothing of the interior
        are skipped: a solid body is included wherever there is more than one thickness.
        """
        hollow = [(wall.thickness, wall.cells) for wall in walls if wall.cells.interior.any()]
        every = [*problems, *((t, RegionProblem(parameters, cells)) for t, cells in hollow)]
        first, *others = (problem for _, problem in sorted(every, key=lambda one: one[0]))
        return cls(first, tuple(others), parameters.mass, parameters.mass_sd)

    def at_plane(self, normal: Array, offset: float) -> Array:
        """Smallest and largest masses (3, 2) [kg] of the regions that the plane n.x = offset divides.

        Rows are the shell, and the interior on the side of the unit normal n (3,) (in the object frame O) and
        on the other side; `offset` is in metres from O's origin.
        """
        height = offset - float(normal @ self.problem.middle)
        shares = region_limits(self.problem, self.walls, normal, height)
        return shares * np.maximum(self.mass + SIGMAS_95 * self.mass_sd * np.array([-1.0, 1.0]), 0.0)


def region_limits(
    problem: RegionProblem, walls: Sequence[RegionProblem], normal: Array, height: float
) -> Array:
    """Smallest and largest share (3, 2) of the body's mass in the shell and in the two interior parts.

    Rows are the shell and the interior above and below the dividing plane; above is the side of its normal.
    The limits hold for any filling of the interior, and for moments within their joint 95 % region: those
    whose chi^2 exceeds the least possible one by no more than the 95 % quantile. So less precise moments
    never narrow the limits. If no filling has the measured moments, the limits are 0 and 1.

    With `walls`, the shell's thickness is unknown. The shell is then any mixture of walls of these
    thicknesses, a solid body among them: a wall that may be densest at the surface. Mixtures also stand for
    the thicknesses between them. The limits are slightly wider than those over single thicknesses (by less
    than 0.1 of the mass on simulated bodies, mostly by less than 0.02), and one convex programme gives them.

    Args:
        problem: Model of the moments by region, and the measured moments, for the shell's thickness, or for
            the thinnest possible one.
        walls: Models for the other possible thicknesses; empty if the thickness is given.
        normal: (3,) unit normal n of the dividing plane n.(x - middle) = height, in the object frame O.
        height: Height of the plane over the body's middle (centroid of the uniform solid) [m].
    """
    parts = [problem.pieces(normal, height), *(wall.walls() for wall in walls)]
    region = np.concatenate([part.region for part in parts])
    most = np.minimum(np.concatenate([part.most for part in parts]), 1.0)
    unbounded = np.tile([0.0, 1.0], (3, 1))
    if most.sum() <= 1.0:
        return unbounded
    explaining = np.vstack([part.explaining for part in parts]).T
    polytope = SharePolytope(explaining, problem.observable_target, most)
    least, freedom = polytope.least_chi2(), len(problem.observable_target)
    if chdtrc(freedom, least) < MIN_PROBABILITY_ANY_FILLING:
        return unbounded
    mine = (region == np.arange(3)[:, None]).astype(np.float64)
    radius = float(np.sqrt(least + chdtri(freedom, 1 - COVERAGE)))
    ends = polytope.minima(np.vstack([mine, -mine]), radius)
    limits = np.clip(np.stack([ends[:3], -ends[3:]], axis=1), 0.0, 1.0)
    return limits if np.all(limits[:, 0] <= limits[:, 1]) else unbounded
