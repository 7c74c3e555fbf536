"""Contact spheres of a rounded body on the table.

A convex polyhedron whose edges are rounded with radius rho is the Minkowski sum of the polyhedron inset by
rho and a ball of radius rho. Against a plane only the inset polyhedron's corners matter, so one sphere per
corner has exactly the support function of capsules along all edges, flat faces included, with half the
contacts. A rim becomes a ring of closely spaced spheres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull, HalfspaceIntersection

from acquire.virtual.convex_parts import few_corners

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.objects import VirtualObject

RIM_SPHERES = 72
"""number of spheres per rim: at a radius of 36 mm the polygon differs from the circle by 0.034 mm"""

RIM_TOLERANCE_M = 1e-4
"""distance by which a user's shape may protrude from the hull of its spheres [m]: a rim of 40 mm radius then
has 48 of them"""


def contact_centres(virtual_object: VirtualObject) -> NDArray[np.float64]:
    """Centres (n, 3) [m, in O, the object's frame] of the spheres with which the body touches the table.

    Their radius is `virtual_object.edge_radius_m`. The centres lie this radius inside the body, so that the
    spheres touch its faces from within. A cylinder has a ring of them along each rim. Any other shape has
    them at the corners of its convex hull with every face moved inwards by the radius; of a user's shape file
    only as many of these corners are taken as keep its hull to within 0.1 mm.
    """
    cylinder = virtual_object.spec.shape.cylinder
    if cylinder is not None:
        return rim_centres(cylinder.radius_m, cylinder.height_m, virtual_object.edge_radius_m)
    corners = inset_corners(virtual_object.hull_vertices, virtual_object.edge_radius_m)
    return corners if virtual_object.drawn_parts is None else few_corners(corners, RIM_TOLERANCE_M)


def rim_centres(radius: float, height: float, edge_radius: float) -> NDArray[np.float64]:
    """Sphere centres (2 * RIM_SPHERES, 3) [m] along the rims of a cylinder about z, centred on the origin.

    They lie inside the cylinder, `edge_radius` from its end planes. Those of a rim form a regular polygon
    with the perimeter of a circle of radius `radius - edge_radius`.

    Args:
        radius: radius of the cylinder [m].
        height: height of the cylinder [m].
        edge_radius: radius of the rims' rounding and of the spheres [m].
    """
    half_step = np.pi / RIM_SPHERES
    angle = 2 * half_step * np.arange(RIM_SPHERES)
    ring = (radius - edge_radius) * half_step / np.sin(half_step)
    z = height / 2 - edge_radius
    return np.array([(ring * np.cos(a), ring * np.sin(a), side * z) for side in (-1, 1) for a in angle])


def inset_corners(points: NDArray[np.float64], inset: float) -> NDArray[np.float64]:
    """Corners (n, 3) [m] of the hull of `points` (m, 3) [m], every face moved inwards by `inset` [m]."""
    planes = ConvexHull(points).equations.copy()
    planes = planes[np.unique(np.round(planes, 7), axis=0, return_index=True)[1]]
    planes[:, 3] += inset
    corners = HalfspaceIntersection(planes, points.mean(axis=0)).intersections
    corners = corners[np.unique(np.round(corners, 7), axis=0, return_index=True)[1]]
    return corners[np.sort(ConvexHull(corners).vertices)]
