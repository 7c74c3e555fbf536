"""The classical Runge-Kutta step for an angle and its momentum, of many cases at once."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.types import Array


def advanced(
    rate: Callable[[Array, Array], tuple[Array, Array]], theta: Array, turn: Array, gap: float, most: float
) -> tuple[Array, Array]:
    """Theta and its momentum (c,) after `gap` [s], in even steps of at most `most` [s].

    Args:
        rate: their derivatives by time, of theta and momentum (c,).
        theta: rad.
        turn: whatever `rate` takes for the momentum.
        gap: s.
        most: s.
    """
    steps = max(1, math.ceil(gap / most))
    h = gap / steps
    for _ in range(steps):
        a1, b1 = rate(theta, turn)
        a2, b2 = rate(theta + h / 2 * a1, turn + h / 2 * b1)
        a3, b3 = rate(theta + h / 2 * a2, turn + h / 2 * b2)
        a4, b4 = rate(theta + h * a3, turn + h * b3)
        theta = theta + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        turn = turn + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    return theta, turn
