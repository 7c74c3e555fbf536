"""Small drawing of an object with one edge marked, beside the edge's name."""

from __future__ import annotations

import numpy as np

from analyze.cards.body import PlacedObject, draw_body
from analyze.cards.drawn_shape import DrawnShape
from analyze.cards.ink import INK, PIVOT, arrow, disc, picture, polyline, text
from analyze.cards.setting import strike_setting
from analyze.cards.view import from_the_front_right
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import PlannedStrike

SIZE_PX = 150.0
"""width and height of the drawing [px]"""
MARGIN_PX = 14.0
"""free border of the drawing [px]"""
ELEVATION = np.radians(28.0)
"""angle of the eye above the horizontal [rad]"""
FACED = np.radians(35.0)
"""angle of the eye from the side on which the edge is [rad], so that two sides are seen"""
AXIS_PX = 20.0
"""length of the arrows that show the axes of the object file [px]"""


def edge_picture(shape: DrawnShape, spec: ObjectSpec, strike: PlannedStrike, name: str) -> str:
    """SVG element of the object as its file has it, z up, with the pivot edge of a strike marked.

    The eye is on the side of the edge, so that the edge is seen. Arrows show the axes of the object file.

    Args:
        shape: faces and edges to draw.
        spec: object file, with its tags.
        strike: planned strike about the edge.
        name: name of the edge, for screen readers.
    """
    body = PlacedObject(shape, spec, np.eye(3), np.zeros(3))
    view = from_the_front_right(shape.hull.mean(axis=0), 5 * shape.size, _azimuth(strike), ELEVATION)
    view = view.fitted(body.corners, (MARGIN_PX, MARGIN_PX), (SIZE_PX - MARGIN_PX, SIZE_PX - MARGIN_PX - 8))
    ends = view.project(_edge(shape, spec, strike))
    parts = draw_body(view, body)
    if len(ends) > 1:
        parts.append(polyline(ends, PIVOT, 5.5))
    else:
        parts.append(disc(ends[0], 5.0, PIVOT, "#fff", 1.2))
    corner = np.array([AXIS_PX + 4, SIZE_PX - AXIS_PX - 2])
    for axis, seen in zip("xyz", view.axes[:2].T * [1.0, -1.0], strict=True):
        end = corner + AXIS_PX * seen
        parts += arrow(np.stack([corner, end]), INK, 1.3)
        parts.append(text(end + 6 * seen + [0, 3], axis, 10))
    return picture(SIZE_PX, SIZE_PX, parts, f"object with its {name} marked")


def _edge(shape: DrawnShape, spec: ObjectSpec, strike: PlannedStrike) -> Array:
    """Ends (2, 3) [m] of a strike's pivot edge in the object frame; (1, 3) for a rim, its contact."""
    R, p = np.array(strike.R_world_object), np.array(strike.p_world_object)
    edge = strike_setting(PlacedObject(shape, spec, R, p), strike).edge
    ends = [0.0] if edge is None else list(edge)
    return (np.array([[0.0, y, 0.0] for y in ends]) - p) @ R


def _azimuth(strike: PlannedStrike) -> float:
    """Azimuth [rad] of the eye, from -y towards +x: on the side of the object on which the edge is."""
    tip, _, up = np.array(strike.R_world_object)
    outward = tip - up
    if np.hypot(outward[0], outward[1]) < 0.1:
        return FACED
    return float(np.arctan2(outward[0], -outward[1])) + FACED
