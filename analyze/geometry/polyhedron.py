"""Closed triangle surfaces: winding repair, mass properties, ray casting, inside test; lengths in m."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from analyze.types import Array, IntArray

BoolArray = NDArray[np.bool_]

RAY_TURN = np.array([[0.9, 0.26807, -0.34397], [-0.32, 0.94157, -0.10507], [0.29571, 0.20463, 0.93310]])
"""Arbitrary rotation, so that no ray runs along a face or through an edge of a body aligned with its
frame."""

MAX_RAY_FACES = 100_000
"""Number of pairs of a ray and a face that are tested at a time, which bounds the memory."""


@dataclass(frozen=True)
class MassProperties:
    """Volume [m^3], centroid [m] and inertia of a uniform solid, in the frame of its vertices.

    The inertia is about the centroid, per kilogram [m^2].
    """

    volume: float
    """Volume [m^3]."""
    centroid: Array
    """(3,) centroid [m]."""
    unit_inertia: Array
    """(3, 3) inertia about the centroid per kilogram [m^2]."""


def open_edges(faces: IntArray) -> int:
    """Number of open edges of a mesh: those that an odd number of `faces` (f, 3) share.

    It is 0 for a closed surface.
    """
    edges = directed_edges(faces)
    # One number per edge: sorting those is ten times as fast as sorting pairs.
    key = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    _, counts = np.unique(key, return_counts=True)
    return int(np.sum(counts % 2))


def without_degenerate(faces: IntArray) -> IntArray:
    """Faces (k, 3) of `faces` (f, 3) that have three different vertices."""
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return faces[whole]


def consistently_wound(faces: IntArray) -> tuple[IntArray, IntArray, int]:
    """Turn faces so that neighbours run their common edge in opposite directions.

    As few faces as possible of each body (connected part) are turned, so a body may have all its faces
    clockwise from outside; `outward` corrects that. Edges with more than two faces do not connect bodies.

    Args:
        faces: (f, 3) faces.

    Returns:
        Faces (f, 3), the number (f,) of the body of each, from 0, and how many faces were turned.
    """
    count = len(faces)
    edges = np.sort(directed_edges(faces), axis=1)
    owner = np.tile(np.arange(count), 3)
    ascending = faces[:, [0, 1, 2]] < faces[:, [1, 2, 0]]
    sense = ascending.T.ravel()
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = np.all(edges[order[1:]] == edges[order[:-1]], axis=1)
    # Edges with more than two faces (bodies that touch) do not determine which faces belong together.
    run_before = np.concatenate([[False], same[:-1]])
    run_after = np.concatenate([same[1:], [False]])
    pair = same & ~run_before & ~run_after
    first, second = order[:-1][pair], order[1:][pair]
    a, b = owner[first], owner[second]
    differ = sense[first] == sense[second]
    links = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    _, body = connected_components(links, directed=False)
    turned = _two_colouring(count, a, b, differ)
    return _with_turned(faces, turned), body.astype(np.int64), int(np.sum(turned))


def outward(vertices: Array, faces: IntArray, body: IntArray) -> tuple[IntArray, int]:
    """Turn those bodies (connected parts of a mesh) whose faces are clockwise from outside.

    They are recognised by a negative volume.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, consistently wound.
        body: (f,) number of the body of each face, from 0.

    Returns:
        Faces (f, 3), all counter-clockwise from outside, and the number of bodies turned.
    """
    inside_out = body_volumes(vertices, faces, body) < 0
    return _with_turned(faces, inside_out[body]), int(inside_out.sum())


def hull_faces(hull: ConvexHull) -> IntArray:
    """Faces (f, 3) of the 3-D convex hull `hull`, counter-clockwise from outside.

    Their entries are indices of `hull.points`.
    """
    faces = hull.simplices.astype(np.int64)
    inwards = np.einsum("ij,ij->i", area_vectors(hull.points[faces]), hull.equations[:, :3]) < 0
    return _with_turned(faces, inwards)


def area_vectors(triangles: Array) -> Array:
    """Vectors (f, 3) [m^2] along the normals of f triangles, of twice their areas.

    They point outwards if the corners are counter-clockwise from outside.

    Args:
        triangles: (f, 3, 3) corners of the triangles [m]; the second index is the corner.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.cross(b - a, c - a)


def body_volumes(vertices: Array, faces: IntArray, body: IntArray) -> Array:
    """Volumes (b,) [m^3] of b closed bodies; negative for those with faces clockwise from outside.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) vertex indices of the faces.
        body: (f,) number of the body of each face, from 0.
    """
    a, b, c = np.moveaxis((vertices - vertices.mean(axis=0))[faces], 1, 0)
    return np.asarray(np.bincount(body, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6), dtype=np.float64)


def mass_properties(vertices: Array, faces: IntArray) -> MassProperties:
    """Volume, centroid, and inertia per kilogram about the centroid, of a uniform solid.

    They are in m^3, m and m^2, in the frame of the vertices (Blow and Binstock 2004).

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside; otherwise the volume is negative. They must
            enclose a volume.
    """
    origin = vertices.mean(axis=0)
    a, b, c = np.moveaxis((vertices - origin)[faces], 1, 0)
    six = np.einsum("ij,ij->i", a, np.cross(b, c))
    volume = float(six.sum() / 6)
    total = a + b + c
    with np.errstate(divide="ignore", invalid="ignore"):  # the caller refuses a body without a volume
        mean = (six @ total) / 24 / volume
        second = sum((x * six[:, None]).T @ x for x in (a, b, c, total)) / 120
        second = np.asarray(second) / volume - np.outer(mean, mean)
    return MassProperties(volume, origin + mean, np.trace(second) * np.eye(3) - second)


def merged_solid(solids: Sequence[MassProperties]) -> MassProperties:
    """Several solids of one density as one: volume [m^3], centroid [m], inertia tensor per kilogram [m^2].

    The centroid is (3,); the tensor (3, 3) is about it. Frame and axes are those of `solids`.

    Args:
        solids: Solids that do not overlap; the volume of at least one is not 0.
    """
    volume = sum(one.volume for one in solids)
    centroid = np.sum([one.volume * one.centroid for one in solids], axis=0) / volume
    inertia = np.zeros((3, 3))
    for one in solids:
        arm = one.centroid - centroid
        inertia = inertia + one.volume / volume * (
            one.unit_inertia + (arm @ arm) * np.eye(3) - np.outer(arm, arm)
        )
    return MassProperties(volume, centroid, inertia)


def first_hit(vertices: Array, faces: IntArray, origin: Array, direction: Array) -> float:
    """Distance [m] to the first face that a ray meets, from either side; inf if it meets none.

    Args:
        vertices: (n, 3) vertices [m].
        faces: (f, 3) faces.
        origin: (3,) start of the ray [m].
        direction: (3,) unit direction of the ray.
    """
    return float(ray_distances(vertices[faces], origin, direction).min(initial=np.inf))


def ray_distances(triangles: Array, origins: Array, directions: Array) -> Array:
    """Distances (n,) [m] from a ray's origin to its triangle, from either side; inf where it misses it.

    Source: Moller and Trumbore 1997.

    Args:
        triangles: (n, 3, 3) corners, one triangle per ray [m].
        origins: (n, 3) starts of the rays, or (3,) one for all [m].
        directions: (n, 3) unit directions, or (3,) one for all.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, ac = b - a, c - a
    p = np.cross(directions, ac)
    determinant = np.einsum("ij,ij->i", ab, p)
    usable = np.abs(determinant) > 1e-15
    inverse = 1 / np.where(usable, determinant, 1.0)
    t = origins - a
    u = np.einsum("ij,ij->i", t, p) * inverse
    q = np.cross(t, ab)
    v = (q * directions).sum(axis=1) * inverse
    distance = np.einsum("ij,ij->i", ac, q) * inverse
    hit = usable & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (distance > 0)
    return np.where(hit, distance, np.inf)


def inside(vertices: Array, faces: IntArray, points: Array) -> BoolArray:
    """Mask (n,) of points inside a closed surface: their winding number is above 0.

    Args:
        vertices: (v, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.
        points: (n, 3) points [m].
    """
    return np.asarray(winding(vertices, faces, points) > 0)


def winding(vertices: Array, faces: IntArray, points: Array) -> IntArray:
    """Winding number (n,) of a closed surface about points: 1 inside, 0 outside.

    It has other values where the surface crosses itself or bodies overlap. It is the sum of a ray's signed
    crossings, with the faces sorted into a grid normal to the ray.

    Args:
        vertices: (v, 3) vertices [m].
        faces: (f, 3) faces, counter-clockwise from outside.
        points: (n, 3) points [m].
    """
    turned = vertices @ RAY_TURN.T
    probe = points @ RAY_TURN.T
    corners = turned[faces]
    side = int(np.clip(np.sqrt(len(faces)), 1, 200))
    lower = corners[..., :2].min(axis=(0, 1))
    step = (corners[..., :2].max(axis=(0, 1)) - lower) / side * (1 + 1e-9)
    low = np.clip(((corners[..., :2].min(axis=1) - lower) / step).astype(int), 0, side - 1)
    high = np.clip(((corners[..., :2].max(axis=1) - lower) / step).astype(int), 0, side - 1)
    span = high - low + 1
    repeat = span[:, 0] * span[:, 1]
    face = np.repeat(np.arange(len(faces)), repeat)
    rank = np.arange(len(face)) - np.repeat(np.cumsum(repeat) - repeat, repeat)
    cell = (low[face, 0] + rank // span[face, 1]) * side + low[face, 1] + rank % span[face, 1]
    order = np.argsort(cell, kind="stable")
    face = face[order]
    start = np.searchsorted(cell[order], np.arange(side * side + 1))
    where = np.floor((probe[:, :2] - lower) / step).astype(int)
    within = np.all((where >= 0) & (where < side), axis=1)
    crossings = np.zeros(len(points), dtype=np.int64)
    inner = np.flatnonzero(within)
    home = where[inner, 0] * side + where[inner, 1]
    many = start[home + 1] - start[home]
    # So many rays at a time that the memory for their faces stays small.
    batch = np.cumsum(many) // MAX_RAY_FACES
    cuts = np.flatnonzero(np.diff(batch)) + 1
    for chunk in np.split(np.arange(len(inner)), cuts):
        count = many[chunk]
        point = np.repeat(inner[chunk], count)
        offset = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
        met = face[np.repeat(start[home[chunk]], count) + offset]
        crossed = _crossing(probe[point], corners[met])
        crossings[inner[chunk]] = np.bincount(
            np.repeat(np.arange(len(chunk)), count), crossed, minlength=len(chunk)
        )
    return crossings


def _crossing(points: Array, triangles: Array) -> IntArray:
    """Crossings (n,) of n rays along +z with n triangles, one each: +1 outwards, -1 inwards, else 0.

    Args:
        points: (n, 3) starts of the rays.
        triangles: (n, 3, 3) corners of the triangles, counter-clockwise from outside.
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, ac, ap = b - a, c - a, points - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    safe = np.where(area == 0, 1.0, area)
    u = (ap[:, 0] * ac[:, 1] - ap[:, 1] * ac[:, 0]) / safe
    v = (ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / safe
    above = u * ab[:, 2] + v * ac[:, 2] > ap[:, 2]
    hit = (area != 0) & (u >= 0) & (v >= 0) & (u + v < 1) & above
    return np.where(hit, np.sign(area), 0.0).astype(np.int64)


def directed_edges(faces: IntArray) -> IntArray:
    """Directed edges (3 f, 2) of `faces` (f, 3): the first of each face, then the second, then the third."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _with_turned(faces: IntArray, turned: BoolArray) -> IntArray:
    """Copy of `faces` (f, 3) with those of the mask `turned` (f,) wound the other way round."""
    return np.where(turned[:, None], faces[:, ::-1], faces)


def _two_colouring(count: int, a: IntArray, b: IntArray, differ: BoolArray) -> BoolArray:
    """Mask (count,) of faces to turn so that neighbours are wound consistently, as few as possible.

    A link connects two neighbouring faces: with `differ` just one of them is to be turned, otherwise both or
    neither. In a graph that has every face twice, once as it is and once turned, each consistent choice is a
    connected component.

    Args:
        count: Number of faces.
        a: (l,) index of the first face of each link.
        b: (l,) index of the second face of each link.
        differ: (l,) True if just one of the two is to be turned.
    """
    shift = np.where(differ, count, 0)
    rows = np.concatenate([a, a + count])
    columns = np.concatenate([b + shift, b + count - shift])
    links = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * count, 2 * count))
    _, label = connected_components(links, directed=False)
    # Components come in mirrored pairs; the one that holds more faces as they are is chosen, so that few are
    # turned.
    plain, mirrored = label[:count], label[count:]
    rank = np.bincount(plain, minlength=2 * count) * (2 * count) + np.arange(2 * count)
    return np.asarray(rank[mirrored] > rank[plain])
