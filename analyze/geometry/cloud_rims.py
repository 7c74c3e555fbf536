"""Rims in which the curved walls of a point cloud meet its planar faces; lengths in m.

A wall is extrapolated to the plane of the face, since smoothing rounds off the rim itself.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from analyze.geometry.hull_planes import FittedPlane, widest_gap
from analyze.types import Array

MIN_OUTLINE_POINTS = 24
"""Smallest number of points from which an outline is taken."""
MIN_STEEPNESS = 0.35
"""Smallest sine of the angle between a face and a curved wall that is extrapolated to meet it."""
CIRCLE_SIDES = 128
"""Vertices of a fitted circular rim."""
MAX_RIM_GAP = np.radians(60.0)
"""Largest gap [rad] in the points of a rim to which a circle is still fitted."""
FACE_BAND_SCATTERS = 4.5
"""Distance from a plane, in units of its scatter, up to which a point belongs to its face."""
OUTLINE_NOISE_SDS = 2.5
"""Distance by which the noise moves the outline of a face's points outwards, in units of its sd."""


def rim_of_face(
    smoothed: Array,
    normals: Array,
    plane: FittedPlane,
    planes: tuple[FittedPlane, ...],
    sd: float,
    spacing: float,
    smooth_sd: float,
) -> Array:
    """Points (k, 3) [m] of the rim in which curved walls, extrapolated, meet a planar face.

    Each wall is continued along its tangent from its smoothed points nearest the face. If the points of the
    rim lie on a circle, they are replaced by a regular polygon on it. The result is empty if fewer than three
    smoothed points lie close below the face on a wall steeper than `MIN_STEEPNESS`.

    Args:
        smoothed: (n, 3) smoothed points of the walls [m].
        normals: (n, 3) unit normals of the walls there, of either sign.
        plane: Plane of the face.
        planes: Planes of all faces; the rim lies inside them.
        sd: 1 sigma of the noise [m].
        spacing: Distance of neighbouring points [m].
        smooth_sd: 1 sigma of the smoothed points [m].
    """
    if not len(smoothed):
        return np.zeros((0, 3))
    height = plane.heights(smoothed)
    towards = plane.normal - normals * (normals @ plane.normal)[:, None]
    steepness = np.linalg.norm(towards, axis=1)
    near = (height < 0) & (height > -(6 * sd + 4 * spacing)) & (steepness > MIN_STEEPNESS)
    if near.sum() < 3:
        return np.zeros((0, 3))
    rim = smoothed[near] - towards[near] * (height[near] / steepness[near] ** 2)[:, None]
    for other in planes:
        if other is not plane and abs(float(other.normal @ plane.normal)) < 0.99:
            rim = rim[other.heights(rim) <= 0]
    return _on_circle(rim, plane, max(2.5 * smooth_sd, 0.3 * spacing))


def rim_within_outline(
    rim: Array, points: Array, plane: FittedPlane, sd: float, spacing: float
) -> tuple[Array, bool]:
    """Limit the rim of a planar face to the outline of the face's points.

    A wall too low to have points of its own is extrapolated from the surface above it, and then meets the
    face beyond the face's points. The outline allows for two errors: noise moves it outwards by about
    `OUTLINE_NOISE_SDS` sd; where points are sparse, the outermost ones lie up to a spacing inside the true
    outline.

    Args:
        rim: (k, 3) points of the rim [m].
        points: (n, 3) points of the cloud [m].
        plane: Plane of the face.
        sd: 1 sigma of the noise [m].
        spacing: Distance of neighbouring points [m].

    Returns:
        Points (k, 3) [m] of the rim, and True if they were changed; they are not if all lie within a spacing
        and one sd of the outline, or the face has fewer than `MIN_OUTLINE_POINTS` points.
    """
    face = points[np.abs(plane.heights(points)) <= FACE_BAND_SCATTERS * plane.scatter]
    if not len(rim) or len(face) < MIN_OUTLINE_POINTS:
        return rim, False
    try:
        outline = ConvexHull(face @ plane.basis.T)
    except QhullError:
        return rim, False
    middle = outline.points[outline.vertices].mean(axis=0)
    flat = rim @ plane.basis.T - middle
    room = -(outline.equations[:, :2] @ middle + outline.equations[:, 2])
    if (flat @ outline.equations[:, :2].T <= room + spacing + sd).all():
        return rim, False
    rise = flat @ outline.equations[:, :2].T / np.maximum(room - OUTLINE_NOISE_SDS * sd, 0.5 * room)
    drawn = flat / np.maximum(rise.max(axis=1), 1.0)[:, None] - flat
    return rim + drawn @ plane.basis, True


def _on_circle(rim: Array, plane: FittedPlane, tolerance: float) -> Array:
    """Points of a rim, replaced by a regular polygon if a circle fits them (Kasa 1976, trimmed).

    Args:
        rim: (k, 3) points of the rim [m], in the plane.
        plane: Plane of the face.
        tolerance: Largest rms distance [m] of the points from the circle, outliers excepted.

    Returns:
        The corners (`CIRCLE_SIDES`, 3) [m] of the polygon, or `rim` if no circle fits, the points leave a gap
        of more than `MAX_RIM_GAP`, or there are fewer than 12.
    """
    if len(rim) < 12:
        return rim
    origin = rim.mean(axis=0)
    flat = (rim - origin) @ plane.basis.T
    used = np.ones(len(flat), dtype=bool)
    x = y = radius = 0.0
    away, residual = flat, np.zeros(len(flat))
    for _ in range(4):
        kept = flat[used]
        (x, y, c), *_ = np.linalg.lstsq(
            np.column_stack([2 * kept, np.ones(len(kept))]), np.sum(kept**2, axis=1), rcond=None
        )
        radius = float(np.sqrt(max(c + x * x + y * y, 0.0)))
        away = flat - [x, y]
        residual = np.linalg.norm(away, axis=1) - radius
        # Walls are extrapolated over some noise: a few points of the rim lie far off.
        used = np.abs(residual) <= max(3 * 1.48 * float(np.median(np.abs(residual))), 1e-3 * tolerance)
    away, residual = away[used], residual[used]
    if widest_gap(away) > MAX_RIM_GAP or float(np.sqrt(np.mean(residual**2))) > tolerance:
        return rim
    turn = np.arange(CIRCLE_SIDES) * 2 * np.pi / CIRCLE_SIDES
    ring = np.column_stack([x + radius * np.cos(turn), y + radius * np.sin(turn)])
    return origin + ring @ plane.basis
