"""Support function of a tipping body's cross-section, for a contact that rolls on a curve (method 3).

In the plane across the axis, x towards where the body tips and z up at rest, the body turned by theta touches
the table where its outward normal is (sin theta, -cos theta). h(theta) is the height of the pivot point p
over the table, h'(theta) the horizontal distance from p to the contact, and h + h'' = rho(theta) >= 0 the
radius of curvature there. A mesh gives a curve by chords only: h' jumps at each facet, and rho is zero except
for spikes. In this module each run of short facets becomes a smooth curve through its corners, whose radius
varies linearly along each facet and is never negative. A facet stays flat if the outline bends far less at
its ends than beside it; a turn of more than 20 deg is a corner.

The facets of a scan are as rough as its noise: noise of 20 um over facets of 0.4 mm makes the radius ten
times too large at some corners and zero at others. If the bends at neighbouring corners scatter that much,
only corners some degrees apart are used, as few as needed.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial import ConvexHull, QhullError

from analyze.errors import EstimationError
from analyze.motion.outline import HIGH, LOW, Curve, Outline, simplified_polygon, smooth_outline

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array

_OFFSET_PER_ROUGHNESS = 0.6
"""error of the contact along a facet, over the facet's length L, per unit of roughness

Corner errors e give a roughness of e sqrt(6) / (L turn) and shift the contact by e sqrt(2) / turn.
"""
_MIDDLE_SD_SHARE = 0.2
"""standard deviation of the centre of mass about the section's middle, over the root of the section's area"""
_LIFTED_RAD = math.radians(0.5)
"""theta [rad] from which no part of the resting face touches"""
_STEP = math.radians(0.25)
"""step of the grid of angles [rad]"""


@dataclass(frozen=True)
class SupportFunction:
    """Support function of the object's cross-section, on an even grid of n tipping angles theta [rad].

    The section is that across the pivot axis. h(theta) is the height of the pivot point p over the table, its
    derivative h' the horizontal distance from p to the contact, rho the radius of curvature there, all in m.
    """

    start: float
    """first angle [rad]"""
    step: float
    """step of the grid [rad]"""
    height: Array
    """(n,) h: height of the pivot point p over the table [m]"""
    ahead: Array
    """(n,) h': distance from p to the contact, towards where the body tips [m]"""
    radius: Array
    """(n,) rho: radius of curvature at the contact [m]"""
    middle: tuple[float, float]
    """x and z [m] from p to the section's middle, near which the centre of mass c is expected"""
    middle_sd: float
    """standard deviation of c about that middle [m]; infinite if unknown"""
    sd: float = 0.0
    """standard deviation [m] of the section's position along and off the table, caused by its facets"""
    curved: NDArray[np.bool_] | None = None
    """(n,) True where a curve of the shape itself touches, not a corner or a rounding; None if nowhere"""
    roughness: float = 0.0
    """relative standard deviation of the radius of such a curve, caused by uneven bends of the shape"""

    def evaluate(self, theta: Array) -> tuple[Array, Array, Array]:
        """Support function h, its derivative h' and radius rho, all in m, at tipping angles, interpolated.

        h is the height of the pivot point over the table, h' the horizontal distance from it to the contact
        in the direction of tipping, rho the radius of curvature at the contact. Beyond the grid the values at
        its ends are taken.

        Args:
            theta: (...) tipping angles [rad]; each result has this shape.
        """
        place = np.minimum(np.maximum((theta - self.start) / self.step, 0.0), len(self.height) - 1.001)
        index = place.astype(np.intp)
        share = (place - index)[..., None]
        row = self._table[index] * (1.0 - share) + self._table[index + 1] * share
        return row[..., 0], row[..., 1], row[..., 2]

    def centre(self, theta: float) -> tuple[float, float, float]:
        """Centre (x, z) and radius of the curvature at the contact, at a tipping angle: three numbers [m].

        The centre is in the rest pose, relative to the pivot point p; x points in the direction of tipping, z
        up.

        Args:
            theta: tipping angle [rad].
        """
        height, ahead, radius = (float(each) for each in self.evaluate(np.array(theta)))
        # In W the centre is `ahead` in front of p and `radius` above the table; rotate back by theta.
        along, over = ahead, radius - height
        cos, sin = math.cos(theta), math.sin(theta)
        return along * cos - over * sin, along * sin + over * cos, radius

    def rolling_displacement(self, theta: Array) -> tuple[Array, Array]:
        """Displacement (n,) of the pivot point along and (n,) off the table [m], by rolling from rest.

        Positive are the direction of tipping, and up. Below 0.5 deg, where the resting face may touch, the
        motion is extrapolated.

        Args:
            theta: (n,) tipping angles [rad].
        """
        # Near rest the resting face may touch; there the motion is extrapolated from `_LIFTED_RAD`.
        later = np.maximum(theta, _LIFTED_RAD)
        height, ahead, _ = self.evaluate(later)
        height0, ahead0, _ = (float(each) for each in self.evaluate(np.array(_LIFTED_RAD)))
        travel: Array = cumulative_trapezoid(self.radius, dx=self.step, initial=0)
        travelled = np.interp(later, self.angles, travel) - float(np.interp(_LIFTED_RAD, self.angles, travel))
        begun = np.minimum(theta, _LIFTED_RAD)
        return travelled - ahead + ahead0 + height0 * begun, height - height0 + ahead0 * begun

    def touches_curve(self, theta: float) -> bool:
        """True if a curved part of the cross-section, not a corner, touches the table at a tipping angle.

        A corner with a stated rounding counts as a corner. False beyond the grid of angles.

        Args:
            theta: tipping angle [rad].
        """
        place = round((theta - self.start) / self.step)
        return self.curved is not None and 0 <= place < len(self.curved) and bool(self.curved[place])

    def curved_over(self, low: float, high: float, least: float) -> float:
        """Size [rad], in total, of the ranges of tipping angle in which a large curve touches the table.

        A curve is a curved part of the shape's cross-section, not a corner or an edge's rounding. It is large
        if its radius exceeds `least`.

        Args:
            low: least tipping angle counted [rad].
            high: largest tipping angle counted [rad].
            least: radius [m] that the curve must exceed; smaller curves count as corners.
        """
        inside = (self.angles >= low) & (self.angles <= high) & (self.radius > least)
        return 0.0 if self.curved is None else self.step * float(np.count_nonzero(inside & self.curved))

    def range_of_radius(self, low: float, high: float) -> tuple[float, float]:
        """Least and greatest radius of curvature [m] at the contact, over a range of tipping angles.

        The contact is the point of the body's outline on the table. 50 angles from `low` to `high` [rad] are
        evaluated.
        """
        _, _, radius = self.evaluate(np.linspace(low, high, 50))
        return float(np.min(radius)), float(np.max(radius))

    def longest_flat(self, low: float, high: float) -> float:
        """Length [m] of the longest flat face that comes to lie on the table between two tipping angles.

        The contact jumps from one end of such a face to the other. 0 if there is none.

        Args:
            low: first angle [rad].
            high: last angle [rad].
        """
        return float(np.max(self._flats(low, high)[1], initial=0.0))

    def first_flat(self, low: float, high: float, least: float) -> float:
        """First tipping angle [rad] at which a flat face comes to lie on the table; infinite if none does.

        Args:
            low: first angle [rad].
            high: last angle [rad].
            least: length [m] from which a face counts.
        """
        angles, jumps = self._flats(low, high)
        return float(np.min(angles[jumps >= least], initial=math.inf))

    def _flats(self, low: float, high: float) -> tuple[Array, Array]:
        """Angles (n,) [rad] at the beginning of each step, and lengths (n,) [m] of faces that land in it.

        Args:
            low: first angle [rad].
            high: last angle [rad].
        """
        inside = (self.angles >= low) & (self.angles <= high)
        # A face within a curve has a huge radius over a small part of a step.
        radius = np.lib.stride_tricks.sliding_window_view(np.pad(self.radius, 2, mode="edge"), 5).min(axis=1)
        grows = (radius - self.height)[inside]
        jumps = np.diff(self.ahead[inside]) - 0.5 * (grows[1:] + grows[:-1]) * self.step
        return self.angles[inside][:-1], jumps

    @cached_property
    def angles(self) -> Array:
        """Tipping angles (n,) [rad] at which the support function is tabulated."""
        return self.start + self.step * np.arange(len(self.height), dtype=np.float64)

    @cached_property
    def _table(self) -> Array:
        """Columns (n, 3) of h, h' and rho [m] by tipping angle, on the even grid of n angles.

        h is the pivot point's height over the table, h' its horizontal distance to the contact, rho the
        radius of curvature at the contact.
        """
        return np.stack([self.height, self.ahead, self.radius], axis=-1)


def circular_support(radius: float) -> SupportFunction:
    """Support function of a circle: an edge that rolls on its rounding, the rest of the outline unknown.

    A support function is the pivot point's height over the table [m] by tipping angle theta; here it is
    `radius` at all angles, as the pivot point is the circle's centre. A motion on it determines the balance
    angle phi and the rate k of the tip, theta'' = -k sin(phi - theta) for a sharp edge, but not the distance
    of the centre of mass from the pivot.

    Args:
        radius: radius of the rounding [m], 0 for a sharp edge.
    """
    n = round((HIGH - LOW) / _STEP) + 1
    return SupportFunction(
        LOW, _STEP, np.full(n, radius), np.zeros(n), np.full(n, radius), (0.0, 0.0), math.inf
    )


def support_of_outline(
    points: Array, pivot: Array, rounding: float = 0.0, until: float = HIGH
) -> SupportFunction:
    """Support function of a cross-section about a pivot point, from points of its outline.

    It gives the height [m] of the pivot point over the table for each tipping angle.

    Args:
        points: (n, 2) points of the outline [m], x in the direction of tipping, z up, in any order; points
            inside the convex hull are ignored.
        pivot: (2,) pivot point in the same frame [m].
        rounding: radius of the rounding of every corner that is not part of a curve [m].
        until: tipping angle [rad] up to which facets and roughness count as errors.

    Returns:
        The support function from -10 to 150 deg of tipping angle, with the errors caused by facets and
        roughness.

    Raises:
        EstimationError: the points span no area.
    """
    whole = hull_outline(points, pivot)
    outline, curves, rough = smooth_outline(whole, until)
    theta = np.asarray(LOW + _STEP * np.arange(round((HIGH - LOW) / _STEP) + 1), dtype=np.float64)
    touching, offset = _at_corners(outline, curves, theta, rounding)
    radius, bent = offset.copy(), np.zeros(len(theta), dtype=bool)
    for curve in curves:
        inside, points, radii = curve.contacts(outline, theta)
        touching[inside], offset[inside], radius[inside], bent[inside] = points, 0.0, radii, True
    cos, sin = np.cos(theta), np.sin(theta)
    height = touching[:, 0] * sin - touching[:, 1] * cos + offset
    # Chords lie inside the curve, by up to twice this on average; the rest of the difference is their noise.
    chords = np.max(np.outer(sin, whole.corners[:, 0]) - np.outer(cos, whole.corners[:, 1]), axis=1)
    beyond = np.asarray((height - chords)[bent & (theta > 0.0) & (theta < until)], dtype=np.float64)
    touch = [[i for i in curve.facets if LOW < outline.angle[i] < until] for curve in curves]
    lengths = [float(np.mean(outline.length[facets])) for facets in touch if facets]
    middle, area = _middle(whole.corners)
    return SupportFunction(
        LOW,
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


def hull_outline(points: Array, pivot: Array) -> Outline:
    """Convex outline of a cross-section, as anticlockwise facets, relative to a pivot point [m].

    Args:
        points: (n, 2) points of the section [m], x in the direction of tipping, z up, in any order; points
            inside the convex hull are ignored.
        pivot: (2,) pivot point in the same frame [m].

    Raises:
        EstimationError: the points span no area.
    """
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        raise EstimationError("the section across the pivot axis has no area: check the shape") from None
    return simplified_polygon(np.asarray(points[hull.vertices] - pivot, dtype=np.float64))


def _at_corners(outline: Outline, curves: list[Curve], theta: Array, rounding: float) -> tuple[Array, Array]:
    """Centre (n, 2) [m] and radius (n,) [m] of the rounded corner that touches, at n tipping angles.

    A corner that is part of a curve counts as sharp: the corner itself is returned, with radius 0. The points
    are in the outline's coordinates, those of the body at rest.

    Args:
        outline: the cross-section, with coordinates relative to the pivot point.
        curves: its curves.
        theta: (n,) tipping angles [rad].
        rounding: radius of the rounding of every other corner [m].
    """
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
    """Centroid (2,) [m] and area [m^2] of a polygon with corners (n, 2) [m], anticlockwise."""
    following = np.roll(corners, -1, axis=0)
    cross = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    area = 0.5 * float(cross.sum())
    return np.asarray(
        ((corners + following) * cross[:, None]).sum(axis=0) / (6.0 * area), dtype=np.float64
    ), area
