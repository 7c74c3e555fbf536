"""Detection by a chi^2 test: its false alarms, and the noncentrality that it finds with some probability."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from scipy.special import chdtri, chndtr

FALSE_ALARM_PROBABILITY = 1e-3
"""False-alarm probability of each kind of test in one session."""
DETECTION = 0.9
"""Probability of detection at the stated smallest share of a liquid."""
BISECTIONS = 60
"""Number of bisections for a noncentrality."""


def critical_value(freedom: int) -> float:
    """Value that a chi^2 variable with `freedom` degrees exceeds with `FALSE_ALARM_PROBABILITY`."""
    return float(chdtri(freedom, FALSE_ALARM_PROBABILITY))


def noncentrality(limit: float, freedom: int) -> float:
    """Noncentrality at which chi^2 exceeds `limit` with the probability `DETECTION`, by bisection."""
    low, high = 0.0, 10.0 * (limit + 10.0)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        found = 1.0 - float(chndtr(limit, freedom, middle)) > DETECTION
        low, high = (low, middle) if found else (middle, high)
    return high
