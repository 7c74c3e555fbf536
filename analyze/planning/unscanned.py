"""Planes to rest on and edges to turn over that were not scanned: where a scan's gap was closed flat, nobody knows where the object ends.

The cut of a scan looks like a face, and the hull puts sharp edges round it; neither is the object's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.polyhedron import BoolArray
from analyze.geometry.scanned_surface import ScannedSurface
from analyze.planning.hypothesis import body_size
from analyze.planning.pivots import PivotAxis
from analyze.planning.stable_planes import RestingPlane
from analyze.types import Array
from schemas.strike_plan import Rejection

CODE = "not_scanned"
MOST_OF_PLANE = 0.2
"""part of a resting plane that may be bare: a hole within it moves no edge"""
MOST_OF_EDGE = 0.25
"""part of the surface along an edge, on either side, that may be bare"""
BESIDE = 0.04
"""part of the body's size: width of the strip beside an edge that is looked at"""
TOUCHES = 0.03
"""part of the body's size up to which over a resting plane the surface counts as part of it; a ragged cut is not flat"""
IN_PLANE = 0.01
"""the same beside an edge"""
DOWN, SIDEWAYS = -0.7, 0.7
"""cosine between a normal and up: below `DOWN` it faces the table, above `SIDEWAYS` it is the object's upper side"""
FEWEST = 4
"""samples from which a part is judged"""
REMEDY = "scan that side too, or give a primitive (box, cylinder)"


def on_scanned_planes(model: ObjectModel, planes: Sequence[RestingPlane]) -> tuple[tuple[RestingPlane, ...], list[Rejection]]:
    """Those of `planes` that were scanned, and why the others are not planned with."""
    surface = model.scanned
    if surface is None:
        return tuple(planes), []
    kept: list[RestingPlane] = []
    rejected: list[Rejection] = []
    for plane in planes:
        share = _plane_share(surface, plane, body_size(model))
        if share <= MOST_OF_PLANE:
            kept.append(plane)
            continue
        text = f"{100 * share:.0f} % of this face was not scanned and is closed flat: where the object ends there is not known: {REMEDY}"
        rejected.append(Rejection(axis_id=plane.id, code=CODE, number=share, text=text))
    return tuple(kept), rejected


def on_scanned_edges(model: ObjectModel, axes: Sequence[PivotAxis]) -> tuple[list[PivotAxis], list[Rejection]]:
    """Those of `axes` beside which the surface was scanned, and why the others are not planned with."""
    surface = model.scanned
    if surface is None:
        return list(axes), []
    kept: list[PivotAxis] = []
    rejected: list[Rejection] = []
    for axis in axes:
        share = _edge_share(surface, axis, body_size(model))
        if share <= MOST_OF_EDGE:
            kept.append(axis)
            continue
        text = f"{100 * share:.0f} % of the surface beside this edge was not scanned: the edge is where the scan ends: {REMEDY}"
        rejected.append(Rejection(axis_id=axis.id, code=CODE, number=share, text=text))
    return kept, rejected


def _plane_share(surface: ScannedSurface, plane: RestingPlane, size: float) -> float:
    """Part of the surface that touches `plane` within its polygon that is bare; its border, which counts as seen, aside where it can be."""
    height = surface.points @ plane.up - plane.level
    touching = (np.abs(height) < TOUCHES * size) & (surface.normals @ plane.up < DOWN)
    start, _ = plane.edges
    out = plane.outward()
    inset = np.min(np.einsum("ki,ki->k", start, out) - surface.points @ out.T, axis=1)
    inner = touching & (inset > surface.reach)
    if inner.sum() < FEWEST:
        inner = touching & (inset > 0)
    return float(surface.bare[inner].mean()) if inner.any() else 0.0


def _edge_share(surface: ScannedSurface, axis: PivotAxis, size: float) -> float:
    """Bare part of the strip along the edge, in the resting plane or up the wall, whichever is more."""
    up, tip = axis.plane.up, axis.tip
    first, last = _edge(axis)
    outer = surface.reach + BESIDE * size
    place = surface.points @ axis.direction
    low, high = sorted((float(first @ axis.direction), float(last @ axis.direction)))
    # The ends lie near what was seen of the next faces; a rim's tangent has no length of its own.
    spare = max(outer - (high - low), 0.0) / 2 - min(surface.reach, (high - low) / 3)
    height = surface.points @ up - axis.plane.level
    away = np.hypot(height, (surface.points - first) @ tip)
    strip = (place > low - spare) & (place < high + spare) & (away > surface.reach) & (away < outer)
    facing = surface.normals @ up
    below = (np.abs(height) < IN_PLANE * size) & (facing < DOWN)
    return max(_share(surface, strip & below), _share(surface, strip & ~below & (facing < SIDEWAYS)))


def _edge(axis: PivotAxis) -> tuple[Array, Array]:
    """Ends (3,) of the polygon's edge that `axis` turns over; of a round rim the corner twice."""
    if axis.rolls:
        corner = axis.plane.polygon[int(np.argmax(axis.plane.polygon @ axis.tip))]
        return corner, corner
    start, end = axis.plane.edges
    edge = int(np.argmax(axis.plane.outward() @ axis.tip))
    return start[edge], end[edge]


def _share(surface: ScannedSurface, part: BoolArray) -> float:
    return float(surface.bare[part].mean()) if part.sum() >= FEWEST else 0.0
