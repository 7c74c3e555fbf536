"""Signed depth below a surface and its gradient, for boxes, cylinders and meshes; lengths in m.

Points are in the object frame O (the shape file's); a box or cylinder is centred on its origin.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from analyze.geometry import polyhedron
from analyze.types import Array, IntArray

NEEDLE = 4
"""Length of a triangle over its width, in steps of its samples, from which it has fewer rows across."""
NEAREST_SAMPLES = 5
"""Number of nearest surface samples of a point whose faces are examined."""
MAX_POINTS = 10_000
"""Number of points processed at a time."""
MANY_PLANES = 200
"""Number of planes from which on they are preselected for `POINTS_TOGETHER` points at a time."""
POINTS_TOGETHER = 27
"""Successive points that mostly lie close together (the subcells of a cube): few of many planes matter to
them."""
MAX_HEIGHTS = 500_000
"""Number of point-plane heights computed at a time: as many as the caches hold; more take ten times as
long."""


@dataclass(frozen=True)
class Depth:
    """Depth (n,) of n points below a surface [m], positive inside, and its gradient (n, 3), without unit."""

    value: Array
    """(n,) depth [m], positive inside."""
    gradient: Array
    """(n, 3) gradient of the depth: a unit vector inwards; 0 on the axis of a cylinder."""


def box_depth(half_size: Array, points: Array) -> Depth:
    """Depth of points in a box centred on the origin, with edges along the axes, and its gradient.

    Args:
        half_size: (3,) half edges [m].
        points: (n, 3) points [m].

    Returns:
        Depths (n,) [m], the distances to the surface, negative outside; and gradients (n, 3), unit vectors
        inwards.
    """
    excess = np.abs(points) - half_size
    outside = np.maximum(excess, 0)
    far = np.linalg.norm(outside, axis=1)
    nearest = np.argmax(excess, axis=1)
    face = np.zeros_like(points)
    face[np.arange(len(points)), nearest] = 1.0
    direction = np.where(far[:, None] > 0, outside / np.where(far > 0, far, 1.0)[:, None], face)
    value = np.where(far > 0, -far, -excess.max(axis=1))
    return Depth(value, -direction * np.where(points < 0, -1.0, 1.0))


def cylinder_depth(radius: float, half_height: float, points: Array) -> Depth:
    """Depth of points in a cylinder centred on the origin, with its axis along z, and its gradient.

    The depth (n,) [m] is the distance to the surface, negative outside. The gradient (n, 3) is a unit vector
    inwards, but 0 on the axis where the flank is nearest.

    Args:
        radius: Radius [m].
        half_height: Half the height [m].
        points: (n, 3) points [m].
    """
    across = np.linalg.norm(points[:, :2], axis=1)
    radial = np.zeros_like(points)
    radial[:, :2] = points[:, :2] / np.where(across > 0, across, 1.0)[:, None]
    axial = np.zeros_like(points)
    axial[:, 2] = np.where(points[:, 2] < 0, -1.0, 1.0)
    excess = np.stack([across - radius, np.abs(points[:, 2]) - half_height], axis=1)
    outside = np.maximum(excess, 0)
    far = np.linalg.norm(outside, axis=1)
    share = np.where(
        far[:, None] > 0,
        outside / np.where(far > 0, far, 1.0)[:, None],
        excess == excess.max(axis=1, keepdims=True),
    )
    direction = share[:, :1] * radial + share[:, 1:] * axial
    length = np.linalg.norm(direction, axis=1)
    return Depth(
        np.where(far > 0, -far, -excess.max(axis=1)), -direction / np.where(length > 0, length, 1.0)[:, None]
    )


def convex_depth(planes: Array, points: Array) -> Depth:
    """Depths (n,) [m] of points in a convex body, positive inside, and their gradients (n, 3).

    The depth is minus the largest height over a face's plane. Outside, beside edges and corners, its size is
    less than the distance from the body. For speed, successive points should lie close together if there are
    `MANY_PLANES` planes or more.

    Args:
        planes: (p, 4) unit outward normals n and d [m] of the faces, n.x + d = 0.
        points: (n, 3) points [m].
    """
    value = np.empty(len(points))
    gradient = np.empty((len(points), 3))
    step = max(1, MAX_HEIGHTS // len(planes)) if len(planes) < MANY_PLANES else POINTS_TOGETHER
    for start in range(0, len(points), step):
        piece = slice(start, start + step)
        near = planes if step != POINTS_TOGETHER else _candidate_planes(planes, points[piece])
        heights = points[piece] @ near[:, :3].T + near[:, 3]
        nearest = np.argmax(heights, axis=1)
        value[piece] = -heights[np.arange(len(heights)), nearest]
        gradient[piece] = -near[nearest, :3]
    return Depth(value, gradient)


def largest_height(planes: Array, points: Array) -> Array:
    """Height (n,) [m] of each point over that of several planes over which it is highest.

    The points may be in any order: successive ones need not lie close together.

    Args:
        planes: (p, 4) unit normals n and d [m], n.x + d = 0.
        points: (n, 3) points [m], at least one.
    """
    step = max(1, MAX_HEIGHTS // len(planes))
    pieces = [points[start : start + step] for start in range(0, len(points), step)]
    return np.concatenate([(piece @ planes[:, :3].T + planes[:, 3]).max(axis=1) for piece in pieces])


def _candidate_planes(planes: Array, points: Array) -> Array:
    """Planes (k, 4) of `planes` that are needed for the largest height of each point over any of them.

    A height is n.x + d. A plane is kept if the height of the points' middle over it is below the middle's
    largest height by at most twice the largest distance of a point from the middle.

    Args:
        planes: (p, 4) unit normals n and d [m], n.x + d = 0.
        points: (n, 3) points [m].
    """
    middle = points.mean(axis=0)
    reach = float(np.sqrt(np.max(np.sum((points - middle) ** 2, axis=1))))
    height = planes[:, :3] @ middle + planes[:, 3]
    return planes[height >= float(height.max()) - 2.001 * reach - 1e-12]


@dataclass(frozen=True)
class SurfaceIndex:
    """Search index of a mesh's surface: samples with their faces, to find the faces nearest to a point."""

    triangles: Array
    """(f, 3, 3) corners of the faces [m]."""
    tree: KDTree
    """Search tree of the samples."""
    face: IntArray
    """(samples,) index of each sample's face."""
    spacing: float
    """Largest distance of a point of the surface from its nearest sample [m]."""


def surface_index(vertices: Array, faces: IntArray) -> SurfaceIndex:
    """Search index (samples with their faces) of a mesh's surface.

    Samples are 1/100 of the mesh's extent apart or closer. A needle, as along a cylinder's flank, has as many
    rows of them as its width needs: with as many across as along, some meshes would have millions.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces.
    """
    triangles = vertices[faces]
    spacing = float(np.ptp(vertices, axis=0).max()) / 100
    sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    longest, first = sides.max(axis=1), np.argmax(sides, axis=1)
    width = np.linalg.norm(polyhedron.area_vectors(triangles), axis=1) / np.maximum(longest, 1e-300)
    steps = np.maximum(1, np.ceil(longest / spacing)).astype(int)
    rows = np.maximum(1, np.ceil(width / spacing)).astype(int)
    rows = np.where(steps >= NEEDLE * rows, rows, steps)
    points: list[Array] = []
    owners: list[IntArray] = []
    for many, across in np.unique(np.stack([steps, rows], axis=1), axis=0):
        mine = np.flatnonzero((steps == many) & (rows == across))
        weights = _grid(int(many), int(across))
        # Moved towards the centroid, so that samples on a common edge do not coincide.
        weights = 0.98 * weights + 0.02 / 3
        corners = (first[mine, None] + np.arange(3)) % 3
        sorted_corners = np.take_along_axis(triangles[mine], corners[:, :, None], axis=1)
        points.append(np.einsum("wk,fki->fwi", weights, sorted_corners).reshape(-1, 3))
        owners.append(np.repeat(mine, len(weights)))
    return SurfaceIndex(
        triangles, KDTree(np.vstack(points)), np.concatenate(owners).astype(np.int64), spacing
    )


def _grid(steps: int, rows: int) -> Array:
    """Barycentric coordinates (w, 3) of points of a triangle, at most a step apart along its first edge.

    Args:
        steps: Number of steps along the first edge.
        rows: Number of steps from there to the third corner.
    """
    found: list[Array] = []
    for row in range(rows + 1):
        up = row / rows
        along = np.linspace(0.0, 1.0, 1 + int(np.ceil(round(steps * (1 - up), 9))))
        found.append(np.stack([(1 - up) * (1 - along), (1 - up) * along, np.full(len(along), up)], axis=1))
    return np.vstack(found)


def mesh_depth(
    index: SurfaceIndex, vertices: Array, faces: IntArray, points: Array, outside: float = np.inf
) -> Depth:
    """Depth (n,) [m] of points in a closed mesh, negative outside, and its gradient (n, 3).

    The depth is the distance to the nearest face; only the faces of the `NEAREST_SAMPLES` nearest samples of
    the surface are examined. The sign follows from the winding number. The gradient is the unit vector
    straight inwards; for a point on the surface it is minus the face's normal.

    Args:
        index: Index of the mesh's surface.
        vertices: (v, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.
        points: (n, 3) points [m].
        outside: Distance [m] outside the mesh from which on points may get minus this distance as their
            depth, and 0 as its gradient: those above wide faces take most of the time.
    """
    within = polyhedron.inside(vertices, faces, points)
    used = within.copy()
    if np.isfinite(outside):
        found = index.tree.query(points[~within], distance_upper_bound=outside + index.spacing)[0]
        used[~within] = np.isfinite(np.asarray(found))
    else:
        used[:] = True
    value, gradient = np.full(len(points), outside), np.zeros((len(points), 3))
    exact = np.flatnonzero(used)
    for start in range(0, len(exact), MAX_POINTS):
        piece = exact[start : start + MAX_POINTS]
        near = index.face[np.asarray(index.tree.query(points[piece], k=NEAREST_SAMPLES)[1])]
        count = len(near)
        repeated = np.repeat(points[piece], NEAREST_SAMPLES, axis=0)
        closest = closest_on_triangles(repeated, index.triangles[near.ravel()]).reshape(
            count, NEAREST_SAMPLES, 3
        )
        away = points[piece][:, None] - closest
        distance = np.linalg.norm(away, axis=2)
        best = np.argmin(distance, axis=1)
        rows = np.arange(count)
        value[piece] = distance[rows, best]
        face = near[rows, best]
        normal = polyhedron.area_vectors(index.triangles[face])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        length = distance[rows, best][:, None]
        gradient[piece] = np.where(
            length > 1e-12, away[rows, best] / np.where(length > 1e-12, length, 1.0), -normal
        )
    sign = np.where(np.logical_or(within, value <= 1e-12), 1.0, -1.0)
    return Depth(sign * value, gradient * sign[:, None])


def closest_on_triangles(points: Array, triangles: Array) -> Array:
    """Closest points (n, 3) [m] to n points on n triangles, one each.

    Source: Ericson, Real-Time Collision Detection, 2005, 5.1.5.

    Args:
        points: (n, 3) points [m].
        triangles: (n, 3, 3) corners of the triangles [m]; the second index is the corner.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    square = np.einsum("ij,ij->i", normal, normal)
    ap = points - a
    safe = np.where(square > 0, square, 1.0)
    u = np.einsum("ij,ij->i", np.cross(ap, ac), normal) / safe
    v = np.einsum("ij,ij->i", np.cross(ab, ap), normal) / safe
    in_face = (square > 0) & (u >= 0) & (v >= 0) & (u + v <= 1)
    best = a + u[:, None] * ab + v[:, None] * ac
    nearest = np.where(in_face, 0.0, np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        side = end - start
        length = np.einsum("ij,ij->i", side, side)
        t = np.clip(np.einsum("ij,ij->i", points - start, side) / np.where(length > 0, length, 1.0), 0, 1)
        candidate = start + t[:, None] * side
        distance = np.linalg.norm(points - candidate, axis=1)
        closer = distance < nearest
        best = np.where(closer[:, None], candidate, best)
        nearest = np.where(closer, distance, nearest)
    return np.asarray(best)
