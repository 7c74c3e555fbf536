"""Resting planes of an object, and those stable for every expected centre of mass.

Which of them a plan uses is chosen in footing.py. VISAPP 2013, 3.1.2; method 1.2. Q is the region that is
believed to hold the centre of mass.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import BoolArray
from analyze.geometry.rotations import plane_basis
from analyze.planning.hypothesis import Region
from analyze.types import Array, IntArray

COPLANAR_FRACTION = 2e-4
"""Distance of hull vertices from a common plane, over the longest extent, up to which they are coplanar."""
COPLANAR_ANGLE = np.radians(0.3)
"""Largest angle [rad] between facets of one plane; facets too narrow to have a normal may point anywhere."""
PARALLEL_ANGLE = np.radians(1.0)
"""Largest angle [rad] between two planes that count as parallel in the paper's rule."""
MIN_AREA_FRACTION = 1e-3
"""Fraction of the hull's area below which a face is no resting plane."""
MAX_COLLINEAR_TURN = np.radians(0.5)
"""Turn [rad] at a corner of a support polygon below which it is left out."""


@dataclass(frozen=True, eq=False)
class RestingPlane:
    """Face of an object's convex hull on which the object can be put down.

    Coplanar facets (triangles) of the hull are merged into one face; its outline is the support polygon. O is
    the object frame, W the world frame of the object at rest on the face (z up).
    """

    id: str
    """Name of the face in plans, such as p0; numbered from the largest."""
    up: Array
    """(3,) unit normal into the object, in O: W's z when the object rests on the face."""
    level: float
    """Offset up.x of the plane from O's origin [m]."""
    polygon: Array
    """(k, 3) corners of the support polygon [m] in O, counter-clockwise seen from above, without collinear
    ones."""
    area: float
    """Area of the support polygon [m^2]."""

    @property
    def edges(self) -> tuple[Array, Array]:
        """Starts (k, 3) and ends (k, 3) of the support polygon's edges [m], in the object frame."""
        return self.polygon, np.roll(self.polygon, -1, axis=0)

    @cached_property
    def outward(self) -> Array:
        """Outward unit normals (k, 3) of the support polygon's edges, in its plane, in the object frame."""
        start, end = self.edges
        across = np.cross(end - start, self.up)
        return across / np.linalg.norm(across, axis=1, keepdims=True)

    def margin(self, points: Array) -> Array:
        """Distance (n,) [m] of points, projected on the plane, from the nearest edge of the support polygon.

        The support polygon is the convex outline of the object's contacts with the table. The distance is
        negative for a point outside it.

        Args:
            points: (n, 3) points [m], in the object frame.
        """
        return np.min(np.einsum("ki,ki->k", self.polygon, self.outward) - points @ self.outward.T, axis=1)

    def margin_of(self, region: Region) -> float:
        """Smallest distance [m] of a region, projected on the plane, from the support polygon's edges.

        The support polygon is the convex outline of the object's contacts with the table. The distance is
        negative if part of the region lies outside it.

        Args:
            region: Region believed to hold the centre of mass, in the object frame.
        """
        return float(np.min(self._room(region) - region.reach(self.outward)))

    def firmness(self, region: Region) -> float:
        """Largest factor by which a region can be scaled and still lie over the support polygon.

        The region is scaled about its centre. The factor is at least 1 if all of the region lies over the
        polygon, and negative if the region's centre does not.

        Args:
            region: Region believed to hold the centre of mass, in the object frame.
        """
        return float(np.min(self._room(region) / np.maximum(region.reach(self.outward), 1e-12)))

    def _room(self, region: Region) -> Array:
        """Distances (k,) [m] of a region's centre from the k edges of the support polygon, positive inside.

        The centre of the region, which is believed to hold the centre of mass, is projected on the plane.
        """
        return np.einsum("ki,ki->k", self.polygon - region.centre, self.outward)


def resting_planes(model: ObjectModel) -> tuple[RestingPlane, ...]:
    """All faces on which an object can be put down, largest first, with ids p0, p1 and so on.

    A face consists of coplanar facets (triangles) of the convex hull. It starts with the largest facet not
    yet used and takes in neighbours whose corners lie in that facet's plane within `COPLANAR_FRACTION` of the
    longest extent and whose normals agree within `COPLANAR_ANGLE`. The normals of very narrow facets are
    unreliable and are not compared. Faces up to `MIN_AREA_FRACTION` of the hull's area are left out. The
    result is cached on the model.
    """
    return model.cached("resting planes", _resting_planes)


def _resting_planes(model: ObjectModel) -> tuple[RestingPlane, ...]:
    hull = ConvexHull(model.hull_vertices)
    vertices, facets, normals = hull.points, hull.simplices, hull.equations[:, :3]
    a, b, c = np.moveaxis(vertices[facets], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    longest = np.max([np.linalg.norm(each, axis=1) for each in (b - a, c - b, a - c)], axis=0)
    tolerance = COPLANAR_FRACTION * float(model.extent.max())
    splinter = 2 * areas < tolerance * longest
    smallest = MIN_AREA_FRACTION * float(hull.area)
    used = _too_small(hull.neighbors.astype(np.int64), normals, splinter, areas, smallest)
    found: list[tuple[Array, Array, float]] = []
    for seed in np.argsort(-areas, kind="stable"):
        if used[seed]:
            continue
        members = _coplanar(int(seed), hull, splinter, used, tolerance)
        used[members] = True
        if areas[members].sum() < smallest:
            continue
        up = -(areas[members] @ normals[members])
        up /= np.linalg.norm(up)
        polygon = _support_polygon(vertices[np.unique(facets[members])], up)
        if len(polygon) >= 3:
            found.append((up, polygon, _area(polygon, up)))
    order = sorted(found, key=lambda item: (-round(item[2], 9), *np.round(item[0], 6)))
    kept = [item for item in order if item[2] > smallest]
    return tuple(
        RestingPlane(f"p{i}", up, float(np.mean(polygon @ up)), polygon, area)
        for i, (up, polygon, area) in enumerate(kept)
    )


def _too_small(
    neighbours: IntArray, normals: Array, splinter: BoolArray, areas: Array, smallest: float
) -> BoolArray:
    """Mask (f,) of hull facets that cannot be part of a face of area `smallest` or more.

    Neighbours count as connected if their normals agree, or if one is too narrow to have a reliable normal. A
    facet is too small if all facets connected to it, directly or through others, together have less area than
    `smallest`.

    Args:
        neighbours: (f, 3) indices of each facet's neighbours.
        normals: (f, 3) unit normals.
        splinter: (f,) True for facets too narrow to have a reliable normal.
        areas: (f,) areas [m^2].
        smallest: Smallest area of a face [m^2].
    """
    count = len(areas)
    facet, other = np.repeat(np.arange(count), 3), neighbours.ravel()
    alike = (
        (np.einsum("ij,ij->i", normals[facet], normals[other]) > np.cos(COPLANAR_ANGLE))
        | splinter[facet]
        | splinter[other]
    )
    links = coo_array((np.ones(int(alike.sum())), (facet[alike], other[alike])), shape=(count, count))
    _, group = connected_components(links, directed=False)
    return np.asarray(np.bincount(group, weights=areas))[group] < smallest


def _coplanar(
    seed: int, hull: ConvexHull, splinter: BoolArray, used: BoolArray, tolerance: float
) -> IntArray:
    """Indices of the facet `seed` and of unused facets connected to it that are coplanar with it.

    Args:
        seed: Index of the first facet.
        hull: Convex hull of the object.
        splinter: (f,) True for facets too narrow to have a reliable normal; theirs is not compared.
        used: (f,) True for facets that already belong to a face.
        tolerance: Largest distance of a facet's corners from the plane of `seed` [m].
    """
    normal, level = hull.equations[seed, :3], hull.equations[seed, 3]
    seen = np.zeros(len(used), dtype=bool)
    seen[seed] = True
    members, edge = [np.array([seed])], np.array([seed])
    while len(edge):
        near = np.unique(hull.neighbors[edge])
        near = near[~seen[near] & ~used[near]]
        seen[near] = True
        alike = (hull.equations[near, :3] @ normal > np.cos(COPLANAR_ANGLE)) | splinter[near]
        near = near[alike]
        edge = near[(np.abs(hull.points[hull.simplices[near]] @ normal + level) < tolerance).all(axis=1)]
        members.append(edge)
    return np.concatenate(members).astype(np.int64)


def paper_stable_planes(planes: tuple[RestingPlane, ...], region: Region) -> tuple[RestingPlane, ...]:
    """The two largest stable planes that are not parallel, by the paper (VISAPP 2013, 3.1.2).

    Stable are planes whose support polygon holds the projection of all of `region`; of parallel ones
    (opposite faces too) the largest is kept. If fewer than two are returned, the paper's method is not
    applicable.

    Args:
        planes: Resting planes, largest first.
        region: Region believed to hold the centre of mass.
    """
    kept: list[RestingPlane] = []
    for plane in planes:
        turned = all(abs(plane.up @ other.up) < np.cos(PARALLEL_ANGLE) for other in kept)
        if turned and plane.margin_of(region) > 0:
            kept.append(plane)
    return tuple(kept[:2])


def _support_polygon(points: Array, up: Array) -> Array:
    """Corners (k, 3) [m] of the convex polygon around `points` (n, 3) [m], counter-clockwise about `up`.

    The points lie nearly in one plane with the unit normal `up` (3,). Corners with a turn of at most
    `MAX_COLLINEAR_TURN` are left out (monotone chain, Andrew 1979).
    """
    u, v = plane_basis(up)
    x, y = points @ u, points @ v
    order = [int(i) for i in np.lexsort((y, x))]
    flat: list[tuple[float, float]] = list(zip(x.tolist(), y.tolist(), strict=True))

    def chain(indices: list[int]) -> list[int]:
        line: list[int] = []
        for i in indices:
            while len(line) >= 2 and _turn(flat[line[-2]], flat[line[-1]], flat[i]) <= MAX_COLLINEAR_TURN:
                line.pop()
            line.append(i)
        return line[:-1]

    return points[chain(order) + chain(order[::-1])]


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Turn [rad] from direction ab to bc of points in the plane, positive to the left, from -pi to pi.

    It is 0 if b coincides with a or c.
    """
    first, second = (b[0] - a[0], b[1] - a[1]), (c[0] - b[0], c[1] - b[1])
    if math.hypot(*first) * math.hypot(*second) < 1e-18:
        return 0.0
    return math.atan2(
        first[0] * second[1] - first[1] * second[0], first[0] * second[0] + first[1] * second[1]
    )


def _area(polygon: Array, up: Array) -> float:
    return (
        float(np.cross(polygon - polygon[0], np.roll(polygon, -1, axis=0) - polygon[0]).sum(axis=0) @ up) / 2
    )
