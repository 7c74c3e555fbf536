"""Support lines of a tip: the lines over which the object turns in succession, from rest to landing.

A box turns over one edge until its side lands at 90 deg. An object with a chamfered foot turns over the
foot's edge until the chamfer lies on the table, then over the chamfer's other edge; one on four feet, over
the feet's outer edges and then over the body's. Balance angle phi and rate k, in theta'' = -k sin(phi -
theta), belong to the line over which it turns at balance, so that a strike counts for that line only.

The lines follow from the outline of the convex hull, seen along the pivot axis: turned by theta, the object
touches the table with the outline's lowest corner, and the next corner takes over where the facet between the
two lies on the table. Rounded by a radius, each corner's centre line lies that radius inside both facets; a
bevel narrower than its rounding vanishes in it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.outline import HIGH, Outline, smooth_outline
from analyze.motion.support_function import hull_outline
from analyze.types import SupportLine

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.types import Array

LIFTED_RAD = math.radians(0.5)
"""tipping angle [rad] up to which a facet counts as part of the resting face"""
_SAME_LINE_M = 1e-5
"""largest distance [m] between two successive lines at which the second one is left out"""


def carrying_line(supports: Sequence[SupportLine], theta: float) -> int:
    """Index of the support line over which the object turns at a tipping angle.

    Args:
        supports: Support lines, ordered by the angle at which each takes over from the one before.
        theta: Tipping angle [rad].
    """
    return max(sum(line.takes_over_rad <= theta for line in supports) - 1, 0)


def support_lines(
    points: Array, rounding: float, sd: float, join_curves: bool = True
) -> tuple[SupportLine, ...]:
    """Lines over which an object turns in succession as it tips, from rest up to 150 deg.

    Facets of the outline that lie on the table within 0.5 deg of rest belong to the resting face.

    Args:
        points: (n, 2) corners of the hull, seen along the pivot axis [m]: x towards where the object tips, z
            up, from the planned pivot's centre line; points inside the convex hull are ignored.
        rounding: Radius of the rounding of every corner that is not part of a curved flank [m].
        sd: Standard deviation of an edge's place [m].
        join_curves: True if a curved flank, approximated by short facets, gives one line; False if each of
            its corners gives one.

    Returns:
        The lines, ordered by the tipping angle at which each takes over from the one before, the line at rest
        first.

    Raises:
        EstimationError: the points span no area.
    """
    outline, curves, _ = smooth_outline(hull_outline(points, np.zeros(2)))
    curved = np.zeros(len(outline), dtype=bool)
    for curve in curves:
        curved[curve.facets] = True
    angle, corners, curved = _without_swallowed(outline, curved, rounding)
    centres, radii = _centres(angle, corners, curved, rounding)
    start = int(np.argmax(angle > LIFTED_RAD))
    lines: list[SupportLine] = []
    for i in range(start, start + int(np.count_nonzero((angle > LIFTED_RAD) & (angle < HIGH))) + 1):
        begins, place = (i - 1) % len(angle), centres[i % len(angle)]
        rolls = bool(curved[i % len(angle)])
        if not lines:
            lines.append(
                SupportLine(float(place[0]), float(place[1]), 0.0, 0.0, float(radii[i % len(angle)]), rolls)
            )
            continue
        last = lines[-1]
        width = math.hypot(float(place[0]) - last.along_m, float(place[1]) - last.up_m)
        if (join_curves and last.is_curve and rolls) or (width < _SAME_LINE_M and rolls == last.is_curve):
            continue
        lines.append(
            SupportLine(
                float(place[0]),
                float(place[1]),
                float(angle[begins]),
                sd / max(width, _SAME_LINE_M),
                float(radii[i % len(angle)]),
                rolls,
            )
        )
    return tuple(lines)


def _without_swallowed(
    outline: Outline, curved: NDArray[np.bool_], rounding: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Facets of an outline left once its corners are rounded: angles, first corners, curved or not.

    A facet vanishes if it is shorter than the lengths that the rounding takes off at both its ends; its
    neighbours are then prolonged until they meet. The shortest goes first. Facets of curves remain.

    Args:
        outline: The n facets, anticlockwise.
        curved: (n,) True for facets of a curved flank.
        rounding: Radius of the rounding [m].

    Returns:
        For the m <= n facets left: (m,) angles against the table at rest [rad], ascending; (m, 2) first
        corners [m]; (m,) True for facets of a curve.
    """
    angle, corners = outline.angle.copy(), outline.corners.copy()
    curved = curved.copy()
    while len(angle) > 3:
        turn = np.remainder(angle - np.roll(angle, 1), 2 * math.pi)
        sides = np.roll(corners, -1, axis=0) - corners
        taken = rounding * np.tan(0.5 * turn)
        left = np.hypot(sides[:, 0], sides[:, 1]) - taken - np.roll(taken, -1)
        # Neighbours that turn by 180 deg or more do not meet again.
        across = turn + np.roll(turn, -1)
        fixed = curved | np.roll(curved, 1) | np.roll(curved, -1) | (across > 0.9 * math.pi)
        worst = int(np.argmin(np.where(fixed, np.inf, left)))
        if fixed[worst] or left[worst] > 0.0:
            break
        before, after = (worst - 1) % len(angle), (worst + 1) % len(angle)
        way = np.array([[math.cos(a), math.sin(a)] for a in (angle[before], angle[after])])
        gap = corners[after] - corners[before]
        corners[after] = corners[before] + way[0] * (_cross(gap, way[1]) / _cross(way[0], way[1]))
        rest = np.arange(len(angle)) != worst
        angle, corners, curved = angle[rest], corners[rest], curved[rest]
    return angle, corners, curved


def _cross(first: Array, second: Array) -> float:
    """Product first x second of two vectors (2,) in the plane: positive if the second lies to the left."""
    return float(first[0] * second[1] - first[1] * second[0])


def _centres(angle: Array, corners: Array, curved: NDArray[np.bool_], rounding: float) -> tuple[Array, Array]:
    """Centres (n, 2) [m] and radii (n,) [m] of the rounding at the first corner of each of n facets.

    A centre lies the radius inside both facets that meet there. A corner at a curved flank is not rounded: it
    is returned itself, with radius 0.

    Args:
        angle: (n,) angles of the facets against the table at rest [rad].
        corners: (n, 2) their first corners [m], anticlockwise.
        curved: (n,) True for facets of a curved flank.
        rounding: Radius of the rounding [m].
    """
    radii = np.where(curved | np.roll(curved, 1), 0.0, rounding)
    turn = np.remainder(angle - np.roll(angle, 1), 2 * math.pi)
    middle = angle - 0.5 * turn
    inwards = np.column_stack([-np.sin(middle), np.cos(middle)])
    return corners + inwards * (radii / np.cos(0.5 * turn))[:, None], radii
