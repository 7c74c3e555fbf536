"""Point that several pivot edges have in common: strikes about them leave one direction of c open.

Every equi-plane contains its edge and the centre of mass c. If the edges meet at one point, all planes
contain the line from that point to c, and no strike about them moves c along it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.types import Array, EquiPlane

PARALLEL_SHARE = 1e-3
"""Smallest over largest eigenvalue of the sum of the projections across the edges below which they count as
parallel."""


@dataclass(frozen=True)
class CommonPoint:
    """Point nearest to the lines of all pivot edges, with the largest distance of such a line from it."""

    point: Array
    """(3,) the point [m], in the object frame O."""
    miss: float
    """Largest distance of an edge's centre line from `point` [m]."""
    edges: int
    """Number of edges."""


def common_point(planes: Sequence[EquiPlane]) -> CommonPoint | None:
    """Point nearest (least squares) to the centre lines of all pivot edges; None if these are parallel.

    The centre line of an edge is the axis of its rounding, or the edge itself if it is sharp.

    Args:
        planes: One plane per strike, through centre line and centre of mass, in the object frame O, of which
            only the line is used; several strikes about one edge count once.

    Returns:
        Point (3,) [m] in O, largest distance of a line from it [m], and number of lines.
    """
    edges = {plane.axis_id: plane for plane in planes}.values()
    across = np.array([np.eye(3) - np.outer(edge.direction, edge.direction) for edge in edges])
    points = np.array([edge.point for edge in edges])
    total: Array = across.sum(axis=0)
    values = np.linalg.eigvalsh(total)
    if values[0] < PARALLEL_SHARE * values[-1]:
        return None
    along: Array = np.einsum("eij,ej->i", across, points)
    point: Array = np.asarray(np.linalg.solve(total, along), dtype=np.float64)
    miss = np.linalg.norm(np.einsum("eij,ej->ei", across, points - point), axis=1)
    return CommonPoint(point, float(miss.max()), len(edges))
