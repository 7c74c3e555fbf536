"""Support function of a tipping body's cross-section, for a contact that rolls on a curve (method 3).

In the plane across the axis, x towards where the body tips and z up at rest, the body turned by theta touches
the table where its outward normal is (sin theta, -cos theta). h(theta) is the height of the pivot point p
over the table, h'(theta) the horizontal distance from p to the contact, and h + h'' = rho(theta) >= 0 the
radius of curvature there. A mesh gives the curve by chords only: h' jumps at each facet, and rho is a comb of
spikes. Here each run of short facets becomes a smooth curve through its corners, whose radius varies linearly
along each facet and is never negative. A facet at whose ends the outline bends far less than beside it stays
flat, a turn of more than 20 deg is a corner.

The facets of a scan are as rough as its noise: noise of 20 um over facets of 0.4 mm makes the radius ten
times too large at some corners and zero at others. If the bends at neighbouring corners scatter that much,
only corners some degrees apart are used, as few as needed.
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import ConvexHull, QhullError

from analyze.errors import EstimationError
from analyze.least_squares.robust import median_scale

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array, IntArray

CORNER_TURN = math.radians(20.0)
"""turn [rad] between two facets from which they meet in a corner"""
MIN_CURVE_FACETS = 3
"""least number of facets of a curve; fewer are a bevel"""
FLAT_RADIUS_RATIO = 4.0
"""ratio of the radius of curvature to that beside it, on both sides, from which a facet is a flat face"""
CORNER_SPACINGS = tuple(math.radians(apart) for apart in (3.5, 7.0, 14.0))
"""spacings [rad] of the corners of a rough curve; the first that makes it smooth is used"""
MAX_ROUGHNESS = 0.2
"""largest standard deviation of the log curvature from corner to corner of a smooth curve"""
_OFFSET_PER_ROUGHNESS = 0.6
"""error of the contact along a facet, over its length L, per roughness

Corner errors e give a roughness of e sqrt(6) / (L turn) and shift the contact by e sqrt(2) / turn.
"""
_FACE_SHARE = 0.04
"""share of the perimeter from which a facet is kept as it is"""
_MIDDLE_SD_SHARE = 0.2
"""standard deviation of c from the section's middle, over the root of the section's area"""
_SLIVER_M, _SLIVER_RAD = 1e-6, 1e-5
"""facet length [m] and turn [rad] below which facets are merged"""
_LIFTED_RAD = math.radians(0.5)
"""theta [rad] from which no part of the resting face touches"""
_TANGENT_ROOM = 0.1
"""least difference of the tangent at a corner from either facet, over the turn there"""
_LOW, _HIGH, _STEP = math.radians(-10.0), math.radians(150.0), math.radians(0.25)
"""range and step of the grid of angles [rad]"""


@dataclass(frozen=True)
class SupportFunction:
    """h, h' and rho of a cross-section on an even grid of angles theta."""

    start: float
    """first angle [rad]"""
    step: float
    """step of the grid [rad]"""
    height: Array
    """(n,) h: height of p over the table [m]"""
    ahead: Array
    """(n,) h': distance from p to the contact, towards where the body tips [m]"""
    radius: Array
    """(n,) rho: radius of curvature at the contact [m]"""
    middle: tuple[float, float]
    """x and z [m] from p to the section's middle, near which c is expected"""
    middle_sd: float
    """standard deviation of c about it [m]; infinite if unknown"""
    sd: float = 0.0
    """standard deviation [m] of the section's position along and off the table, by its facets"""
    curved: NDArray[np.bool_] | None = None
    """(n,) True where a curve of the shape itself touches, not a corner or a rounding; None if nowhere"""
    roughness: float = 0.0
    """relative standard deviation of the radius of such a curve, by the uneven bends of the shape"""

    def evaluate(self, theta: Array) -> tuple[Array, Array, Array]:
        """h, h' and rho [m] at theta [rad], each of theta's shape; the end values hold beyond the grid."""
        place = np.minimum(np.maximum((theta - self.start) / self.step, 0.0), len(self.height) - 1.001)
        index = place.astype(np.intp)
        share = (place - index)[..., None]
        row = self._table[index] * (1.0 - share) + self._table[index + 1] * share
        return row[..., 0], row[..., 1], row[..., 2]

    def centre(self, theta: float) -> tuple[float, float, float]:
        """Centre of curvature (x, z) from p at rest, and the radius, at the contact at theta [m]."""
        height, ahead, radius = (float(each) for each in self.evaluate(np.array(theta)))
        # In W the centre is `ahead` in front of p and `radius` above the table; rotate back by theta.
        along, over = ahead, radius - height
        cos, sin = math.cos(theta), math.sin(theta)
        return along * cos - over * sin, along * sin + over * cos, radius

    def rolled(self, theta: Array) -> tuple[Array, Array]:
        """Displacement of p along and off the table [m] by rolling without sliding from 0 to theta [rad]."""
        # Near rest the resting face may touch; there the motion is extrapolated from `_LIFTED_RAD`.
        later = np.maximum(theta, _LIFTED_RAD)
        height, ahead, _ = self.evaluate(later)
        height0, ahead0, _ = (float(each) for each in self.evaluate(np.array(_LIFTED_RAD)))
        angles = self.start + self.step * np.arange(len(self.radius))
        travel = np.concatenate([[0.0], np.cumsum(0.5 * (self.radius[1:] + self.radius[:-1]) * self.step)])
        travelled = np.interp(later, angles, travel) - float(np.interp(_LIFTED_RAD, angles, travel))
        begun = np.minimum(theta, _LIFTED_RAD)
        return travelled - ahead + ahead0 + height0 * begun, height - height0 + ahead0 * begun

    def of_shape(self, theta: float) -> bool:
        """True if a curve of the shape touches at theta [rad], not a corner with a stated rounding."""
        place = round((theta - self.start) / self.step)
        return self.curved is not None and 0 <= place < len(self.curved) and bool(self.curved[place])

    def curved_over(self, low: float, high: float, least: float) -> float:
        """Range [rad] between two angles in which a curve of radius above `least` [m] touches."""
        angles = self.start + self.step * np.arange(len(self.radius))
        inside = (angles >= low) & (angles <= high) & (self.radius > least)
        return 0.0 if self.curved is None else self.step * float(np.count_nonzero(inside & self.curved))

    def range_of_radius(self, low: float, high: float) -> tuple[float, float]:
        """Least and greatest radius of curvature [m] between two angles [rad]."""
        _, _, radius = self.evaluate(np.linspace(low, high, 50))
        return float(np.min(radius)), float(np.max(radius))

    def longest_flat(self, low: float, high: float) -> float:
        """Length [m] of the longest flat face that comes to lie on the table between two angles.

        The contact jumps over it.
        """
        angles = self.start + self.step * np.arange(len(self.radius))
        inside = (angles >= low) & (angles <= high)
        # A face within a curve has a huge radius over a small part of a step.
        radius = np.lib.stride_tricks.sliding_window_view(np.pad(self.radius, 2, mode="edge"), 5).min(axis=1)
        grows = (radius - self.height)[inside]
        jumps = np.diff(self.ahead[inside]) - 0.5 * (grows[1:] + grows[:-1]) * self.step
        return float(np.max(jumps, initial=0.0))

    @cached_property
    def _table(self) -> Array:
        return np.stack([self.height, self.ahead, self.radius], axis=-1)


def circle(radius: float) -> SupportFunction:
    """Support function of a rounding about p itself, which determines phi and k only, not the position of c.

    Args:
        radius: radius [m], 0 for a sharp edge.

    Args:
        radius: m, 0 of a sharp edge.
    """
    n = round((_HIGH - _LOW) / _STEP) + 1
    return SupportFunction(
        _LOW, _STEP, np.full(n, radius), np.zeros(n), np.full(n, radius), (0.0, 0.0), math.inf
    )


def support_of_outline(points: Array, pivot: Array, rounding: float = 0.0) -> SupportFunction:
    """Support function of a body with known points of its outline.

    Args:
        points: (n, 2) x (towards where it tips) and z of the hull's corners [m], in any order; inner points
            do no harm.
        pivot: (2,) p in the same frame [m].
        rounding: radius of the rounding of every corner [m].

    Raises:
        EstimationError: the points span no area.
    """
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        raise EstimationError("the section across the pivot axis has no area: check the shape") from None
    whole = _outline(np.asarray(points[hull.vertices] - pivot, dtype=np.float64))
    outline, curves, rough = _smooth(whole)
    theta = np.asarray(_LOW + _STEP * np.arange(round((_HIGH - _LOW) / _STEP) + 1), dtype=np.float64)
    touching, offset = _at_corners(outline, curves, theta, rounding)
    radius, bent = offset.copy(), np.zeros(len(theta), dtype=bool)
    for curve in curves:
        inside, points, radii = curve.over(outline, theta)
        touching[inside], offset[inside], radius[inside], bent[inside] = points, 0.0, radii, True
    cos, sin = np.cos(theta), np.sin(theta)
    height = touching[:, 0] * sin - touching[:, 1] * cos + offset
    # Chords lie inside the curve, by up to twice this on average; the rest of the difference is their noise.
    chords = np.max(np.outer(sin, whole.corners[:, 0]) - np.outer(cos, whole.corners[:, 1]), axis=1)
    beyond = np.asarray((height - chords)[bent & (theta > 0.0)], dtype=np.float64)
    lengths = [float(np.mean(outline.length[curve.facets])) for curve in curves]
    middle, area = _middle(whole.corners)
    return SupportFunction(
        _LOW,
        _STEP,
        height,
        touching[:, 0] * cos + touching[:, 1] * sin,
        radius,
        (float(middle[0]), float(middle[1])),
        _MIDDLE_SD_SHARE * math.sqrt(area),
        math.hypot(
            math.sqrt(float(np.mean(beyond**2))) if len(beyond) else 0.0,
            _OFFSET_PER_ROUGHNESS * rough * max(lengths, default=0.0),
        ),
        bent,
        rough,
    )


@dataclass(frozen=True)
class _Outline:
    """Convex polygon in the plane of the section.

    Facet i runs anticlockwise from corner i to corner i + 1.
    """

    corners: Array
    """(n, 2) corners from p [m]"""
    length: Array
    """(n,) facet lengths [m]"""
    angle: Array
    """(n,) angle of the facet against the table at rest [rad], the turn at which it lies on it; ascending
    from -180 deg"""

    def __len__(self) -> int:
        return len(self.length)

    def turn(self, i: int) -> float:
        """Turn from facet i - 1 to facet i [rad]."""
        return float((self.angle[i % len(self)] - self.angle[(i - 1) % len(self)]) % (2 * math.pi))

    @cached_property
    def bend(self) -> Array:
        """Curvature (n,) at the corners [1/m]; exact for chords of a circle of any length."""
        turns = np.remainder(self.angle - np.roll(self.angle, 1), 2 * math.pi)
        return 2.0 * turns / (self.length + np.roll(self.length, 1))


def _outline(corners: Array) -> _Outline:
    """Polygon of `corners` (n, 2) [m], facets of negligible length or turn merged."""
    while len(corners) > 3:
        sides = np.roll(corners, -1, axis=0) - corners
        lengths = np.hypot(sides[:, 0], sides[:, 1])
        if float(lengths.min()) < _SLIVER_M:
            corners = np.delete(corners, int(np.argmin(lengths)), axis=0)
            continue
        before = np.roll(sides, 1, axis=0)
        turn = (before[:, 0] * sides[:, 1] - before[:, 1] * sides[:, 0]) / (lengths * np.roll(lengths, 1))
        if float(turn.min()) > _SLIVER_RAD:
            break
        corners = np.delete(corners, int(np.argmin(turn)), axis=0)
    return _polygon(corners)


def _polygon(corners: Array) -> _Outline:
    sides = np.roll(corners, -1, axis=0) - corners
    angle = np.arctan2(sides[:, 1], sides[:, 0])
    first = int(np.argmin(angle))
    return _Outline(
        *(np.roll(values, -first, axis=0) for values in (corners, np.hypot(sides[:, 0], sides[:, 1]), angle))
    )


def _smooth(whole: _Outline) -> tuple[_Outline, list[_Curve], float]:
    """Outline with as many corners as keep its curves smooth, the curves, and their roughness."""
    outline, curves = whole, _curves(whole)
    rough = _roughness(outline, curves) or 0.0
    for spacing in CORNER_SPACINGS:
        if rough < MAX_ROUGHNESS:
            break
        outline = _thinned(whole, spacing)
        curves = _curves(outline)
        # With too few corners for an estimate the roughness stays what it was.
        rough = _roughness(outline, curves) or rough
    return outline, curves, rough


def _roughness(outline: _Outline, curves: list[_Curve]) -> float | None:
    """Standard deviation of the log curvature from corner to corner, beyond a linear trend.

    Over the corners that may touch; None if there are too few.

    None where there are too few corners to say.
    """
    parts: list[Array] = [np.zeros(0)]
    for curve in curves:
        inner = np.array([i for i in curve.facets[1:] if _LOW < outline.angle[i] < _HIGH], dtype=np.intp)
        parts.append(np.diff(np.log(outline.bend[inner]), 2))
    uneven = np.concatenate(parts)
    return median_scale(uneven) / math.sqrt(6.0) if len(uneven) else None


def _thinned(whole: _Outline, spacing: float) -> _Outline:
    """Outline of the corners that touch at whole multiples of `spacing` [rad], and of the ends of faces."""
    turned = np.arange(-math.pi + 0.5 * spacing, math.pi, spacing)
    touches = np.argmin(
        np.outer(np.cos(turned), whole.corners[:, 1]) - np.outer(np.sin(turned), whole.corners[:, 0]), axis=1
    )
    apart = np.abs(np.remainder(whole.angle[:, None] - whole.angle + math.pi, 2 * math.pi) - math.pi)
    around = (apart < spacing) @ whole.length - whole.length
    faces = np.flatnonzero(
        (whole.length > _FACE_SHARE * float(np.sum(whole.length))) | (whole.length > around)
    )
    kept = np.unique(np.concatenate([touches, faces, (faces + 1) % len(whole)]))
    return _polygon(whole.corners[kept])


@dataclass(frozen=True)
class _Curve:
    """Run of facets that approximate a curve."""

    facets: list[int]

    def over(self, outline: _Outline, theta: Array) -> tuple[IntArray, Array, Array]:
        """Indices of theta (n,) on this curve, its contacts there (k, 2) [m] and radii (k,) [m]."""
        length, nodes = outline.length[self.facets], self._tangents(outline)
        whole = nodes[0] + np.remainder(theta - nodes[0], 2 * math.pi)
        inside = np.flatnonzero(whole <= nodes[-1])
        cell = (
            np.minimum(
                np.asarray(np.searchsorted(nodes, whole[inside], side="right"), dtype=np.intp), len(length)
            )
            - 1
        )
        facet = np.array(self.facets)[cell]
        middle, half = 0.5 * (nodes[1:] + nodes[:-1])[cell], 0.5 * np.diff(nodes)[cell]
        at = whole[inside] - middle
        # Within a facet the radius is mean + slope * at, so that the curve meets both corners with its
        # tangents.
        lean = np.remainder(outline.angle[facet] - middle + math.pi, 2 * math.pi) - math.pi
        sin, cos = np.sin(half), np.cos(half)
        mean = length[cell] * np.cos(lean) / (2.0 * sin)
        slope = length[cell] * np.sin(lean) / (2.0 * (sin - half * cos))
        along = mean * (np.sin(at) + sin) + slope * (np.cos(at) + at * np.sin(at) - cos - half * sin)
        across = mean * (cos - np.cos(at)) + slope * (np.sin(at) - at * np.cos(at) + sin - half * cos)
        turned = np.stack(
            [
                along * np.cos(middle) - across * np.sin(middle),
                along * np.sin(middle) + across * np.cos(middle),
            ],
            axis=-1,
        )
        return inside, outline.corners[facet] + turned, np.maximum(mean + slope * at, 0.0)

    def _tangents(self, outline: _Outline) -> Array:
        """Tangent angles (facets + 1,) of the curve at its corners [rad], ascending.

        Those of a cubic spline, kept between the facets'.
        """
        turns = np.array([outline.turn(i) for i in self.facets])
        angle = outline.angle[self.facets[0]] + np.concatenate([[0.0], np.cumsum(turns[1:])])
        corners = outline.corners[[*self.facets, (self.facets[-1] + 1) % len(outline)]]
        spline = CubicSpline(np.concatenate([[0.0], np.cumsum(outline.length[self.facets])]), corners)
        slope = spline(spline.x, 1)
        tangent = np.arctan2(slope[:, 1], slope[:, 0])
        tangent = angle[0] + np.remainder(tangent - angle[0] + math.pi, 2 * math.pi) - math.pi
        tangent = tangent + 2 * math.pi * np.rint((np.append(angle, angle[-1]) - tangent) / (2 * math.pi))
        before = np.concatenate([[angle[0] - turns[0]], angle])
        after = np.append(angle, angle[-1] + outline.turn(self.facets[-1] + 1))
        room = _TANGENT_ROOM * (after - before)
        # An end is free up to the next face: the same corner touches there.
        room[[0, -1]] = 0.0, 0.0
        tangent = np.clip(tangent, before + room, after - room)
        tangent[0] = min(tangent[0], angle[0] - _TANGENT_ROOM * float(tangent[1] - angle[0]))
        tangent[-1] = max(tangent[-1], angle[-1] + _TANGENT_ROOM * float(angle[-1] - tangent[-2]))
        return np.asarray(tangent, dtype=np.float64)


def _curves(outline: _Outline) -> list[_Curve]:
    n = len(outline)
    joined = [outline.turn(i) < CORNER_TURN for i in range(n)]
    bent = [_is_bent(outline, joined, i) for i in range(n)]
    breaks = [i for i in range(n) if not (bent[i] and bent[i - 1] and joined[i])]
    start = breaks[0] if breaks else 0
    runs: list[list[int]] = []
    for i in (j % n for j in range(start, start + n)):
        if not bent[i]:
            continue
        if runs and runs[-1] and (i - 1) % n == runs[-1][-1] and joined[i]:
            runs[-1].append(i)
        else:
            runs.append([i])
    return [_Curve(run) for run in runs if len(run) >= MIN_CURVE_FACETS]


def _is_bent(outline: _Outline, joined: list[bool], i: int) -> bool:
    """True if a facet is part of a curve: at one end at least it bends as it does beyond."""
    n = len(outline)
    ends = ((i, i - 1), ((i + 1) % n, (i + 2) % n))
    return any(
        joined[end] and joined[beyond] and FLAT_RADIUS_RATIO * outline.bend[end] > outline.bend[beyond]
        for end, beyond in ends
    )


def _at_corners(
    outline: _Outline, curves: list[_Curve], theta: Array, rounding: float
) -> tuple[Array, Array]:
    """Contact (n, 2) at corners or centres of rounded ones [m], and the rounding's radius (n,) [m]."""
    n = len(outline)
    curved = {i for curve in curves for i in curve.facets}
    centres, radii = outline.corners.copy(), np.zeros(n)
    for i in range(n):
        if i in curved or (i - 1) % n in curved:
            continue
        before, after = (
            np.array([math.cos(a), math.sin(a)]) for a in (outline.angle[i - 1], outline.angle[i])
        )
        inwards = (after - before) / float(np.hypot(*(after - before)))
        centres[i] = outline.corners[i] + inwards * rounding / math.cos(0.5 * outline.turn(i))
        radii[i] = rounding
    low = np.cos(theta)[:, None] * centres[:, 1] - np.sin(theta)[:, None] * centres[:, 0] - radii
    lowest = np.argmin(low, axis=1)
    return centres[lowest], radii[lowest]


def _middle(corners: Array) -> tuple[Array, float]:
    """Centre (2,) [m] and area [m^2] of a polygon."""
    following = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    area = 0.5 * float(cross.sum())
    return np.asarray(
        ((corners + following) * cross[:, None]).sum(axis=0) / (6.0 * area), dtype=np.float64
    ), area
