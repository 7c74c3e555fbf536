"""Roundings and bevels of a point cloud's edges, where two fitted faces meet; lengths in m.

The fitted faces meet in virtual sharp edges. The points between them show how much the true edge is rounded,
or that a narrow flat face cuts it off: a bevel.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from analyze.geometry.hull_planes import EDGE_COSINE, FittedPlane, weighted_fit
from analyze.geometry.polyhedron import BoolArray
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
BEVEL_LEGS = 16
"""Number of widths of a bevel compared along each face, from 1/16 of the largest radius to it."""
BEVEL_GAIN = 20.0
"""Excess of the misfit of the best rounding over that of the best bevel above which the edge is bevelled."""
MIN_BEVEL_SDS = 4.0
"""Smallest height of the sharp edge over a bevel, in sd of the noise: noise that points outwards leaves sharp
edges empty, which looks like a small bevel."""
BEVEL_RADIUS_ERROR = 0.7
"""Error of a radius where the edge is a bevel, over the radius: a bevel of leg p tips about its inner end, p
from the sharp edge; the arc that fits its points best has a radius of 1.4 p, and acts at 30 degrees as if at
0.6 p from it."""
BEVEL_END = 0.15
"""Fraction of a bevel's width at each end whose points are not used for its plane: noise mixes the faces."""
BEVEL_SD_FACTOR = 2.0
"""Factor on the sd of a bevel's plane: its points are chosen by the bevel that they show, and an end of it is
blurred by the noise."""
MIN_BEVEL_POINTS = 12
"""Smallest number of points of a bevel's plane."""
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
        """Distance [m] of `point` (3,) [m] from the edge: the segment from `start` to `end`.

        The point is given in the cloud's frame.
        """
        along = self.end - self.start
        share = float(np.clip((point - self.start) @ along / (along @ along), 0.0, 1.0))
        return float(np.linalg.norm(point - self.start - share * along))


@dataclass(frozen=True, eq=False)
class _Beside:
    """Points of a cloud beside the virtual sharp edge of two of its faces."""

    pair: tuple[FittedPlane, FittedPlane]
    """The two faces."""
    chosen: BoolArray
    """Mask of the points (n,) of the cloud."""
    depth: Array
    """(k, 2) their depths below the two faces [m]; at most about `MAX_EDGE_POINTS`."""
    room: float
    """Depth [m] below the one face at which the largest rounding touches the other."""
    largest: float
    """Largest radius looked for [m]."""

    @property
    def cosine(self) -> float:
        """Cosine of the angle between the faces' outward normals."""
        return float(self.pair[0].normal @ self.pair[1].normal)


def edge_roundings(
    points: Array, planes: tuple[FittedPlane, ...], sd: float, extent: float
) -> tuple[EdgeRounding, ...]:
    """Roundings of the edges between faces fitted to a point cloud; edges with few points are left out.

    The radius is the mean, its sd that of the distribution of the radius given the points, all radii from 0
    to the largest (`MAX_RADIUS`, or `MAX_RADIUS_FRACTION` of the extent if less) being equally likely before.
    The likelihood counts a point's distance from the profile of two faces and an arc that touches both, up to
    `MAX_RESIDUAL_SDS` (a stray point, or one of a hollow, has little effect). Added in square are the errors
    of the faces' places, `RADIUS_ERROR`, `RADIUS_ERROR_FRACTION` of the radius, the noise (it moves points of
    a curve outwards, so that small radii look smaller), and `BEVEL_RADIUS_ERROR` of the radius times the root
    of the chance that the edge is a bevel.

    Args:
        points: (n, 3) points of the cloud [m].
        planes: Planar faces.
        sd: 1 sigma of the noise [m].
        extent: Largest extent of the cloud [m].

    Returns:
        Per edge its two ends (3,) [m], as if sharp, in the cloud's frame, and its radius with sd [m].
    """
    sd = max(sd, 1e-6)
    return tuple(_rounding(points, each, sd, extent) for each in _edges(points, planes, sd, extent))


def bevels(
    points: Array, planes: tuple[FittedPlane, ...], sd: float, extent: float
) -> tuple[FittedPlane, ...]:
    """Planes of narrow flat faces that cut off the edges between the faces fitted to a point cloud.

    An edge is bevelled if a flat face of some widths along the two faces explains the points beside it better
    than any rounding, by `BEVEL_GAIN` in the sum of squared distances over the noise's variance, and lies at
    least `MIN_BEVEL_SDS` sd of the noise below the sharp edge.

    Args:
        points: (n, 3) points of the cloud [m].
        planes: Planar faces.
        sd: 1 sigma of the noise [m].
        extent: Largest extent of the cloud [m].
    """
    sd = max(sd, 1e-6)
    found: list[FittedPlane] = []
    inside = points.mean(axis=0)
    for edge in _edges(points, planes, sd, extent):
        arc = float(_arc_misfits(edge.depth, edge.cosine, sd, _radii(edge)).min())
        misfit, legs = _best_bevel(edge, sd)
        height = -float(_bevel_depth(np.zeros((1, 2)), edge.cosine, legs)[0])
        if arc - misfit < BEVEL_GAIN or height < MIN_BEVEL_SDS * sd:
            continue
        plane = _bevel_plane(points[edge.chosen], edge, legs, sd, inside)
        if plane is not None:
            found.append(plane)
    return tuple(found)


def _bevel_plane(points: Array, edge: _Beside, legs: Array, sd: float, inside: Array) -> FittedPlane | None:
    """Plane fitted to the points of a bevel, with `BEVEL_SD_FACTOR` on its sd; None if they are too few.

    Too few are points whose weights add up to less than `MIN_BEVEL_POINTS`.

    Args:
        points: (k, 3) points beside the edge [m].
        edge: The edge, with its two faces 0 and 1.
        legs: (2,) size of the bevel [m]. The bevel ends on each face along a line: the first number is the
            depth below face 0 of the line on face 1, the second the depth below face 1 of that on face 0.
        sd: 1 sigma of the noise [m].
        inside: (3,) point within the body [m].
    """
    depth = -np.column_stack([plane.heights(points) for plane in edge.pair])
    share = depth / legs
    along = share[:, 0] / np.maximum(share.sum(axis=1), 1e-12)
    on = (np.abs(along - 0.5) < 0.5 - BEVEL_END) & (
        np.abs(_bevel_depth(depth, edge.cosine, legs)) < MAX_RESIDUAL_SDS * sd
    )
    plane = weighted_fit(points, on.astype(float), inside, MIN_BEVEL_POINTS)
    return None if plane is None else replace(plane, covariance=BEVEL_SD_FACTOR**2 * plane.covariance)


def _edges(points: Array, planes: tuple[FittedPlane, ...], sd: float, extent: float) -> Iterator[_Beside]:
    """Yield the points beside each edge between two faces; edges with too few are left out.

    Args:
        points: (n, 3) points of the cloud [m].
        planes: Planar faces.
        sd: 1 sigma of the noise [m].
        extent: Largest extent of the cloud [m].
    """
    heights = np.column_stack([plane.heights(points) for plane in planes]) if planes else np.zeros((0, 0))
    largest = min(MAX_RADIUS, MAX_RADIUS_FRACTION * extent)
    for i, j in combinations(range(len(planes)), 2):
        cosine = float(planes[i].normal @ planes[j].normal)
        if abs(cosine) >= EDGE_COSINE:
            continue
        # Depth of the arc's tangent points below the other face.
        room = largest * (1 - cosine) + 4 * sd
        depth = -heights[:, [i, j]]
        others = [k for k in range(len(planes)) if k not in (i, j)]
        chosen = np.asarray((np.abs(depth - room / 2) < room / 2 + 4 * sd).all(axis=1), dtype=np.bool_)
        # Near its corners the edge is rounded by a third face too.
        chosen &= (heights[:, others] < -room).all(axis=1)
        count = int(chosen.sum())
        if count >= MIN_EDGE_POINTS:
            some = depth[chosen][:: max(1, count // MAX_EDGE_POINTS)]
            yield _Beside((planes[i], planes[j]), chosen, some, room, largest)


def _rounding(points: Array, edge: _Beside, sd: float, extent: float) -> EdgeRounding:
    """Rounding of the edge between two faces: its ends, radius and the radius's sd [m].

    The ends are in the cloud's frame.

    Args:
        points: (n, 3) points of the cloud [m].
        edge: Points beside the edge.
        sd: 1 sigma of the noise [m].
        extent: Largest extent of the cloud [m].
    """
    first, second = edge.pair
    along = np.cross(first.normal, second.normal)
    along /= np.linalg.norm(along)
    normals = np.stack([first.normal, second.normal, along])
    corner = np.linalg.solve(normals, np.array([first.offset, second.offset, 0.0]))
    place = points[edge.chosen] @ along
    # The points used end one room from the corners.
    ends = place.min() - 2 * edge.room, place.max() + 2 * edge.room
    start, end = (corner + along * float(value) for value in ends)
    radii = _radii(edge)
    misfit = _arc_misfits(edge.depth, edge.cosine, sd, radii)
    radius, spread = _radius(misfit, len(edge.depth), radii)
    middle = ((start + end) / 2)[None]
    placed = float(np.mean([plane.variance(middle)[0] for plane in edge.pair])) / 2
    # A corner farther out looks more rounded: its distance from the arc is the radius times 1/cos - 1.
    lever = 1 / (1 - np.sqrt((1 + edge.cosine) / 2))
    errors = (
        spread,
        sd,
        lever * np.sqrt(placed),
        RADIUS_ERROR,
        RADIUS_ERROR_FRACTION * radius,
        BEVEL_RADIUS_ERROR * radius * np.sqrt(_chance_of_bevel(edge, sd, float(misfit.min()))),
    )
    return EdgeRounding(
        start, end, radius, float(np.linalg.norm(errors)), max(ON_EDGE_FRACTION * extent, 2 * sd)
    )


def _radii(edge: _Beside) -> Array:
    """Radii (`RADII`,) [m] that are compared, in equal steps from 0 to the largest."""
    return np.linspace(0.0, edge.largest, RADII)


def _chance_of_bevel(edge: _Beside, sd: float, arc: float) -> float:
    """Probability that an edge is bevelled, not rounded, by Schwarz's criterion.

    Args:
        edge: Points beside the edge.
        sd: 1 sigma of the noise [m].
        arc: Misfit of the best rounding: sum of squared distances of the points from its profile, over the
            noise's variance.
    """
    # A bevel has two widths, a rounding one radius.
    gain = arc - _best_bevel(edge, sd)[0] - np.log(len(edge.depth))
    return float(1 / (1 + np.exp(-0.5 * np.clip(gain, -100.0, 100.0))))


def _best_bevel(edge: _Beside, sd: float) -> tuple[float, Array]:
    """Misfit of the best bevel of an edge, and its two legs (2,) [m].

    The bevel ends on each of the faces 0 and 1 along a line: the first leg is the depth below face 0 of the
    line on face 1, the second the depth below face 1 of that on face 0. The misfit is the sum of the squared
    distances of the points from the profile, over the noise's variance, each up to `MAX_RESIDUAL_SDS` sd.

    Args:
        edge: Points beside the edge.
        sd: 1 sigma of the noise [m].
    """
    step = edge.largest / BEVEL_LEGS
    coarse = [(one, other) for one in range(1, BEVEL_LEGS + 1) for other in range(1, BEVEL_LEGS + 1)]
    least, best = _least_bevel(edge, sd, step * np.array(coarse))
    for _ in range(2):
        step /= 3
        around = best + step * np.array([(one, other) for one in range(-2, 3) for other in range(-2, 3)])
        least, best = _least_bevel(edge, sd, around[(around > 0).all(axis=1)])
    return least, best


def _least_bevel(edge: _Beside, sd: float, legs: Array) -> tuple[float, Array]:
    """Misfit and legs (2,) [m] of the bevel that fits the points of an edge best, of m bevels.

    The misfit is the sum of the squared distances of the points from the profile, over the noise's variance,
    each up to `MAX_RESIDUAL_SDS` sd.

    Args:
        edge: Points beside the edge.
        sd: 1 sigma of the noise [m].
        legs: (m, 2) for each bevel, depth [m] below face 0 of its end on face 1, and below face 1 of that on
            face 0.
    """
    shallow = edge.depth.min(axis=1)
    off = [np.minimum(shallow, _bevel_depth(edge.depth, edge.cosine, pair)) for pair in legs]
    misfits = np.minimum((np.array(off) / sd) ** 2, MAX_RESIDUAL_SDS**2).sum(axis=1)
    best = int(np.argmin(misfits))
    return float(misfits[best]), legs[best]


def _bevel_depth(depth: Array, cosine: float, legs: Array) -> Array:
    """Depth (n,) [m] of points below a bevel's plane.

    Args:
        depth: (n, 2) depths of the points below the two faces, 0 and 1 [m].
        cosine: Cosine of the angle between the faces' outward normals.
        legs: (2,) size of the bevel [m]. The bevel ends on each face along a line: the first number is the
            depth below face 0 of the line on face 1, the second the depth below face 1 of that on face 0.
    """
    steepness = np.sqrt(legs[0] ** -2 + legs[1] ** -2 + 2 * cosine / (legs[0] * legs[1]))
    return ((depth / legs).sum(axis=1) - 1) / steepness


def _arc_misfits(depth: Array, cosine: float, sd: float, radii: Array) -> Array:
    """Misfit (r,) of roundings: sum of squared distances from the profile over the noise's variance.

    The profile is that of two faces and an arc that touches both. A distance counts up to `MAX_RESIDUAL_SDS`
    sd.

    Args:
        depth: (n, 2) depths of the points below the two faces [m].
        cosine: Cosine of the angle between the faces' outward normals.
        sd: 1 sigma of the points across the surface [m].
        radii: (r,) radii to compare [m].
    """
    # The arc's centre lies one radius below both faces; `across` are components along their normals.
    across = radii[:, None, None] - depth
    one, other = across[..., 0], across[..., 1]
    sine2 = 1 - cosine**2
    on_arc = (one > cosine * other) & (other > cosine * one)
    squared = (one**2 + other**2 - 2 * cosine * one * other) / sine2
    arc = np.sqrt(np.maximum(squared, 0.0)) - radii[:, None]
    off = np.where(on_arc, arc, -depth.min(axis=1))
    return np.minimum((off / sd) ** 2, MAX_RESIDUAL_SDS**2).sum(axis=1)


def _radius(misfit: Array, count: int, radii: Array) -> tuple[float, float]:
    """Mean and sd [m] of the radius of a rounding, given points beside the edge.

    Args:
        misfit: (r,) for each radius, sum of squared distances of the points from faces and arc, over the
            noise's variance.
        count: Number of points.
        radii: (r,) radii to compare [m], equally likely before.
    """
    scatter = max(1.0, float(misfit.min()) / count)
    weight = np.exp(-0.5 * (misfit - misfit.min()) / scatter)
    weight /= weight.sum()
    mean = float(weight @ radii)
    step = float(radii[1] - radii[0])
    return mean, float(np.sqrt(weight @ (radii - mean) ** 2 + step**2 / 12))
