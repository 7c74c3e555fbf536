"""Gauss-Newton minimiser over any state that can be moved by a small step, such as a pose."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.types import Array

    State = TypeVar("State")


class Linearised(NamedTuple):
    """Weighted least-squares problem, linearised about one state by small steps (p,) from it.

    It holds the residuals (n,), observed minus expected, and the derivatives (n, p) of the expected values by
    the step, both divided by the observations' standard deviations.
    """

    residual: Array
    """(n,) observed minus expected, over their standard deviations"""
    jacobian: Array
    """(n, p) derivatives of the expected values by the step, over the same standard deviations"""


def gauss_newton(
    start: State,
    linearise: Callable[[State], Linearised],
    apply_step: Callable[[State, Array], State],
    max_steps: int,
    tolerance: float,
) -> State:
    """State at the minimum of a sum of squares, by undamped Gauss-Newton steps from a start close to it.

    Args:
        start: first state.
        linearise: function that gives, at a state, the residuals (n,), observed minus expected, and the
            derivatives (n, p) of the expected values by a step, both over the observations' sd.
        apply_step: function that gives the state after a step (p,); it may limit the step.
        max_steps: number of steps after which the iteration ends.
        tolerance: size of the largest component of a step below which the iteration ends.

    Returns:
        The last state, whether or not the iteration converged.
    """
    state = start
    for _ in range(max_steps):
        residual, jacobian = linearise(state)
        step = np.asarray(np.linalg.lstsq(jacobian, residual, rcond=None)[0], dtype=np.float64)
        state = apply_step(state, step)
        if float(np.max(np.abs(step))) < tolerance:
            break
    return state
