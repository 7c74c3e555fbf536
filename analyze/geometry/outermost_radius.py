"""Radius of an edge by the outermost points of a scanned mesh, where the object touches the table as it tips.

A bottle's base is rounded by more than the largest radius whose arc is fitted to the points (`MAX_RADIUS`),
and by no perfect arc.
"""

from __future__ import annotations

import numpy as np

from analyze.geometry.cloud_roundings import EdgeRounding
from analyze.geometry.hull_planes import FittedPlane
from analyze.types import Array

LARGEST_RADIUS = 0.015
"""Radius [m] up to which a rounded edge counts as one."""
SHARES = np.linspace(0.25, 0.75, 11)
"""Directions between the normals of the two faces of an edge, as shares of the angle between them, in which
the surface's distance from the sharp edge is measured."""
MIDDLE = 0.15
"""Share of an edge's length at each end whose points are not used: a third face rounds it too."""
ON_FACE = 1e-6
"""Distance [m] of an edge's ends from the planes that meet in it."""


def outermost_radius(rounding: EdgeRounding, points: Array, planes: tuple[FittedPlane, ...]) -> float:
    """Radius [m] of the rounding whose arc is as far from the sharp edge as the outermost points are.

    The arc of radius r between faces with normals n and m lies r (q.d - 1) below the sharp edge along a
    direction d between them, with q = (n + m) / (1 + n.m). Noise moves the outermost points outwards, so that
    the result is rather too small. It is at most `LARGEST_RADIUS`, and 0 if two faces or points are lacking.

    Args:
        rounding: edge, as if sharp.
        points: (n, 3) points of the mesh [m].
        planes: faces that may meet in the edge.
    """
    ends = np.stack([rounding.start, rounding.end])
    faces = [plane.normal for plane in planes if float(np.abs(plane.heights(ends)).max()) < ON_FACE]
    along = (points - rounding.start) @ rounding.direction / float(np.linalg.norm(ends[1] - ends[0]))
    arm = points[np.abs(along - 0.5) < 0.5 - MIDDLE] - rounding.start
    if len(faces) != 2 or not len(arm):
        return 0.0
    one, other = faces
    cosine = float(np.clip(one @ other, -1.0, 1.0))
    angle = float(np.arccos(cosine))
    ahead = (other - cosine * one) / float(np.sin(angle))
    directions = np.outer(np.cos(SHARES * angle), one) + np.outer(np.sin(SHARES * angle), ahead)
    below = -(arm @ directions.T).max(axis=0)
    per_radius = directions @ (one + other) / (1 + cosine) - 1
    return float(np.clip(np.median(below / per_radius), 0.0, LARGEST_RADIUS))
