"""First sloshing mode of a liquid in a rectangular tank: the mass that moves, and its pendulum.

Linear theory of small waves (Abramson, The Dynamic Behavior of Liquids in Moving Containers, NASA SP-106,
1966, chapter 2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

LARGEST_SHARE = 0.9
"""largest share of the liquid's mass that moves; the linear theory of shallow water has 0.81"""
LOWEST_PLACE = 0.25
"""lowest place of the moving mass over the bottom, as a share of the depth"""


@dataclass(frozen=True)
class SloshingMode:
    """Pendulum with the force and moment of the first sloshing mode."""

    length: float
    """length of the pendulum [m]"""
    share: float
    """share of the liquid's mass that swings; the rest moves with the tank"""
    height: float
    """height of the swinging mass at rest over the bottom [m]"""


def first_mode(width: float, depth: float) -> SloshingMode:
    """First sloshing mode of a liquid of this depth [m] in a tank of this width [m]."""
    wave = math.pi * depth / width
    share = min(8 * math.tanh(wave) / (math.pi**3 * depth / width), LARGEST_SHARE)
    height = max(depth - 2 * width / math.pi * math.tanh(wave / 2), LOWEST_PLACE * depth)
    return SloshingMode(width / (math.pi * math.tanh(wave)), share, height)
