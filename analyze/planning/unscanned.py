"""Rejection of resting planes and edges that were not scanned.

Where a scan's gap was closed flat, the object's surface is unknown. The cut of a scan looks like a face, and
the hull puts sharp edges round it; neither belongs to the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import BoolArray
from analyze.geometry.scanned_surface import ScannedSurface
from analyze.planning.hypothesis import body_size
from analyze.planning.pivots import PivotAxis
from analyze.planning.stable_planes import RestingPlane
from schemas.strike_plan import Rejection

CODE = "not_scanned"
"""Rejection code of faces and edges that were not scanned."""
MAX_BARE_PLANE = 0.2
"""Largest fraction of a resting plane that may be bare: a hole within it moves no edge."""
MAX_BARE_EDGE = 0.25
"""Largest fraction of the surface along an edge, on either side, that may be bare."""
STRIP_WIDTH = 0.04
"""Width of the strip examined beside an edge, over the body's size."""
TOUCHING_HEIGHT = 0.03
"""Height over a resting plane, over the body's size, up to which the surface belongs to it; a ragged cut is
not flat."""
EDGE_TOUCHING_HEIGHT = 0.01
"""Height over a resting plane, over the body's size, up to which the surface beside an edge belongs to it."""
MAX_DOWN_COSINE, MAX_SIDE_COSINE = -0.7, 0.7
"""Largest cosines between a surface's normal and up at which it faces the table, and at which it is not part
of the upper side."""
MIN_SAMPLES = 4
"""Smallest number of samples of a strip or plane that is judged."""
REMEDY = "scan that side too, or give a primitive (box, cylinder)"
"""Remedy for a rejected face or edge, as a sentence for the user."""


_Part = TypeVar("_Part", RestingPlane, PivotAxis)


def scanned_planes(
    model: ObjectModel, planes: Sequence[RestingPlane]
) -> tuple[list[RestingPlane], list[Rejection]]:
    """Resting planes (faces that the object can stand on) that were scanned, and rejections of the others.

    A plane counts as scanned if at most the fraction `MAX_BARE_PLANE` of it is missing from the scan. If the
    shape is no scan, all planes are kept.

    Args:
        model: Shape of the object, with the parts of the surface that were not scanned.
        planes: Resting planes to check.
    """
    surface = model.scanned
    if surface is None:
        return list(planes), []
    shares = [_plane_share(surface, plane, body_size(model)) for plane in planes]
    text = "of this face was not scanned and is closed flat: where the object ends there is not known"
    return _separated(planes, shares, MAX_BARE_PLANE, text)


def scanned_edges(model: ObjectModel, axes: Sequence[PivotAxis]) -> tuple[list[PivotAxis], list[Rejection]]:
    """Pivot axes whose edges have scanned surface beside them, and rejections of the other axes.

    At most the fraction `MAX_BARE_EDGE` of this surface may be missing on either side of the edge. If the
    shape is no scan, all axes are kept.

    Args:
        model: Shape of the object, with the parts of the surface that were not scanned.
        axes: Pivot axes to check.
    """
    surface = model.scanned
    if surface is None:
        return list(axes), []
    shares = [_edge_share(surface, axis, body_size(model)) for axis in axes]
    text = "of the surface beside this edge was not scanned: the edge is where the scan ends"
    return _separated(axes, shares, MAX_BARE_EDGE, text)


def _separated(
    parts: Sequence[_Part], shares: Sequence[float], most: float, text: str
) -> tuple[list[_Part], list[Rejection]]:
    """Faces or edges that count as scanned, and rejections of the others.

    Args:
        parts: Resting planes or pivot axes.
        shares: Fraction of each that was not scanned.
        most: Largest such fraction of a part that is kept.
        text: Middle part of a rejection's message, between "<fraction> %" and the remedy.

    Returns:
        The parts kept, in their order, and one rejection for each of the others.
    """
    pairs = list(zip(parts, shares, strict=True))
    return [part for part, share in pairs if share <= most], [
        Rejection(axis_id=part.id, code=CODE, number=share, text=f"{100 * share:.0f} % {text}: {REMEDY}")
        for part, share in pairs
        if share > most
    ]


def _plane_share(surface: ScannedSurface, plane: RestingPlane, size: float) -> float:
    """Unscanned fraction of the surface that lies on a resting plane; 0 if it has no samples.

    The rim of the support polygon (convex outline of what stands on the plane) is left out if at least
    `MIN_SAMPLES` samples remain.

    Args:
        surface: Samples of the surface, with a mask of those not scanned.
        plane: Resting plane.
        size: Size of the body [m].
    """
    height = surface.points @ plane.up - plane.level
    touching = (np.abs(height) < TOUCHING_HEIGHT * size) & (surface.normals @ plane.up < MAX_DOWN_COSINE)
    inset = plane.margin(surface.points)
    inner = touching & (inset > surface.reach)
    if inner.sum() < MIN_SAMPLES:
        inner = touching & (inset > 0)
    return float(surface.bare[inner].mean()) if inner.any() else 0.0


def _edge_share(surface: ScannedSurface, axis: PivotAxis, size: float) -> float:
    """Unscanned fraction of the surface beside an edge.

    Two strips along the edge are judged, one in the resting plane and one up the wall; the larger of their
    fractions is returned. A strip with fewer than `MIN_SAMPLES` samples counts as scanned.

    Args:
        surface: Samples of the surface, with a mask of those not scanned.
        axis: Pivot axis at the edge.
        size: Size of the body [m].
    """
    up, tip = axis.plane.up, axis.tip
    first, last = axis.edge
    outer = surface.reach + STRIP_WIDTH * size
    place = surface.points @ axis.direction
    low, high = sorted((float(first @ axis.direction), float(last @ axis.direction)))
    # Near its ends the strip would include the adjoining faces; a rim's tangent has no length of its own.
    spare = max(outer - (high - low), 0.0) / 2 - min(surface.reach, (high - low) / 3)
    height = surface.points @ up - axis.plane.level
    away = np.hypot(height, (surface.points - first) @ tip)
    strip = (place > low - spare) & (place < high + spare) & (away > surface.reach) & (away < outer)
    facing = surface.normals @ up
    below = (np.abs(height) < EDGE_TOUCHING_HEIGHT * size) & (facing < MAX_DOWN_COSINE)
    return max(_share(surface, strip & below), _share(surface, strip & ~below & (facing < MAX_SIDE_COSINE)))


def _share(surface: ScannedSurface, part: BoolArray) -> float:
    """Fraction, by number, of the samples in the mask `part` (n,) that were not scanned.

    It is 0 for fewer than `MIN_SAMPLES` samples. The mask is over the n samples of `surface`.
    """
    return float(surface.bare[part].mean()) if part.sum() >= MIN_SAMPLES else 0.0
