"""Line of a pivot edge in the object frame, by which an edge is recognised whatever its id in a plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.types import Array

SAME_DIRECTION = float(np.cos(np.radians(1.0)))
"""Smallest cosine between the directions, and the resting faces' normals, of one edge in two plans."""
SAME_LINE = 5e-4
"""Largest distance [m] between the lines of one edge in two plans of an object."""


@dataclass(frozen=True)
class EdgeLine:
    """Pivot edge (about which the object tips) of one resting face, in the object frame O.

    It has the axis's direction, the face's upward direction, a point on the centre line of the edge's
    rounding [m], and the rounding's radius [m].
    """

    direction: Array
    """(3,) unit vector of the pivot axis; +theta about it tips."""
    up: Array
    """(3,) unit vector up (z of the world frame W) when the object rests on the face."""
    point: Array
    """(3,) any point on the rounding's centre line [m]."""
    radius: float
    """Radius of the rounding [m]."""

    def distance(self, other: EdgeLine) -> float:
        """Distance [m] between two pivot edges; infinite if direction or resting face differ.

        It is the distance of the centre lines of their roundings, less sqrt(2) times the difference of the
        radii, and at least 0. On one and the same edge, a radius larger by d moves the centre line by d
        inwards and by d upwards, that is by sqrt(2) d.
        """
        if (
            float(self.direction @ other.direction) < SAME_DIRECTION
            or float(self.up @ other.up) < SAME_DIRECTION
        ):
            return np.inf
        apart = other.point - self.point
        across = float(np.linalg.norm(apart - self.direction * float(apart @ self.direction)))
        # A corrected rounding moves the centre line, not the edge.
        return max(0.0, across - float(np.sqrt(2)) * abs(self.radius - other.radius))
