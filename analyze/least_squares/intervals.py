"""Factor from a standard deviation to the half-width of a 95 % interval."""

from __future__ import annotations

SIGMAS_95 = 1.96
"""Half-width of a normal variable's 95 % interval, in standard deviations."""
