"""Radius of the rounding of a point cloud's edges, where two fitted faces meet; lengths in m.

The fitted faces meet in virtual sharp edges. The points between them show how much the true edge is rounded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analyze.geometry.hull_planes import EDGE_COSINE, FittedPlane
from analyze.types import Array

MAX_RADIUS, MAX_RADIUS_FRACTION = 6e-3, 0.08
"""Largest radius that is looked for: the smaller of a length [m] and of a fraction of the extent."""
RADII = 121
"""Number of radii compared, from 0 to the largest."""
MAX_EDGE_POINTS = 1500
"""Largest number of points of one edge that are used."""
MIN_EDGE_POINTS = 12
"""Smallest number of points of one edge between the tangents of a rounding of the largest radius."""
MAX_RESIDUAL_SDS = 3.0
"""Distance of a point from the profile, in sd of the noise, from which on it counts alike."""
RADIUS_ERROR, RADIUS_ERROR_FRACTION = 3e-5, 0.05
"""1 sigma of a radius beyond the noise of the points, as roundings are no perfect arcs: [m], and relative."""
ON_EDGE_FRACTION = 1e-3
"""Distance from an edge, over the cloud's extent, up to which a point of the hull belongs to it."""


@dataclass(frozen=True, eq=False)
class EdgeRounding:
    """Rounding of one edge between two planar faces fitted to a point cloud, in the cloud's frame."""

    start: Array
    """(3,) end of the virtual sharp edge [m]."""
    end: Array
    """(3,) its other end [m]."""
    radius: float
    """Radius [m]."""
    sd: float
    """1 sigma of the radius [m]."""
    reach: float
    """Distance [m] from the sharp edge up to which a point belongs to it."""

    @property
    def direction(self) -> Array:
        """Unit direction (3,), in the cloud's frame, of the edge as if sharp, from start to end."""
        along = self.end - self.start
        return along / float(np.linalg.norm(along))

    def distance(self, point: Array) -> float:
        """Distance [m] of `point` (3,) [m] from the line `start` to `end`, in the cloud's frame."""
        along = self.end - self.start
        share = float(np.clip((point - self.start) @ along / (along @ along), 0.0, 1.0))
        return float(np.linalg.norm(point - self.start - share * along))


def edge_roundings(
    points: Array, planes: tuple[FittedPlane, ...], sd: float, extent: float
) -> tuple[EdgeRounding, ...]:
    """Roundings of the edges between faces fitted to a point cloud; edges with few points are left out.

    The radius is the mean, its sd that of the distribution of the radius given the points, all radii from 0
    to `MAX_RADIUS` being equally likely before. The likelihood counts a point's distance from the profile of
    two faces and an arc that touches both, up to `MAX_RESIDUAL_SDS` (a stray point, or one of a hollow, has
    little effect). Three errors are added: those of the faces' places, `RADIUS_ERROR`, and one as large as
    the noise, which moves points of a curve outwards and so makes a radius not much above it look smaller.

    Args:
        points: (n, 3) points of the cloud [m].
        planes: Planar faces.
        sd: 1 sigma of the noise [m].
        extent: Largest extent of the cloud [m].

    Returns:
        Per edge its two ends (3,) [m], as if sharp, in the cloud's frame, and its radius with sd [m].
    """
    heights = np.column_stack([plane.heights(points) for plane in planes]) if planes else np.zeros((0, 0))
    return tuple(
        found
        for i, j in combinations(range(len(planes)), 2)
        if abs(float(planes[i].normal @ planes[j].normal)) < EDGE_COSINE
        for found in _rounding(points, heights, planes, (i, j), max(sd, 1e-6), extent)
    )


def _rounding(
    points: Array,
    heights: Array,
    planes: tuple[FittedPlane, ...],
    pair: tuple[int, int],
    sd: float,
    extent: float,
) -> Iterator[EdgeRounding]:
    """Yield the rounding of the edge between two faces; nothing if too few points lie beside it.

    Args:
        points: (n, 3) points of the cloud [m].
        heights: (n, planes) their heights over the planes [m], negative inside.
        planes: Planar faces.
        pair: Indices of the two faces.
        sd: 1 sigma of the noise [m].
        extent: Largest extent of the cloud [m].
    """
    first, second = (planes[k] for k in pair)
    cosine = float(first.normal @ second.normal)
    largest = min(MAX_RADIUS, MAX_RADIUS_FRACTION * extent)
    # Depth of the arc's tangent points below the other face.
    room = largest * (1 - cosine) + 4 * sd
    depth = -heights[:, list(pair)]
    others = [k for k in range(len(planes)) if k not in pair]
    beside = (np.abs(depth - room / 2) < room / 2 + 4 * sd).all(axis=1)
    # Near its corners the edge is rounded by a third face too.
    beside &= (heights[:, others] < -room).all(axis=1)
    if int(beside.sum()) < MIN_EDGE_POINTS:
        return
    along = np.cross(first.normal, second.normal)
    along /= np.linalg.norm(along)
    normals = np.stack([first.normal, second.normal, along])
    corner = np.linalg.solve(normals, np.array([first.offset, second.offset, 0.0]))
    place = points[beside] @ along
    # The points used end one room from the corners.
    ends = place.min() - 2 * room, place.max() + 2 * room
    start, end = (corner + along * float(value) for value in ends)
    near = depth[beside][:: max(1, int(beside.sum()) // MAX_EDGE_POINTS)]
    radius, spread = _radius(near, cosine, sd, np.linspace(0.0, largest, RADII))
    middle = ((start + end) / 2)[None]
    placed = float(np.mean([plane.variance(middle)[0] for plane in (first, second)])) / 2
    # A corner farther out looks more rounded: its distance from the arc is the radius times 1/cos - 1.
    lever = 1 / (1 - np.sqrt((1 + cosine) / 2))
    errors = (spread, sd, lever * np.sqrt(placed), RADIUS_ERROR, RADIUS_ERROR_FRACTION * radius)
    yield EdgeRounding(
        start, end, radius, float(np.linalg.norm(errors)), max(ON_EDGE_FRACTION * extent, 2 * sd)
    )


def _radius(depth: Array, cosine: float, sd: float, radii: Array) -> tuple[float, float]:
    """Mean and sd [m] of the radius of a rounding, given points beside the edge.

    Args:
        depth: (n, 2) depths of the points below the two faces [m].
        cosine: Cosine of the angle between the faces' outward normals.
        sd: 1 sigma of the points across the surface [m].
        radii: (r,) radii to compare [m], equally likely before.
    """
    # The arc's centre lies one radius below both faces; `across` are components along their normals.
    across = radii[:, None, None] - depth
    one, other = across[..., 0], across[..., 1]
    sine2 = 1 - cosine**2
    on_arc = (one > cosine * other) & (other > cosine * one)
    squared = (one**2 + other**2 - 2 * cosine * one * other) / sine2
    arc = np.sqrt(np.maximum(squared, 0.0)) - radii[:, None]
    off = np.where(on_arc, arc, -depth.min(axis=1))
    misfit = np.minimum((off / sd) ** 2, MAX_RESIDUAL_SDS**2).sum(axis=1)
    scatter = max(1.0, float(misfit.min()) / len(depth))
    weight = np.exp(-0.5 * (misfit - misfit.min()) / scatter)
    weight /= weight.sum()
    mean = float(weight @ radii)
    step = float(radii[1] - radii[0])
    return mean, float(np.sqrt(weight @ (radii - mean) ** 2 + step**2 / 12))
