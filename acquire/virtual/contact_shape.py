"""Contact spheres of a rounded body on the table.

A rigid body touches a plane only where its convex hull does, whatever hollows lie between: a mug stands on
its rim, a chair on its feet, a bottle with a punt on the ring around it. The hull of the mesh's own vertices
is therefore all of the shape that touches the table.

A convex polyhedron whose edges are rounded with radius rho is the Minkowski sum of the polyhedron inset by
rho and a ball of radius rho. Against a plane only the inset polyhedron's corners matter, so one sphere per
corner has exactly the support function of capsules along all edges, flat faces included, with half the
contacts. A rim becomes a ring of closely spaced spheres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection, QhullError

from acquire.virtual.convex_parts import few_corners

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.objects import VirtualObject

RIM_SPHERES = 72
"""number of spheres per rim: at a radius of 36 mm the polygon differs from the circle by 0.034 mm"""

MESH_TOLERANCE_M = 1e-5
"""distance by which a user's shape may protrude from the hull of its spheres [m]: a rim of 40 mm radius then
has 140 of them, and tips over one of their chords at most 0.03 mm from the circle at 20 degrees"""
_MOST_SPHERES = 3000
"""number of spheres from which on none are added; even a finely meshed ball is then nearly within the
tolerance"""


def contact_centres(virtual_object: VirtualObject) -> NDArray[np.float64]:
    """Centres (n, 3) [m, in O, the object's frame] of the spheres with which the body touches the table.

    Their radius is `virtual_object.edge_radius_m`. The centres lie this radius inside the body, so that the
    spheres touch its faces from within. A cylinder has a ring of them along each rim. Any other shape has
    them at the corners of its convex hull with every face moved inwards by the radius (`mesh_centres` for a
    user's shape file).
    """
    cylinder = virtual_object.spec.shape.cylinder
    if cylinder is not None:
        return rim_centres(cylinder.radius_m, cylinder.height_m, virtual_object.edge_radius_m)
    if virtual_object.drawn_parts is None:
        return inset_corners(virtual_object.hull_vertices, virtual_object.edge_radius_m)
    return mesh_centres(virtual_object.mesh_vertices, virtual_object.edge_radius_m)


def mesh_centres(vertices: NDArray[np.float64], edge_radius: float) -> NDArray[np.float64]:
    """Sphere centres (n, 3) [m] of a mesh: corners of its convex hull inset by the radius of its edges.

    Corners are left out while the inset hull protrudes from that of the rest by at most `MESH_TOLERANCE_M`.

    Args:
        vertices: (m, 3) vertices of the mesh [m].
        edge_radius: radius of the edges' rounding and of the spheres [m].

    Raises:
        QhullError: the mesh is flat, or nothing is left of it when its faces are moved inwards.
    """
    corners = vertices[np.sort(ConvexHull(vertices).vertices)]
    return few_corners(inset_corners(corners, edge_radius), MESH_TOLERANCE_M, _MOST_SPHERES)


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
    corners = HalfspaceIntersection(planes, _point_within(planes, points.mean(axis=0))).intersections
    corners = corners[np.unique(np.round(corners, 7), axis=0, return_index=True)[1]]
    try:
        hull = ConvexHull(corners)
    except QhullError:  # thousands of corners, some within a micrometre of one another: as one from 10 um
        corners = corners[np.unique(np.round(corners, 5), axis=0, return_index=True)[1]]
        hull = ConvexHull(corners)
    return corners[np.sort(hull.vertices)]


def _point_within(planes: NDArray[np.float64], middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Point (3,) [m] below all planes: `middle` if it is, else the deepest one.

    The mean of a hull's corners may lie outside the inset hull if most of them crowd along a thin rim.

    Args:
        planes: (n, 4) unit normals and offsets [m].
        middle: (3,) point to take if it lies below all planes [m].

    Raises:
        QhullError: no point lies below all of them.
    """
    if (planes[:, :3] @ middle + planes[:, 3] < 0).all():
        return middle
    A = np.column_stack([planes[:, :3], np.ones(len(planes))])
    found = linprog([0, 0, 0, -1], A_ub=A, b_ub=-planes[:, 3], bounds=[(None, None)] * 3 + [(None, 1.0)])
    if found.status != 0 or found.x[3] <= 0:
        raise QhullError("nothing is left of the body")
    return np.asarray(found.x[:3])
