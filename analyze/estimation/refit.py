"""Joint problem solved again with one strike left out, where its linear removal is not accurate.

The likelihood ratio of the problems with and without a strike tests the strike whatever the shape of the
posterior: it is the difference of their least misfits. For a linear model that is the squared standardised
difference of the strike from its prediction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.estimation.joint import (
    JointSolution,
    MomentModel,
    prior_start,
    shape_rows,
    strikes_information,
    whitened,
)
from analyze.estimation.joint_model import COM, SECOND
from analyze.estimation.priors import ComPrior
from analyze.estimation.second_moments import log_cholesky, unit_inertia
from analyze.types import Array

MAX_STEPS = 60
"""Largest number of Gauss-Newton steps."""
FIRST_DAMPING, MAX_DAMPING = 1e-4, 1e8
"""Smallest and largest damping of a step, as a fraction of the information's diagonal (Marquardt 1963)."""
CONVERGED_DECREASE = 1e-3
"""Decrease of the misfit in a step below which the problem is solved."""


@dataclass(frozen=True)
class Refit:
    """Solution of the problem of all strikes without one of them, and how much that one raises the misfit."""

    x: Array
    """(count,) unknowns without the strike."""
    covariance: Array
    """(count, count) their covariance."""
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
    x, least, normal = _minimum(solution, prior, moments, without, start)
    most = min(_minimum(solution, prior, moments, with_it, each)[1] for each in (start, x))
    return Refit(x, np.asarray(np.linalg.inv(normal), dtype=np.float64), max(most - least, 0.0))


def _minimum(
    solution: JointSolution, prior: ComPrior, moments: MomentModel, weight: Array, x: Array
) -> tuple[Array, float, Array]:
    """Minimise the misfit (weighted sum of squares of strikes and priors) from a start `x`.

    Args:
        solution: Model and data of all strikes.
        prior: Prior of the centre of mass.
        moments: Gravity, and the shape's prior of the moments.
        weight: (strikes,) weights.
        x: (count,) unknowns to start from.

    Returns:
        Unknowns (count,) of least misfit, the misfit, and its Gauss-Newton matrix (count, count) there, which
        is the inverse of their covariance.
    """
    middle, diagonal = prior_start(solution.model, prior, moments)

    def expansion(x: Array) -> tuple[float, Array, Array]:
        """Misfit at the unknowns `x` (count,), half its gradient, Gauss-Newton matrix (count, count)."""
        z, rows = whitened(solution.model, solution.data, x)
        off, by = shape_rows(moments.prior(x[COM]), x)
        apart = x - middle
        misfit = float(weight @ np.sum(z**2, axis=1) + diagonal @ apart**2 + off @ off)
        gradient = rows.reshape(-1, len(x)).T @ (np.repeat(weight, 2) * z.ravel())
        gradient = gradient + diagonal * apart + by.T @ off
        return misfit, gradient, np.diag(diagonal) + strikes_information(rows, weight) + by.T @ by

    misfit, gradient, normal = expansion(x)
    damping = 0.0
    for _ in range(MAX_STEPS):
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
        tried = moved(x, -np.asarray(step, dtype=np.float64))
        there = expansion(tried)
        if not there[0] <= misfit:
            damping = max(10 * damping, FIRST_DAMPING)
            if damping > MAX_DAMPING:
                break
            continue
        decrease = misfit - there[0]
        x, (misfit, gradient, normal) = tried, there
        damping = damping / 5 if damping > FIRST_DAMPING else 0.0
        if decrease < CONVERGED_DECREASE:
            break
    return x, misfit, normal


def moved(x: Array, step: Array) -> Array:
    """Unknowns (count,) of the model of all strikes after a step (count,) from `x`.

    Six unknowns stand for the inertia tensor per kilogram. In them the step is taken straight in the tensor's
    entries, in which ln k (k the rate constant of a strike's motion) is nearly linear. If the tensor that
    results is impossible, the nearest possible one is taken; its unknowns are NaN if there is none, so that
    no comparison of misfits accepts the step.
    """
    J, by = unit_inertia(x[SECOND])
    found = x + step
    try:
        found[SECOND] = log_cholesky(J + np.einsum("n,nij->ij", step[SECOND], by))
    except np.linalg.LinAlgError:
        found[SECOND] = np.nan
    return found
