"""Small drawing of an object with one edge marked, beside the edge's name."""

from __future__ import annotations

import numpy as np

from analyze.cards.body import PlacedObject, draw_body
from analyze.cards.drawn_shape import DrawnShape
from analyze.cards.ink import INK, PIVOT, arrow, disc, picture, polyline, text
from analyze.cards.setting import pivot_edge
from analyze.cards.view import from_the_front_right
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import PlannedStrike

WIDTH_PX, HEIGHT_PX = 176.0, 150.0
"""width and height of the drawing [px]"""
BODY_FRAME = (58.0, 10.0), (168.0, 140.0)
"""upper left and lower right corner [px] of the frame of the object, right of the arrows"""
ELEVATION = np.radians(28.0)
"""angle of the eye above the horizontal [rad]"""
FACED = np.radians(35.0)
"""angle of the eye from the side on which the edge is [rad], so that two sides are seen"""
AXIS_PX = 20.0
"""length of the arrows that show the axes of the object file [px]"""
ORIGIN_PX = (31.0, 116.0)
"""place from which the arrows start [px]"""


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
    view = view.fitted(body.corners, *BODY_FRAME)
    ends = view.project(_edge(shape, spec, strike))
    parts = draw_body(view, body)
    if len(ends) > 1:
        parts.append(polyline(ends, PIVOT, 5.5))
    else:
        parts.append(disc(ends[0], 5.0, PIVOT, "#fff", 1.2))
    start = np.array(ORIGIN_PX)
    parts.append('<g class="axes">')
    for axis, seen in zip("xyz", view.axes[:2].T * [1.0, -1.0], strict=True):
        end = start + AXIS_PX * seen
        parts += arrow(np.stack([start, end]), INK, 1.3)
        # An arrow to or from the eye is short, and behind or before that of z: its name is beside it.
        beside = axis != "z" and abs(seen[0]) < 0.3
        middle = end + (np.array([-8.0, 0.0]) if beside else 6 * seen)
        parts.append(text((middle[0], middle[1] + 3), axis, 10))
    parts.append("</g>")
    return picture(WIDTH_PX, HEIGHT_PX, parts, f"object with its {name} marked")


def _edge(shape: DrawnShape, spec: ObjectSpec, strike: PlannedStrike) -> Array:
    """Ends (2, 3) [m] of a strike's pivot edge in the object frame; (1, 3) for a rim, its contact."""
    R, p = np.array(strike.R_world_object), np.array(strike.p_world_object)
    edge = pivot_edge(PlacedObject(shape, spec, R, p), strike)
    ends = [0.0] if edge is None else list(edge)
    return (np.array([[0.0, y, 0.0] for y in ends]) - p) @ R


def _azimuth(strike: PlannedStrike) -> float:
    """Azimuth [rad] of the eye, from -y towards +x, that shows the object from the side of its pivot edge.

    The eye is straight before an edge that is upright in the object file, and turned by `FACED` (35 degrees)
    to the side of any other edge. If the edge is on no side of the object, the azimuth is `FACED`.
    """
    tip, _, up = np.array(strike.R_world_object)
    outward = tip - up
    if np.hypot(outward[0], outward[1]) < 0.1:
        return FACED
    beside = 0.0 if abs(outward[2]) < 0.1 else FACED
    return float(np.arctan2(outward[0], -outward[1])) + beside
