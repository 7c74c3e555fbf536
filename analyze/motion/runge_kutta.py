"""Classical fourth-order Runge-Kutta integration of an angle and its momentum, for many cases at once."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.types import Array


def runge_kutta_state(
    rate: Callable[[Array], Array], state: Array, duration: float, max_step: float
) -> Array:
    """State (2, c) of c cases after `duration` [s]; row 0 is the angle [rad], row 1 its momentum.

    Args:
        rate: function that gives the derivative (2, c) of a state by time; it does not depend on the time
            itself.
        state: (2, c) present state; the momentum is in the unit that `rate` uses. It is not changed.
        duration: time to integrate over [s], in equal steps.
        max_step: longest step [s].
    """
    steps = max(1, math.ceil(duration / max_step))
    h = duration / steps
    for _ in range(steps):
        first = rate(state)
        second = rate(state + h / 2 * first)
        third = rate(state + h / 2 * second)
        state = state + h / 6 * (first + 2 * (second + third) + rate(state + h * third))
    return state
