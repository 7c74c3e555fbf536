"""What the benchmarks of phi and k compare: one fit's error, what it says of it, and the bound."""

from __future__ import annotations

import math
from dataclasses import dataclass

NOISES = ((0.05, 0.1), (0.1, 0.2), (0.2, 0.5))
"""degrees"""
VAGUE = math.radians(1.0)
"""a bound above it is no measurement; such strikes are left out, and counted"""


@dataclass(frozen=True)
class Error:
    """Of phi [rad] and k [relative]: off by, its stated 1 sigma, Cramer and Rao's."""

    phi: float
    k: float
    sd_phi: float
    sd_k: float
    bound_phi: float
    bound_k: float
