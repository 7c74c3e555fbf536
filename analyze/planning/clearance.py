"""Clearance of the striker: heights at which its tip meets an upright surface, and nothing else.

The tip is a sphere that moves along a horizontal ray, below an arm that hangs straight down at contact. The
object is cut by planes across the pivot edge, beside one another: lanes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import BoolArray, area_vectors
from analyze.planning.pivots import PivotAxis
from analyze.types import Array, IntArray
from schemas.rig_limits import ARM_LENGTH_M

TIP_RADIUS = 0.008
"""Radius of the striker's tip [m]."""
LANES = (-0.006, -0.004, -0.002, 0.0, 0.002, 0.004, 0.006)
"""Distances [m] beside the tip's path, along the pivot edge, at which the object is cut; the middle one is
the path."""
HEIGHT_STEP = 0.001
"""Spacing of the heights tried [m]."""
SIDE_ERROR = 0.002
"""Error of the tip's path [m] sideways, within which it must still meet the same face."""
ARM_HALF_WIDTH = 0.004
"""Half the width of the striker's arm above the tip [m]."""
SECTION_OFFSET = 1.7e-8
"""Offset of the plane y = 0 in which rays run [m], so that no corner lies exactly in it."""
HEIGHT_ERROR = 0.004
"""Error of the height [m] at which the tip must still meet the same face."""
MAX_FLANK_LEAD = 0.001
"""Distance [m] by which a slanting face may meet the tip's flank before its foremost point."""
MAX_GLANCE = np.radians(20.0)
"""Largest angle [rad] between surface normal and strike at which the tip does not glance off."""
CLEAR_TURNS = np.radians(np.arange(1.0, 9.0))
"""Turns [rad] of the tipping object through which the tip must be clear of it, until the arm is drawn back:
some 40 ms."""
SMOOTHED_LANES, SMOOTHED_HEIGHTS = 2, 4
"""Reach of the planes fitted to a scan's noisy surface: lanes to each side, and heights up and down."""
MIN_SMOOTHED = 12
"""Fewest points of the cuts to which a plane is fitted."""
STEP_SDS = 4.0
"""Difference from a slanting face, in 1 sigma of the noise, beyond which a point lies behind a step."""
OUTLINE_STEP = 0.002
"""Spacing [m] of the points of the object's outline that are examined."""


@dataclass(frozen=True)
class Section:
    """Cut through the object across the pivot edge: what horizontal rays meet first, height by height."""

    beside: float
    """Distance [m] of the cut from the tip's path, along the pivot edge."""
    distance: Array
    """(n,) distance [m] from the rays' start to the surface; inf where nothing is met."""
    glance: Array
    """(n,) angle [rad] between the surface's outward normal and W's -x; pi where nothing is met."""


def without_noise(sections: Sequence[Section], heights: Array, noise_sd: float) -> list[Section]:
    """Cuts through a scanned object without the scan's noise, which tilts its single faces by up to 40 deg.

    At each point of the cuts a plane is fitted to those around it, without those behind a step. Where there
    are fewer than `MIN_SMOOTHED`, the point stays as it is.

    Args:
        sections: Cuts through the object, one per lane; lanes and heights are equally spaced.
        heights: (n,) heights over the table [m], ascending.
        noise_sd: 1 sigma of the surface's noise [m].
    """
    lanes, rows = SMOOTHED_LANES, SMOOTHED_HEIGHTS
    distance = np.array([each.distance for each in sections])
    padded = np.pad(distance, ((lanes, lanes), (rows, rows)), constant_values=np.inf)
    own = np.where(np.isfinite(distance), distance, 0.0)
    spacing = np.array([sections[1].beside - sections[0].beside, HEIGHT_STEP])
    largest = np.hypot(lanes * spacing[0], rows * spacing[1]) * np.tan(MAX_GLANCE) + STEP_SDS * noise_sd
    left, right = np.zeros((*distance.shape, 3, 3)), np.zeros((*distance.shape, 3))
    for lane, row in np.ndindex(2 * lanes + 1, 2 * rows + 1):
        gap = padded[lane : lane + len(distance), row : row + len(heights)] - own
        used = np.isfinite(distance) & (np.abs(gap) <= largest)
        place = np.array([1.0, *((lane - lanes, row - rows) * spacing)])
        left += used[..., None, None] * np.outer(place, place)
        right += np.where(used, gap, 0.0)[..., None] * place
    enough = left[..., 0, 0] >= MIN_SMOOTHED
    plane = np.zeros((*distance.shape, 3))
    plane[enough] = (np.linalg.pinv(left[enough]) @ right[enough][..., None])[..., 0]
    glance = np.arctan(np.hypot(plane[..., 1], plane[..., 2]))
    return [
        Section(
            each.beside, each.distance + plane[lane, :, 0], np.where(enough[lane], glance[lane], each.glance)
        )
        for lane, each in enumerate(sections)
    ]


def meets_squarely(sections: Sequence[Section], heights: Array, tried: IntArray) -> BoolArray:
    """Mask (k,) of heights at which the tip's foremost point meets an even, upright surface first.

    The sphere must not meet another part of the object first, above, below or beside. Within `HEIGHT_ERROR`
    up and down and `SIDE_ERROR` sideways the surface must have no step, and its normal must be within
    `MAX_GLANCE` of the ray.

    Args:
        sections: Cuts through the object, one per lane, that of the tip's path in the middle.
        heights: (n,) heights over the table [m], equally spaced.
        tried: (k,) indices of the heights to judge.
    """
    own = sections[len(sections) // 2].distance[tried, None]
    above = np.abs(heights - heights[tried, None])
    good = np.ones(len(tried), dtype=bool)
    first, last = np.full(len(tried), np.inf), np.full(len(tried), -np.inf)
    for each in sections:
        offset = np.hypot(above, each.beside)
        flank = TIP_RADIUS - np.sqrt(np.maximum(TIP_RADIUS**2 - offset**2, 0))
        good &= ~np.any((offset < TIP_RADIUS) & (each.distance + flank < own - MAX_FLANK_LEAD), axis=1)
        if abs(each.beside) > SIDE_ERROR:
            continue
        near_by = above <= HEIGHT_ERROR
        good &= np.where(near_by, each.glance, 0.0).max(axis=1, initial=0.0) <= MAX_GLANCE
        first = np.minimum(first, np.where(near_by, each.distance, np.inf).min(axis=1, initial=np.inf))
        last = np.maximum(last, np.where(near_by, each.distance, -np.inf).max(axis=1, initial=-np.inf))
    return good & (last <= first + 2 * HEIGHT_ERROR * np.tan(MAX_GLANCE))


def under_arm(sections: Sequence[Section], heights: Array, tried: IntArray) -> BoolArray:
    """Mask (k,) of heights at which no part of the object above the tip juts out into the striker's arm.

    Args:
        sections: Cuts through the object, one per lane, that of the tip's path in the middle.
        heights: (n,) heights over the table [m], ascending.
        tried: (k,) indices of the heights to judge.
    """
    own = sections[len(sections) // 2].distance[tried, None]
    above = heights - heights[tried, None]
    beside_arm = (above > TIP_RADIUS) & (above <= ARM_LENGTH_M)
    clear = np.ones(len(tried), dtype=bool)
    for each in sections:
        if abs(each.beside) <= ARM_HALF_WIDTH:
            front = own - TIP_RADIUS + ARM_HALF_WIDTH
            clear &= ~np.any(beside_arm & (each.distance < front), axis=1)
    return clear


def stays_clear(
    sections: Sequence[Section], heights: Array, start: float, pivot_height: float, tried: IntArray
) -> BoolArray:
    """Mask (k,) of heights at which the struck object, as it begins to tip, does not rise against the tip.

    The tip is taken to stay where it met the object, until it is drawn back.

    Args:
        sections: Cuts through the object, one per lane, that of the tip's path in the middle.
        heights: (n,) heights over the table [m], ascending.
        start: place at which the rays start, in W's +x from the pivot line [m].
        pivot_height: height of the pivot line over the table [m].
        tried: (k,) indices of the heights to judge.
    """
    own = start + sections[len(sections) // 2].distance[tried, None]
    clear = np.ones(len(tried), dtype=bool)
    for each in sections:
        x = start + each.distance
        known = np.flatnonzero(np.isfinite(x))
        if not len(tried) or not len(known) or x[known].min() >= own.max() - MAX_FLANK_LEAD:
            continue  # nothing juts out
        outline_x, outline_z = _outline(x[known], heights[known] - pivot_height)
        for turn in CLEAR_TURNS:
            turned_x = outline_x * np.cos(turn) + outline_z * np.sin(turn)
            turned_z = pivot_height + outline_z * np.cos(turn) - outline_x * np.sin(turn)
            across = np.hypot(turned_x - (own - TIP_RADIUS), each.beside)
            gap = np.hypot(across, turned_z - heights[tried, None])
            clear &= gap.min(axis=1, initial=np.inf) > TIP_RADIUS - MAX_FLANK_LEAD
    return clear


def _outline(x: Array, z: Array) -> tuple[Array, Array]:
    """Points x (k,), z (k,) [m] at most `OUTLINE_STEP` apart in x on the line through points (n,), (n,)."""
    count: IntArray = np.maximum(np.ceil(np.abs(np.diff(x)) / OUTLINE_STEP), 1).astype(np.int64)
    piece: IntArray = np.repeat(np.arange(len(count)), count)
    within: IntArray = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    place: Array = np.concatenate([np.zeros(1), piece + (within + 1) / count[piece]])
    known = np.arange(len(x))
    return np.interp(place, known, x), np.interp(place, known, z)


def section(model: ObjectModel, axis: PivotAxis, heights: Array, start: float, beside: float) -> Section:
    """Cut through the object at y = `beside`: the surface that rays in W's +x meet first.

    W is the world frame at rest: x in the direction in which the object tips, y along the pivot edge, z up.
    The faces that the plane cuts become segments (x, z), of which each ray meets the foremost.

    Args:
        model: Shape of the object.
        axis: Pivot axis, for the rest pose.
        heights: (n,) heights over the table [m].
        start: x at which the rays start [m], outside the object.
        beside: y of the plane [m].
    """
    R, p = axis.R_world_object, axis.p_world_object
    # Offset so that no corner lies exactly in the plane.
    height: Array = model.vertices @ R[1] + p[1] - beside - SECTION_OFFSET
    a, b, c = (height[corner] > 0 for corner in model.faces.T)
    cut = model.faces[(a != b) | (a != c)]
    corners: Array = model.vertices[cut] @ R.T + p
    y: Array = height[cut]
    distance, glance = np.full(len(heights), np.inf), np.full(len(heights), np.pi)
    if not len(corners):
        return Section(beside, distance, glance)
    # Two of a cut face's three edges are cut: those from the corner that is alone on its side.
    above = y > 0
    lone = np.argmax(np.where(above.sum(axis=1, keepdims=True) == 1, above, np.logical_not(above)), axis=1)
    row = np.arange(len(corners))
    ends: list[Array] = []
    for step in (1, 2):
        other = (lone + step) % 3
        share = y[row, lone] / (y[row, lone] - y[row, other])
        ends.append(corners[row, lone] + share[:, None] * (corners[row, other] - corners[row, lone]))
    first, second = ends
    normal = area_vectors(corners)
    angle = np.arccos(np.clip(-normal[:, 0] / np.maximum(np.linalg.norm(normal, axis=1), 1e-30), -1, 1))
    rise = second[:, 2] - first[:, 2]
    along = (heights[:, None] - first[:, 2]) / np.where(np.abs(rise) > 1e-12, rise, 1.0)
    met = (along >= 0) & (along <= 1) & (np.abs(rise) > 1e-12)
    x = np.where(met, first[:, 0] + along * (second[:, 0] - first[:, 0]), np.inf)
    foremost = np.argmin(x, axis=1)
    hit = np.isfinite(x[np.arange(len(heights)), foremost])
    distance[hit] = x[hit, foremost[hit]] - start
    glance[hit] = angle[foremost[hit]]
    return Section(beside, distance, glance)
