"""Most likely unknowns given all strikes with fixed weights, by damped Gauss-Newton steps.

Unknown are the centre of mass, the inertia, and the errors that strikes share: the joint problem (joint.py).
The steps are those of Marquardt (1963). They need no good start, unlike the undamped ones of joint.py, which
in turn find the weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.estimation.joint import JointSolution, MomentModel, prior_start, strikes_information
from analyze.estimation.joint_model import COM, SECOND
from analyze.estimation.moment_prior import UnitPrior, shape_rows
from analyze.estimation.priors import ComPrior
from analyze.estimation.strike_data import whitened
from analyze.geometry.second_moments import log_cholesky, unit_inertia
from analyze.types import Array

FIRST_DAMPING, MAX_DAMPING = 1e-4, 1e8
"""Smallest and largest damping of a step, as a fraction of the information's diagonal."""


@dataclass(frozen=True)
class Expansion:
    """Misfit of all strikes and priors at given unknowns, with gradient and matrix of a Gauss-Newton step."""

    misfit: float
    """Weighted sum of the squares of strikes and priors."""
    gradient: Array
    """(count,) half the gradient of the misfit by the unknowns."""
    normal: Array
    """(count, count) Gauss-Newton matrix: the information about the unknowns."""
    shape: UnitPrior
    """Prior of the inertia by the shape at the centre of mass in the unknowns."""


class WeightedProblem:
    """Least-squares problem of centre of mass, inertia and shared errors, with fixed strike weights.

    Args:
        solution: Model and data of all strikes.
        prior: Prior of the centre of mass.
        moments: Gravity, and the shape's prior of the moments.
        weight: (strikes,) weights.
    """

    def __init__(self, solution: JointSolution, prior: ComPrior, moments: MomentModel, weight: Array) -> None:
        self._model, self._data = solution.model, solution.data
        self._moment_prior = moments.prior
        self._start, self._diagonal = prior_start(solution.model, prior, moments)
        self._weight = weight

    def expansion(self, x: Array) -> Expansion:
        """Misfit at the unknowns `x` (count,), with half its gradient, and the Gauss-Newton matrix."""
        z, rows = whitened(self._model, self._data, x)
        shape = self._moment_prior(x[COM])
        off, by = shape_rows(shape, x)
        apart = x - self._start
        misfit = float(self._weight @ np.sum(z**2, axis=1) + self._diagonal @ apart**2 + off @ off)
        flat = rows.reshape(-1, len(x))
        gradient = flat.T @ (np.repeat(self._weight, 2) * z.ravel()) + self._diagonal * apart + by.T @ off
        normal = np.diag(self._diagonal) + strikes_information(rows, self._weight) + by.T @ by
        return Expansion(misfit, gradient, normal, shape)

    def minimised(
        self, x: Array, free: Array, max_steps: int, converged_decrease: float
    ) -> tuple[Array, Expansion]:
        """Unknowns of least misfit, and the expansion there, from a start `x` (count,).

        Args:
            x: (count,) unknowns to start from.
            free: (count, n) orthonormal directions in which the unknowns may move; the identity for all.
            max_steps: Largest number of steps, refused ones included.
            converged_decrease: Decrease of the misfit in a step below which the problem is solved.
        """
        here, damping = self.expansion(x), 0.0
        for _ in range(max_steps):
            inner = free.T @ here.normal @ free
            damped = inner + damping * np.diag(np.diag(inner))
            tried = moved(x, -free @ np.linalg.solve(damped, free.T @ here.gradient))
            there = self.expansion(tried)
            if not there.misfit <= here.misfit:
                damping = max(10 * damping, FIRST_DAMPING)
                if damping > MAX_DAMPING:
                    break
                continue
            decrease = here.misfit - there.misfit
            x, here = tried, there
            damping = damping / 5 if damping > FIRST_DAMPING else 0.0
            if decrease < converged_decrease:
                break
        return x, here


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
