"""Classical Runge-Kutta step for an angle and its momentum, for many cases at once."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.types import Array


def advanced(rate: Callable[[Array], Array], state: Array, gap: float, most: float) -> Array:
    """State (2, c) after `gap` [s], angle [rad] above momentum, in equal steps of at most `most` [s].

    Args:
        rate: derivative (2, c) of the state by time.
        state: present state (2, c); the momentum is in the unit of `rate`.
        gap: duration [s].
        most: longest step [s].
    """
    steps = max(1, math.ceil(gap / most))
    h = gap / steps
    for _ in range(steps):
        first = rate(state)
        second = rate(state + h / 2 * first)
        third = rate(state + h / 2 * second)
        state = state + h / 6 * (first + 2 * (second + third) + rate(state + h * third))
    return state
