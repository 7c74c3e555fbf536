"""Planes on which the object rests, and which of them are stable for every c in Q (paper 3.1.2)."""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

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

COPLANAR = 2e-4
"""part of the longest edge within which hull vertices lie in one plane"""
COPLANAR_ANGLE = np.radians(0.3)
"""between facets of one plane; splinters narrower than `COPLANAR` may point anywhere"""
PARALLEL_ANGLE = np.radians(1.0)
"""between two planes that the paper calls parallel"""
SMALLEST_AREA = 1e-3
"""part of the hull's area below which a face is no plane to rest on"""
COLLINEAR = np.radians(0.5)


@dataclass(frozen=True, eq=False)
class RestingPlane:
    """A face of the convex hull, coplanar facets merged."""

    id: str
    up: Array
    """(3,) unit, in O: W's z when the object rests on it"""
    level: float
    """m: up.x of the plane"""
    polygon: Array
    """(k, 3) m, in O: corners of the support polygon, counter-clockwise seen from above, collinear ones left out"""
    area: float
    """m^2"""

    @property
    def edges(self) -> tuple[Array, Array]:
        """Start and end (k, 3) of each edge."""
        return self.polygon, np.roll(self.polygon, -1, axis=0)

    def outward(self) -> Array:
        """Unit vectors (k, 3) in the plane, out of the polygon, one per edge."""
        return self._outward

    @cached_property
    def _outward(self) -> Array:
        start, end = self.edges
        across = np.cross(end - start, self.up)
        return across / np.linalg.norm(across, axis=1, keepdims=True)

    def margin(self, points: Array) -> float:
        """Least distance [m] of the projections of `points` (n, 3) from the polygon's edges; negative: one is outside."""
        start, _ = self.edges
        out = self.outward()
        return float(np.min(np.einsum("ki,ki->k", start, out) - points @ out.T))

    def margin_of(self, region: Region) -> float:
        """The same of all points of `region`."""
        return float(np.min(self._room(region) - region.reach(self.outward())))

    def firmness(self, region: Region) -> float:
        """Largest part of `region` about its centre that lies over the polygon; 1 and more: all of it, negative: not even its centre."""
        return float(np.min(self._room(region) / np.maximum(region.reach(self.outward()), 1e-12)))

    def _room(self, region: Region) -> Array:
        """Distance (k,) [m] of the projected centre from each edge."""
        return np.einsum("ki,ki->k", self.polygon - region.centre, self.outward())


def resting_planes(model: ObjectModel) -> tuple[RestingPlane, ...]:
    """All faces of the convex hull, coplanar facets merged, largest first; slivers left out.

    From the largest facet on, neighbours are taken in whose corners lie in its plane within `COPLANAR` and which point alike.
    """
    return model.once("resting planes", _resting_planes)


def _resting_planes(model: ObjectModel) -> tuple[RestingPlane, ...]:
    hull = ConvexHull(model.hull_vertices)
    vertices, facets, normals = hull.points, hull.simplices, hull.equations[:, :3]
    a, b, c = np.moveaxis(vertices[facets], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    longest = np.max([np.linalg.norm(each, axis=1) for each in (b - a, c - b, a - c)], axis=0)
    tolerance = COPLANAR * float(model.extent.max())
    splinter = 2 * areas < tolerance * longest
    smallest = SMALLEST_AREA * float(hull.area)
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
    return tuple(RestingPlane(f"p{i}", up, float(np.mean(polygon @ up)), polygon, area) for i, (up, polygon, area) in enumerate(kept))


def _too_small(neighbours: IntArray, normals: Array, splinter: BoolArray, areas: Array, smallest: float) -> BoolArray:
    """Facets (f,) that can be part of no face of `smallest` area [m^2]: with all they are joined to by alike neighbours they have less."""
    count = len(areas)
    facet, other = np.repeat(np.arange(count), 3), neighbours.ravel()
    alike = (np.einsum("ij,ij->i", normals[facet], normals[other]) > np.cos(COPLANAR_ANGLE)) | splinter[facet] | splinter[other]
    links = coo_array((np.ones(int(alike.sum())), (facet[alike], other[alike])), shape=(count, count))
    _, group = connected_components(links, directed=False)
    return np.asarray(np.bincount(group, weights=areas))[group] < smallest


def _coplanar(seed: int, hull: ConvexHull, splinter: BoolArray, used: BoolArray, tolerance: float) -> IntArray:
    """Unused facets joined to `seed` that point alike and lie in its plane within `tolerance` [m]."""
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


def stable_planes(planes: tuple[RestingPlane, ...], region: Region) -> tuple[RestingPlane, ...]:
    """Ours: every plane over whose support polygon all of Q lies, parallel ones included."""
    return tuple(plane for plane in planes if plane.margin_of(region) > 0)


def paper_stable_planes(planes: tuple[RestingPlane, ...], region: Region) -> tuple[RestingPlane, ...]:
    """The paper's: of parallel planes only the largest, then the two largest. Fewer than two: the paper cannot go on."""
    kept: list[RestingPlane] = []
    for plane in stable_planes(planes, region):
        if all(abs(plane.up @ other.up) < np.cos(PARALLEL_ANGLE) for other in kept):
            kept.append(plane)
    return tuple(kept[:2])


def _support_polygon(points: Array, up: Array) -> Array:
    """Convex polygon (k, 3) around `points`, counter-clockwise about `up` (Andrew 1979), nearly straight corners left out."""
    u, v = plane_basis(up)
    x, y = points @ u, points @ v
    order = [int(i) for i in np.lexsort((y, x))]
    flat: list[tuple[float, float]] = list(zip(x.tolist(), y.tolist(), strict=True))

    def chain(indices: list[int]) -> list[int]:
        line: list[int] = []
        for i in indices:
            while len(line) >= 2 and _turn(flat[line[-2]], flat[line[-1]], flat[i]) <= COLLINEAR:
                line.pop()
            line.append(i)
        return line[:-1]

    return points[chain(order) + chain(order[::-1])]


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Turn [rad] from ab to bc; + is to the left, and near pi at the tip of a needle."""
    first, second = (b[0] - a[0], b[1] - a[1]), (c[0] - b[0], c[1] - b[1])
    if math.hypot(*first) * math.hypot(*second) < 1e-18:
        return 0.0
    return math.atan2(first[0] * second[1] - first[1] * second[0], first[0] * second[0] + first[1] * second[1])


def _area(polygon: Array, up: Array) -> float:
    return float(np.cross(polygon - polygon[0], np.roll(polygon, -1, axis=0) - polygon[0]).sum(axis=0) @ up) / 2
