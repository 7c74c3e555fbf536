"""Round rims of a resting face, and the directions in which an object tips over them (method 1.3).

A rim is a run of short edges of the support polygon, as a mesh gives a circle, an oval or a rounded corner.
An object that tips over a rim touches the table in one point, about which it may yaw. On a circle about the
centre of mass c nothing turns it away from its heading; the rounder the rim is than that, the faster it yaws.
"""

from __future__ import annotations

import numpy as np

from analyze.geometry.polyhedron import BoolArray
from analyze.geometry.rotations import plane_basis
from analyze.planning.stable_planes import RestingPlane
from analyze.types import Array
from schemas.object_spec import ObjectSpec

RIM_TURN = np.radians(20.0)
"""Angle [rad] between successive edges below which they belong to a round rim."""
RIM_EDGES = 5
"""Smallest number of edges of a round rim."""
STRAIGHT_SHARE = 0.25
"""Length of an edge, over the support polygon's width along it, from which on it is straight, however gently
its neighbours turn; a regular polygon of 13 sides or more has shorter ones."""
HEADING_STEP = np.radians(5.0)
"""Step of the directions that are tried [rad]; directions nearer to one another are one."""
CURVATURE_WINDOW = np.radians(30.0)
"""Angle [rad] to either side of a direction over which the rim's radius of curvature is averaged."""
MIN_CURVATURE_RATIO = 0.3
"""Smallest radius of curvature of a rim over the distance of its tangent from c; a circle about c has 1.

In MuJoCo, with c where it may be, a body on the ends of ovals of 0.4 to 0.85 yaws as one on a circle does
(half of the strikes by less than 5 deg up to balance); one on a single round foot of 0.15 yaws by 14 to 18
deg with c in its expected place."""
MIN_CORNER_RATIO = 0.75
"""The same for a corner between straight sides, over which the object can be tipped instead."""
MAX_ASIDE = 0.2
"""Largest distance of c beside the rim's point of contact, over that of the tangent from c or, if larger, the
rim's radius of curvature."""
ROUND_ASIDE = 0.1
"""Largest distance of c beside the point of contact, over that of the tangent from c, in all directions of a
rim that counts as round about c."""
SMOOTHING = np.radians(10.0)
"""Angle [rad] to either side of a direction over which the facets of a rim are smoothed."""


def round_rim(plane: RestingPlane) -> BoolArray:
    """Mask (k,), True for those of the k edges of a resting face that belong to a round rim.

    The edges are those of the support polygon, the convex outline of the face on the table. An edge belongs
    to a rim if it turns by less than `RIM_TURN` (20 deg) against both neighbours and is no longer than
    `STRAIGHT_SHARE` of the polygon's width: a straight side between rounded corners, or the line from one
    round foot to the next, is an edge. All are False if there are fewer than `RIM_EDGES` (5) such edges.
    """
    out = plane.outward
    turn = np.arccos(np.clip(np.einsum("ki,ki->k", out, np.roll(out, -1, axis=0)), -1, 1))
    gentle = turn < RIM_TURN
    along = np.cross(plane.up, out)
    start, end = plane.edges
    length = np.linalg.norm(end - start, axis=1)
    short = length < STRAIGHT_SHARE * np.ptp(along @ plane.polygon.T, axis=1)
    round_edge = gentle & np.roll(gentle, 1) & short
    return round_edge if round_edge.sum() >= RIM_EDGES else np.zeros(len(out), dtype=bool)


def rim_headings(plane: RestingPlane, rim: BoolArray, spec: ObjectSpec, beside: Array) -> list[Array]:
    """Unit directions (3,) in the object frame in which the object tips over a round rim and does not yaw.

    There is one for each marker on an upright face, so that the camera, which looks along the edge, sees this
    marker, and one the other way, for a strike with object and striker turned. To these come the sides and
    ends of an oval, beside which c stands; on a circle, if no marker has a pose, one every 45 degrees. Left
    out are directions less than `HEADING_STEP` from an earlier one, and those in which the object would yaw
    (`_keeps_heading`).

    Args:
        plane: Resting face.
        rim: (k,) True for the edges of its support polygon that belong to a rim.
        spec: Object file, with the markers.
        beside: (3,) expected centre of mass [m], in the object frame.
    """
    headings: list[Array] = []
    for marker in spec.marker:
        if marker.T_object_marker is not None:
            normal = np.array(marker.T_object_marker)[:3, 2]
            flat = normal - plane.up * float(normal @ plane.up)
            if np.linalg.norm(flat) > 0.9:
                headings.append(np.cross(plane.up, flat / np.linalg.norm(flat)))
    straightest = _ovals_directions(plane, beside)
    if not straightest and all(marker.T_object_marker is None for marker in spec.marker):
        headings = list(_directions(plane, np.arange(8) * np.pi / 4))
    distinct: list[Array] = []
    for heading in [*headings, *straightest, *(-heading for heading in headings)]:
        if all(heading @ other < np.cos(HEADING_STEP) for other in distinct) and _keeps_heading(
            plane, rim, heading, beside
        ):
            distinct.append(heading)
    return distinct


def _keeps_heading(plane: RestingPlane, rim: BoolArray, tip: Array, beside: Array) -> bool:
    """True if an object that tips over a rim in the direction `tip` keeps its heading.

    All of the polygon within `CURVATURE_WINDOW` of that direction must be rim, c must stand beside the point
    of contact within `MAX_ASIDE` (of a flat side, whose contact moves far under c as the heading turns
    little, the same share of its radius), and the rim's mean radius of curvature there must be at least
    `MIN_CURVATURE_RATIO` of the tangent's distance from c; `MIN_CORNER_RATIO` if not all of the polygon is
    rim.

    Args:
        plane: Resting face.
        rim: (k,) True for the edges of its support polygon that belong to a rim.
        tip: (3,) unit direction of the tip, in the object frame.
        beside: (3,) expected centre of mass [m], in the object frame.
    """
    facing = plane.outward @ tip
    if not rim[int(np.argmax(facing))] or not rim[facing > np.cos(CURVATURE_WINDOW)].all():
        return False
    across = np.cross(plane.up, tip)
    ahead, aside = (plane.polygon - beside) @ tip, (plane.polygon - beside) @ across
    distance = float(ahead.max())
    ends: list[float] = []
    for turn in (-CURVATURE_WINDOW, CURVATURE_WINDOW):
        turned = np.cos(turn) * ahead + np.sin(turn) * aside
        ends.append(float(aside[turned > turned.max() - 1e-9].mean()))
    radius = (ends[1] - ends[0]) / (2 * np.sin(CURVATURE_WINDOW))
    # The mean of both ends is the contact of the smooth rim; its nearest corner is up to half a facet away.
    least = MIN_CURVATURE_RATIO if rim.all() else MIN_CORNER_RATIO
    return radius >= least * distance and abs(sum(ends)) / 2 <= MAX_ASIDE * max(distance, radius)


def _ovals_directions(plane: RestingPlane, beside: Array) -> list[Array]:
    """Unit directions (3,), in the object frame, in which c stands beside the rim's point of contact.

    They point to the sides and ends of an oval. A rim that is round about c has none of its own.

    Args:
        plane: Resting face.
        beside: (3,) expected centre of mass [m], in the object frame.
    """
    step = np.radians(1.0)
    angles = np.arange(0.0, 2 * np.pi, step)
    distance = (_directions(plane, angles) @ (plane.polygon - beside).T).max(axis=1)
    window = round(SMOOTHING / step)
    aside = (np.roll(distance, -window) - np.roll(distance, window)) / (2 * np.sin(SMOOTHING))
    if np.abs(aside / distance).max() < ROUND_ASIDE:
        return []
    following = np.roll(aside, -1)
    crossings = np.flatnonzero((aside == 0) | (aside * following < 0))
    share = aside[crossings] / np.where(aside[crossings] == 0, 1.0, aside[crossings] - following[crossings])
    return list(_directions(plane, angles[crossings] + share * step))


def _directions(plane: RestingPlane, angles: Array) -> Array:
    """Unit vectors (n, 3) in a resting face's plane, in the object frame.

    Args:
        plane: Resting face.
        angles: (n,) angles [rad] from the first vector of `plane_basis(plane.up)` towards the second.
    """
    u, v = plane_basis(plane.up)
    return np.outer(np.cos(angles), u) + np.outer(np.sin(angles), v)
