"""Error of one fit of phi and k, its stated sd and the Cramer-Rao bound, for the benchmarks."""

from __future__ import annotations

import math
from dataclasses import dataclass

NOISES = ((0.05, 0.1), (0.1, 0.2), (0.2, 0.5))
"""ranges [deg per frame] of the noise of the tipping angle"""
MAX_BOUND = math.radians(1.0)
"""Cramer-Rao bound of phi [rad] above which a strike is left out, and counted"""


@dataclass(frozen=True)
class Error:
    """Errors of phi [rad] and k [relative], with the stated sd and the Cramer-Rao bounds."""

    phi: float
    k: float
    sd_phi: float
    sd_k: float
    bound_phi: float
    bound_k: float
