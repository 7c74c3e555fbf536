"""Outline of a convex cross-section: polygon, runs of facets that approximate curves, and roughness.

Facet i runs from corner i to corner i + 1, anticlockwise. A run of short facets becomes a smooth curve
through its corners; a facet at whose ends the outline bends far less than beside it stays flat, and a large
turn is a corner.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from analyze.least_squares.robust import median_scale

if TYPE_CHECKING:
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
_FACE_SHARE = 0.04
"""share of the perimeter from which a facet is kept as it is"""
_SLIVER_M, _SLIVER_RAD = 1e-6, 1e-5
"""facet length [m] and turn [rad] below which facets are merged"""
_TANGENT_ROOM = 0.1
"""least difference of the tangent at a corner from either facet, over the turn there"""
LOW, HIGH = math.radians(-10.0), math.radians(150.0)
"""range of the angles [rad] at which the body may touch the table"""


@dataclass(frozen=True)
class Outline:
    """Convex polygon in the plane of the cross-section, with lengths and angles of its facets.

    Lengths are in m, angles in rad against the table, with the object at rest. Facet i runs anticlockwise
    from corner i to corner i + 1.
    """

    corners: Array
    """(n, 2) corners relative to the pivot point p [m]: x in the direction of tipping, z up"""
    length: Array
    """(n,) facet lengths [m]"""
    angle: Array
    """(n,) angle of each facet against the table at rest [rad], ascending from -180 deg; at this tipping
    angle the facet lies on the table"""

    def __len__(self) -> int:
        return len(self.length)

    def turn(self, i: int) -> float:
        """Angle [rad, 0 to 2 pi] by which the outline turns at corner i.

        It turns there from side (facet) i - 1 to side i.
        """
        return float((self.angle[i % len(self)] - self.angle[(i - 1) % len(self)]) % (2 * math.pi))

    @cached_property
    def curvature(self) -> Array:
        """Curvature (n,) [1/m] at the outline's corners: that of the curve which the polygon approximates.

        For chords of a circle, of equal length or not, it is that of the circle to second order in the turns.
        """
        turns = np.remainder(self.angle - np.roll(self.angle, 1), 2 * math.pi)
        return 2.0 * turns / (self.length + np.roll(self.length, 1))


def simplified_polygon(corners: Array) -> Outline:
    """Polygon through `corners`, with facets of negligible length or turn merged into their neighbours.

    Negligible are lengths below 1 um and turns of up to 1e-5 rad.

    Args:
        corners: (n, 2) corners of a convex polygon, anticlockwise [m]; at least three remain.

    Returns:
        The remaining corners, with the lengths and angles of the facets between them.
    """
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


def _polygon(corners: Array) -> Outline:
    """Outline of a body's cross-section from its `corners` (n, 2) [m], given anticlockwise.

    Corners are relative to the pivot point: x in the direction of tipping, z up. The outline begins at the
    facet whose angle against the table at rest, from -180 to 180 deg, is the least.
    """
    sides = np.roll(corners, -1, axis=0) - corners
    angle = np.arctan2(sides[:, 1], sides[:, 0])
    first = int(np.argmin(angle))
    return Outline(
        *(np.roll(values, -first, axis=0) for values in (corners, np.hypot(sides[:, 0], sides[:, 1]), angle))
    )


def smooth_outline(whole: Outline, high: float = HIGH) -> tuple[Outline, list[Curve], float]:
    """Outline thinned until its curves are smooth, the curves of that outline, and their roughness.

    A curve is a run of the outline's facets that approximates a smooth curve. Roughness is the standard
    deviation of the log curvature from corner to corner (dimensionless).

    Args:
        whole: the outline with all its corners.
        high: tipping angle [rad] up to which the outline is to be smooth; all of it, if too few of its
            corners touch the table up to there.

    Returns:
        The outline with fewer corners (`whole` itself if it is smooth), its curves, and the roughness, 0 if
        there are too few corners to estimate it.
    """
    outline, curves = whole, _curves(whole)
    if _roughness(outline, curves, high) is None:
        high = HIGH  # too few corners up to there
    rough = _roughness(outline, curves, high) or 0.0
    for spacing in CORNER_SPACINGS:
        if rough < MAX_ROUGHNESS:
            break
        outline = _thinned(whole, spacing)
        curves = _curves(outline)
        # With too few corners for an estimate the roughness stays what it was.
        rough = _roughness(outline, curves, high) or rough
    return outline, curves, rough


def _roughness(outline: Outline, curves: list[Curve], high: float) -> float | None:
    """Roughness of an outline's curved parts: how much ln(curvature) varies from corner to corner.

    It is a robust standard deviation (dimensionless), from the second differences of ln(curvature) along each
    curve, so that a steady change does not count. Only corners that may touch the table up to the tipping
    angle `high` [rad] are used; None if no curve has three of them in a row.
    """
    parts: list[Array] = [np.zeros(0)]
    for curve in curves:
        inner = np.array([i for i in curve.facets[1:] if LOW < outline.angle[i] < high], dtype=np.intp)
        parts.append(np.diff(np.log(outline.curvature[inner]), 2))
    uneven = np.concatenate(parts)
    return median_scale(uneven) / math.sqrt(6.0) if len(uneven) else None


def _thinned(whole: Outline, spacing: float) -> Outline:
    """Outline reduced to about one corner per `spacing` [rad] of tipping angle, and to the ends of faces.

    For tipping angles `spacing` apart, all round, the corner that touches the table is kept, and so are both
    ends of every face. A face is a facet longer than 4 % of the perimeter, or longer than all other facets
    together whose angles are within `spacing` of its own.
    """
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
class Curve:
    """Run of facets of an outline that approximate a smooth curve."""

    facets: list[int]
    """indices of the facets, in order"""

    def contacts(self, outline: Outline, theta: Array) -> tuple[IntArray, Array, Array]:
        """Contact points of this curved part of the body's outline with the table, by tipping angle.

        Args:
            outline: the outline to which the curve's facets belong.
            theta: (n,) tipping angles since rest [rad].

        Returns:
            (k,) indices of the angles at which this curve touches, (k, 2) contact points in the outline's
            coordinates (those of the body at rest, from the pivot point) [m], and (k,) radii of curvature
            there [m].
        """
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

    def _tangents(self, outline: Outline) -> Array:
        """Tangent angles (facets + 1,) of the curve at its corners [rad], ascending.

        They are those of a cubic spline through the corners; at each corner the angle is kept between the
        angles of the two facets that meet there.
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
        # At an end the tangent may reach the next face: the same corner touches there.
        room[[0, -1]] = 0.0, 0.0
        tangent = np.clip(tangent, before + room, after - room)
        tangent[0] = min(tangent[0], angle[0] - _TANGENT_ROOM * float(tangent[1] - angle[0]))
        tangent[-1] = max(tangent[-1], angle[-1] + _TANGENT_ROOM * float(angle[-1] - tangent[-2]))
        return np.asarray(tangent, dtype=np.float64)


def _curves(outline: Outline) -> list[Curve]:
    """Curves of an outline: runs of 3 or more neighbouring facets without a flat face or a corner.

    Facets are the sides of the polygon that the outline is. A corner is a turn of at least 20 deg. The list
    has one curve per run, with the indices of its facets.
    """
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
    return [Curve(run) for run in runs if len(run) >= MIN_CURVE_FACETS]


def _is_bent(outline: Outline, joined: list[bool], i: int) -> bool:
    """True if facet i is part of a curve, False if it is a flat face beside bends or between corners.

    It is part of a curve if at one of its ends, at least, two conditions hold: neither that corner nor the
    next one beyond it is sharp, and the outline's curvature at that corner is more than a quarter (1 /
    `FLAT_RADIUS_RATIO`) of that at the next one.

    Args:
        outline: the polygon.
        joined: (n,) True if facets i - 1 and i meet without a sharp corner.
        i: index of the facet.
    """
    n = len(outline)
    ends = ((i, i - 1), ((i + 1) % n, (i + 2) % n))
    return any(
        joined[end]
        and joined[beyond]
        and FLAT_RADIUS_RATIO * outline.curvature[end] > outline.curvature[beyond]
        for end, beyond in ends
    )
