"""The classical Runge-Kutta step for an angle and its momentum, of many cases at once."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.types import Array


def advanced(rate: Callable[[Array], Array], state: Array, gap: float, most: float) -> Array:
    """The state (2, c), theta [rad] over its momentum, after `gap` [s], in even steps of at most `most` [s].

    Args:
        rate: its derivative (2, c) by time.
        state: now; the momentum is whatever `rate` takes for it.
        gap: s.
        most: s.
    """
    steps = max(1, math.ceil(gap / most))
    h = gap / steps
    for _ in range(steps):
        first = rate(state)
        second = rate(state + h / 2 * first)
        third = rate(state + h / 2 * second)
        state = state + h / 6 * (first + 2 * (second + third) + rate(state + h * third))
    return state
