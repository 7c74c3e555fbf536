"""Estimate from all strikes made again without one of them, where its linear removal is inaccurate.

The likelihood ratio of the problems with and without a strike tests the strike whatever the shape of the
posterior: it is the difference of their least misfits. For a linear model that is the squared standardised
difference of the strike from its prediction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.estimation.damped_solve import WeightedProblem
from analyze.estimation.joint import JointSolution, MomentModel
from analyze.estimation.priors import ComPrior
from analyze.types import Array

MAX_STEPS = 60
"""Largest number of Gauss-Newton steps."""
CONVERGED_DECREASE = 1e-3
"""Decrease of the misfit in a step below which the problem is solved."""


@dataclass(frozen=True)
class Refit:
    """Solution of all strikes but one, and how much the one left out raises the least misfit."""

    x: Array
    """(count,) unknowns without the strike."""
    covariance: Array
    """(count, count) covariance of `x`."""
    rise: float
    """Increase of the least misfit by the strike, at full weight: chi^2 of its one or two measurements."""


def refit_without(solution: JointSolution, prior: ComPrior, moments: MomentModel, index: int) -> Refit:
    """Solve the problem of all strikes without one of them, and again with it at full weight.

    The problem is not linearised. All other strikes keep their robust weights.

    Args:
        solution: Solution of all strikes together, by the same priors.
        prior: Prior of the centre of mass.
        moments: Gravity, and the shape's prior of the moments.
        index: Number of the strike among `solution.model.planes`.

    Returns:
        Unknowns (count,) without the strike, their covariance, and the rise of the least misfit by the
        strike.
    """
    weight = solution.weight / solution.spread
    without, with_it = weight.copy(), weight.copy()
    without[index], with_it[index] = 0.0, 1.0 / solution.spread
    start = solution.x
    free = np.eye(len(start))
    x, least = WeightedProblem(solution, prior, moments, without).minimised(
        start, free, MAX_STEPS, CONVERGED_DECREASE
    )
    whole = WeightedProblem(solution, prior, moments, with_it)
    most = min(whole.minimised(each, free, MAX_STEPS, CONVERGED_DECREASE)[1].misfit for each in (start, x))
    covariance = np.asarray(np.linalg.inv(least.normal), dtype=np.float64)
    return Refit(x, covariance, max(most - least.misfit, 0.0))
