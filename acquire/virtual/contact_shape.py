"""Where a rounded body can touch the table: the centres of the balls that round it.

A convex polyhedron whose edges are rounded with radius rho is the Minkowski sum of the polyhedron inset by rho and a ball of radius rho.
Against a plane only the inset polyhedron's corners matter, so one sphere per corner has exactly the support function of capsules
along all edges, flat faces included, at half the contacts. A rim becomes a ring of spheres close enough to be round.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.objects import VirtualObject

RIM_SPHERES = 72
"""at 36 mm the rim's facets then stand 0.034 mm off the circle"""


def contact_centres(thing: VirtualObject) -> NDArray[np.float64]:
    """Centres (n, 3) m in O of the spheres, radius `thing.edge_radius_m`, that stand for the body on the table."""
    cylinder = thing.spec.shape.cylinder
    if cylinder is not None:
        return rim_centres(cylinder.radius_m, cylinder.height_m, thing.edge_radius_m)
    return inset_corners(thing.hull_vertices, thing.edge_radius_m)


def rim_centres(radius: float, height: float, edge_radius: float) -> NDArray[np.float64]:
    """Both rims of a cylinder about z, centred: (2 * RIM_SPHERES, 3) m. The polygon's mean radius is the circle's."""
    half_step = np.pi / RIM_SPHERES
    angle = 2 * half_step * np.arange(RIM_SPHERES)
    ring = (radius - edge_radius) * half_step / np.sin(half_step)
    z = height / 2 - edge_radius
    return np.array([(ring * np.cos(a), ring * np.sin(a), side * z) for side in (-1, 1) for a in angle])


def inset_corners(points: NDArray[np.float64], inset: float) -> NDArray[np.float64]:
    """Corners (n, 3) of the convex hull of `points` (m, 3) with every face moved inwards by `inset` [m]."""
    planes = ConvexHull(points).equations.copy()
    planes = planes[np.unique(np.round(planes, 7), axis=0, return_index=True)[1]]
    planes[:, 3] += inset
    corners = HalfspaceIntersection(planes, points.mean(axis=0)).intersections
    corners = corners[np.unique(np.round(corners, 7), axis=0, return_index=True)[1]]
    return corners[np.sort(ConvexHull(corners).vertices)]
