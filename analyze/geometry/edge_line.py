"""An edge that an object tips over: a line in O beside the face it stands on, which is the same whatever a plan calls it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.types import Array

SAME_DIRECTION = float(np.cos(np.radians(1.0)))
"""of an edge, and of the face that lies on the table, in two plans"""
SAME_LINE = 5e-4
"""m across itself, by which one edge may lie elsewhere in two plans of one object"""


@dataclass(frozen=True)
class EdgeLine:
    """All in O."""

    direction: Array
    """(3,) unit; +theta about it tips"""
    up: Array
    """(3,) unit, W's z at rest"""
    point: Array
    """(3,) m, anywhere on the rounding's centre line"""
    radius: float
    """m, of the rounding"""

    def distance(self, other: EdgeLine) -> float:
        """Of the lines across themselves [m]; infinite where it is another direction or face."""
        if float(self.direction @ other.direction) < SAME_DIRECTION or float(self.up @ other.up) < SAME_DIRECTION:
            return np.inf
        apart = other.point - self.point
        across = float(np.linalg.norm(apart - self.direction * float(apart @ self.direction)))
        # A corrected rounding moves the centre line, not the edge.
        return max(0.0, across - float(np.sqrt(2)) * abs(self.radius - other.radius))

    def is_same(self, other: EdgeLine) -> bool:
        """It is one edge, struck on one face."""
        return self.distance(other) < SAME_LINE
