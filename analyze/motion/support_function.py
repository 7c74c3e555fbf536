"""The flank that a tipping body rolls on: its section across the pivot axis as a smooth support function (METHOD section 3).

In the plane across the axis, x the way it tips and z up at rest, the body turned by theta touches the table where its outward normal is
(sin theta, -cos theta). h(theta) is the height of the pivot point p over the table, h'(theta) how far ahead of p the contact lies, and
h + h'' = rho(theta) >= 0 the radius of curvature there. A mesh knows the flank by chords: h' jumps at each facet, and rho is a comb of
spikes. Here each run of short facets becomes a curve through its corners, without kinks, whose radius varies evenly along each facet and
is never negative. A facet at whose ends the outline bends far less than beside it stays flat, a turn of more than 20 deg is a corner.

A scan's facets are as rough as its noise: of 20 um over facets of 0.4 mm the radius would be ten times too large here and nothing there.
Where the bends at neighbouring corners say so, only corners some degrees apart are taken, as few as it needs.
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

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array, IntArray

CORNER = math.radians(20.0)
"""turn between two facets from which on they meet in a corner"""
LEAST_FACETS = 3
"""of a run that is a curve; fewer are a bevel"""
FLAT = 4.0
"""radius of curvature over that beside it, on both sides, from which a facet is a flat face"""
SPACINGS = tuple(math.radians(apart) for apart in (3.5, 7.0, 14.0))
"""of the corners of a rough curve; the first at which it is no longer so"""
ROUGH = 0.2
"""1 sigma of the natural logarithm of the curvature at a corner, from corner to corner"""
_ASIDE = 0.6
"""of a facet L: how far aside it touches, per roughness. Corners off by e make the one e sqrt(2) / turn, the other e sqrt(6) / (L turn)"""
_FACE = 0.04
"""of the perimeter, from which on a facet is kept as it is"""
_MIDDLE = 0.2
"""of the root of the section's area, 1 sigma: where c lies from the middle"""
_SLIVER_M, _SLIVER = 1e-6, 1e-5
"""m, rad"""
_LIFTED = math.radians(0.5)
"""from which on no part of the face that it stood on touches"""
_ROOM = 0.1
"""of a turn between two facets, by which the tangent at their corner differs from either"""
_LOW, _HIGH, _STEP = math.radians(-10.0), math.radians(150.0), math.radians(0.25)


@dataclass(frozen=True)
class SupportFunction:
    """h, h' and rho on an even grid of angles."""

    start: float
    """rad"""
    step: float
    """rad"""
    height: Array
    """(n,) m, of p over the table"""
    ahead: Array
    """(n,) m, of the contact before p: the height's derivative"""
    radius: Array
    """(n,) m, of curvature where it touches"""
    middle: tuple[float, float]
    """m, x and z from p of the section's middle, about where c is expected"""
    middle_sd: float
    """m; infinite where nothing is known of it"""
    sd: float = 0.0
    """m, 1 sigma of the section's place along and off the table, as the facets know it"""
    bent: NDArray[np.bool_] | None = None
    """(n,) bool, where it is a curve of the shape's own, and no corner or rounding; None: nowhere"""
    rough: float = 0.0
    """1 sigma of the radius of such a curve over itself, by how unevenly the shape bends"""

    def at(self, theta: Array) -> tuple[Array, Array, Array]:
        """height, ahead and radius [m] at theta [rad], each of theta's shape; beyond its ends the flank goes on as it ends."""
        place = np.minimum(np.maximum((theta - self.start) / self.step, 0.0), len(self.height) - 1.001)
        index = place.astype(np.intp)
        share = (place - index)[..., None]
        row = self._table[index] * (1.0 - share) + self._table[index + 1] * share
        return row[..., 0], row[..., 1], row[..., 2]

    def centre(self, theta: float) -> tuple[float, float, float]:
        """Where from p the centre of curvature is, in the rest pose, and the radius, where it touches at theta: x, z, radius [m]."""
        height, ahead, radius = (float(each) for each in self.at(np.array(theta)))
        # In W the centre is `ahead` before p and `radius` over the table; turned back by theta.
        along, over = ahead, radius - height
        cos, sin = math.cos(theta), math.sin(theta)
        return along * cos - over * sin, along * sin + over * cos, radius

    def rolled(self, theta: Array) -> tuple[Array, Array]:
        """How far p has gone along and off the table [m] when the flank has rolled without sliding from 0 to theta, each of its shape."""
        # Near rest the face that it stood on may touch; there it starts as it goes on.
        later = np.maximum(theta, _LIFTED)
        height, ahead, _ = self.at(later)
        height0, ahead0, _ = (float(each) for each in self.at(np.array(_LIFTED)))
        angles = self.start + self.step * np.arange(len(self.radius))
        travel = np.concatenate([[0.0], np.cumsum(0.5 * (self.radius[1:] + self.radius[:-1]) * self.step)])
        travelled = np.interp(later, angles, travel) - float(np.interp(_LIFTED, angles, travel))
        begun = np.minimum(theta, _LIFTED)
        return travelled - ahead + ahead0 + height0 * begun, height - height0 + ahead0 * begun

    def of_shape(self, theta: float) -> bool:
        """Whether what touches at theta is a curve of the shape's own: its radius is the shape's, not the rounding that was given."""
        place = round((theta - self.start) / self.step)
        return self.bent is not None and 0 <= place < len(self.bent) and bool(self.bent[place])

    def curved_over(self, low: float, high: float, least: float) -> float:
        """Over how much [rad] of what lies between two angles it touches with a curve of the shape's own, of more than that radius [m]."""
        angles = self.start + self.step * np.arange(len(self.radius))
        inside = (angles >= low) & (angles <= high) & (self.radius > least)
        return 0.0 if self.bent is None else self.step * float(np.count_nonzero(inside & self.bent))

    def range_of_radius(self, low: float, high: float) -> tuple[float, float]:
        """Least and greatest radius of curvature [m] between two angles."""
        _, _, radius = self.at(np.linspace(low, high, 50))
        return float(np.min(radius)), float(np.max(radius))

    def longest_flat(self, low: float, high: float) -> float:
        """Longest flat face [m] that comes to lie on the table between two angles: over it the contact jumps."""
        angles = self.start + self.step * np.arange(len(self.radius))
        inside = (angles >= low) & (angles <= high)
        # A face that is taken for a part of the curve has a huge radius, over a small part of a step.
        radius = np.lib.stride_tricks.sliding_window_view(np.pad(self.radius, 2, mode="edge"), 5).min(axis=1)
        grows = (radius - self.height)[inside]
        jumps = np.diff(self.ahead[inside]) - 0.5 * (grows[1:] + grows[:-1]) * self.step
        return float(np.max(jumps, initial=0.0))

    @cached_property
    def _table(self) -> Array:
        return np.stack([self.height, self.ahead, self.radius], axis=-1)


def circle(radius: float) -> SupportFunction:
    """A rounding about p itself: the motion then says nothing of where c is beyond phi and k.

    Args:
        radius: m, 0 of a sharp edge.
    """
    n = round((_HIGH - _LOW) / _STEP) + 1
    return SupportFunction(
        _LOW, _STEP, np.full(n, radius), np.zeros(n), np.full(n, radius), (0.0, 0.0), math.inf
    )


def from_outline(points: Array, pivot: Array, rounding: float = 0.0) -> SupportFunction:
    """The flank of a body of which `points` of the outline are known.

    Args:
        points: (n, 2) m, x (the way it tips) and z of the hull's corners, in any order; what is inside does no harm.
        pivot: (2,) m, p in the same frame.
        rounding: m, of every corner.

    Raises:
        EstimationError: the points span no area.
    """
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        raise EstimationError("the section across the pivot axis has no area: look at the shape") from None
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
    # Chords lie inside the curve, by up to twice this on the average; what else they differ by is their noise.
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
        _MIDDLE * math.sqrt(area),
        math.hypot(
            math.sqrt(float(np.mean(beyond**2))) if len(beyond) else 0.0,
            _ASIDE * rough * max(lengths, default=0.0),
        ),
        bent,
        rough,
    )


@dataclass(frozen=True)
class _Outline:
    """A convex polygon about the table: facet i runs from corner i to corner i + 1, anticlockwise."""

    corners: Array
    """(n, 2) m from p"""
    length: Array
    """(n,) m"""
    angle: Array
    """(n,) rad, of the facet against the table at rest: the turn at which it lies on it; ascending from -180 deg"""

    def __len__(self) -> int:
        return len(self.length)

    def turn(self, i: int) -> float:
        """rad, from facet i - 1 to facet i."""
        return float((self.angle[i % len(self)] - self.angle[(i - 1) % len(self)]) % (2 * math.pi))

    @cached_property
    def bend(self) -> Array:
        """(n,) 1/m, curvature at corner i; of a circle's chords it is right however long they are."""
        turns = np.remainder(self.angle - np.roll(self.angle, 1), 2 * math.pi)
        return 2.0 * turns / (self.length + np.roll(self.length, 1))


def _outline(corners: Array) -> _Outline:
    """Without corners that are none: facets that turn by next to nothing, or are next to nothing long, are one with their neighbour."""
    while len(corners) > 3:
        sides = np.roll(corners, -1, axis=0) - corners
        lengths = np.hypot(sides[:, 0], sides[:, 1])
        if float(lengths.min()) < _SLIVER_M:
            corners = np.delete(corners, int(np.argmin(lengths)), axis=0)
            continue
        before = np.roll(sides, 1, axis=0)
        turn = (before[:, 0] * sides[:, 1] - before[:, 1] * sides[:, 0]) / (lengths * np.roll(lengths, 1))
        if float(turn.min()) > _SLIVER:
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
    """The outline with as many of its corners as leave its curves smooth, the curves, and how rough they are."""
    outline, curves = whole, _curves(whole)
    rough = _roughness(outline, curves) or 0.0
    for spacing in SPACINGS:
        if rough < ROUGH:
            break
        outline = _thinned(whole, spacing)
        curves = _curves(outline)
        # Of so few corners that they tell nothing it is no less rough.
        rough = _roughness(outline, curves) or rough
    return outline, curves, rough


def _roughness(outline: _Outline, curves: list[_Curve]) -> float | None:
    """How much the curvature scatters from corner to corner of what may touch, beyond what varies evenly: 1 sigma of its logarithm.

    None where there are too few corners to say.
    """
    parts: list[Array] = [np.zeros(0)]
    for curve in curves:
        inner = np.array([i for i in curve.facets[1:] if _LOW < outline.angle[i] < _HIGH], dtype=np.intp)
        parts.append(np.diff(np.log(outline.bend[inner]), 2))
    uneven = np.concatenate(parts)
    return 1.4826 * float(np.median(np.abs(uneven))) / math.sqrt(6.0) if len(uneven) else None


def _thinned(whole: _Outline, spacing: float) -> _Outline:
    """Of the corners those that touch when it is turned by whole multiples of `spacing` [rad], and the ends of faces."""
    turned = np.arange(-math.pi + 0.5 * spacing, math.pi, spacing)
    touches = np.argmin(
        np.outer(np.cos(turned), whole.corners[:, 1]) - np.outer(np.sin(turned), whole.corners[:, 0]), axis=1
    )
    apart = np.abs(np.remainder(whole.angle[:, None] - whole.angle + math.pi, 2 * math.pi) - math.pi)
    around = (apart < spacing) @ whole.length - whole.length
    faces = np.flatnonzero((whole.length > _FACE * float(np.sum(whole.length))) | (whole.length > around))
    kept = np.unique(np.concatenate([touches, faces, (faces + 1) % len(whole)]))
    return _polygon(whole.corners[kept])


@dataclass(frozen=True)
class _Curve:
    """A run of facets that stands for a curve."""

    facets: list[int]

    def over(self, outline: _Outline, theta: Array) -> tuple[IntArray, Array, Array]:
        """Which of theta (n,) are its own, where it touches there (k, 2), and its radius (k,)."""
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
        # Within a facet the radius is mean + slope * at, such that the curve leaves one corner and meets the next with its tangents.
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
        """(facets + 1,) rad, ascending, of the curve at its corners: those of a cubic spline through them, between the facets'."""
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
        room = _ROOM * (after - before)
        # An end is free up to the next face: what touches there is the same corner.
        room[[0, -1]] = 0.0, 0.0
        tangent = np.clip(tangent, before + room, after - room)
        tangent[0] = min(tangent[0], angle[0] - _ROOM * float(tangent[1] - angle[0]))
        tangent[-1] = max(tangent[-1], angle[-1] + _ROOM * float(angle[-1] - tangent[-2]))
        return np.asarray(tangent, dtype=np.float64)


def _curves(outline: _Outline) -> list[_Curve]:
    n = len(outline)
    joined = [outline.turn(i) < CORNER for i in range(n)]
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
    return [_Curve(run) for run in runs if len(run) >= LEAST_FACETS]


def _is_bent(outline: _Outline, joined: list[bool], i: int) -> bool:
    """Whether a facet is part of a curve: on one side at least it bends at its end as it does beyond."""
    n = len(outline)
    ends = ((i, i - 1), ((i + 1) % n, (i + 2) % n))
    return any(
        joined[end] and joined[beyond] and FLAT * outline.bend[end] > outline.bend[beyond]
        for end, beyond in ends
    )


def _at_corners(
    outline: _Outline, curves: list[_Curve], theta: Array, rounding: float
) -> tuple[Array, Array]:
    """As if there were only corners: which of them touches, of a rounded one its centre (n, 2), and the rounding there (n,)."""
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
