"""Large picture of a placement card: object, line, striker and camera, and the tipping direction."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from analyze.cards import ink
from analyze.cards.body import LAMP, draw_body
from analyze.cards.setting import Setting, tip_arc
from analyze.cards.view import View, from_the_front_right
from analyze.types import Array

WIDTH, HEIGHT = 1000.0, 800.0
"""Size of the picture [px]."""
AZIMUTH, ELEVATION = np.radians(30.0), np.radians(20.0)
"""Direction of the eye [rad]: from -y of the world frame W towards +x, and upwards."""
EYE_DISTANCE = 5.0
"""Distance of the eye from the object's middle, in units of the object's size."""
TABLE, SQUARES, SHADOW = "#f5f3ef", "#e7e3dc", "#d6d2ca"
SQUARE_M = 0.05
"""Edge of the squares drawn on the table [m]."""
HOOD = (
    ((8, 9, 10, 11), "#bfe3d8"),
    ((4, 5, 9, 8), "#8ccbb8"),
    ((4, 7, 11, 8), "#7cc0ac"),
    ((7, 6, 10, 11), "#a5d8c9"),
    ((5, 6, 10, 9), "#5faf98"),
)
BOX = (((3, 2, 6, 7), "#1d9375"), ((1, 2, 6, 5), "#006b51"), ((0, 1, 2, 3), ink.CAMERA))
"""Faces of the camera symbol's hood (`HOOD`) and box: indices of corners in `_camera_symbol`, and colour.

They are in drawing order for an eye behind the symbol and to its right."""


def scene_picture(place: Setting) -> str:
    """Picture (an <svg> element) of a strike, as seen by an eye on the camera's side of the object.

    The eye is 30° to the right of the camera's direction and 20° above the horizontal. A strike turned by
    180° is seen from the side opposite the camera.

    Args:
        place: Positions of object, line, striker and camera.
    """
    size = place.size
    middle = (place.low + place.high) / 2
    tail = np.array([place.low[0] - 0.62 * place.reach, place.hit[1], place.strike_height])
    camera = _camera_symbol(place)
    line_ends = np.array(
        [[0.0, place.low[1] - 0.42 * place.reach, 0.0], [0.0, place.high[1] + 0.35 * place.reach, 0.0]]
    )
    arc = tip_arc(place)
    view = from_the_front_right(middle, EYE_DISTANCE * size, float(AZIMUTH), float(ELEVATION))
    ground = tail * np.array([1.0, 1.0, 0.0])
    seen = np.vstack([place.body.corners, [tail, ground], camera.reshape(-1, 3), line_ends, arc])
    view = view.fitted(seen, (165, 60), (WIDTH - 100, HEIGHT - 84))
    parts = [*_table(view, place), *_line(view, place, line_ends)]
    parts += ink.arrow(view.project(np.array([tail, place.hit])), ink.STRIKER, 10)
    parts += draw_body(view, place.body, () if place.tag is None else (place.tag,), ink.CAMERA)
    parts += _pivot(view, place)
    parts += ink.arrow(view.project(arc), ink.PIVOT, 6)
    parts += _striker_near(view, place, tail)
    parts += [] if place.turned else _camera(view, place, camera)
    parts += _labels(view, place, tail, camera, line_ends, arc)
    return ink.picture(WIDTH, HEIGHT, parts, "the object on the table, seen from the camera's side")


def _table(view: View, place: Setting) -> list[str]:
    """SVG elements of the table, with squares of 50 mm, and of the object's shadow on it.

    The squares are parallel to the pivot line; the table fills the picture.
    """
    far = 6 * place.size
    stops = np.arange(np.floor(-far / SQUARE_M), far / SQUARE_M + 1) * SQUARE_M
    rules = [np.array([[x, -far, 0], [x, far, 0]]) for x in stops] + [
        np.array([[-far, y, 0], [far, y, 0]]) for y in stops
    ]
    in_front = [rule for rule in rules if view.nearness(rule).max() < 0.8 * EYE_DISTANCE * place.size]
    corners = place.body.corners
    cast = corners[:, :2] - corners[:, 2:] * LAMP[:2] / LAMP[2] * 0.45
    outline = cast[ConvexHull(cast).vertices]
    shadow = np.column_stack([outline, np.zeros(len(outline))])
    return [
        f'<rect width="{WIDTH:g}" height="{HEIGHT:g}" rx="14" fill="{TABLE}"/>',
        *(
            ink.polyline(seen, SQUARES, 1.2)
            for rule in in_front
            if (seen := ink.cut_line(view.project(rule), WIDTH, HEIGHT)) is not None
        ),
        ink.polygon(view.project(shadow), SHADOW),
    ]


def _line(view: View, place: Setting, ends: Array) -> list[str]:
    """SVG elements of the pivot line (on the table, under the edge) and of the mark on it.

    The mark is the point y = 0 of the line. `ends` (2, 3) are the line's ends [m], in the world frame.
    """
    mark = np.array([[-0.05 * place.size, 0, 0], [0.05 * place.size, 0, 0]])
    return [
        ink.polyline(view.project(ends), ink.PIVOT, 4, "14 9"),
        ink.polyline(view.project(mark), ink.PIVOT, 4),
    ]


def _pivot(view: View, place: Setting) -> list[str]:
    """SVG elements of the pivot edge on the pivot line, or of a disc where a rim touches the line.

    The disc, at the mark on the line, also stands for an edge that was not found. The elements are drawn over
    the object, because the edge's placement matters most.
    """
    if place.edge is None:
        point = view.project(np.zeros((1, 3)))[0]
        return [ink.disc(point, 11, ink.PIVOT, "#fff", 2.5)]
    ends = view.project(np.array([[0.0, place.edge[0], 0.0], [0.0, place.edge[1], 0.0]]))
    return [ink.polyline(ends, "#fff", 13), ink.polyline(ends, ink.PIVOT, 9)]


def _striker_near(view: View, place: Setting, tail: Array) -> list[str]:
    """SVG elements of the striker's motion that are drawn over the object.

    They are a dotted line along the striker's arrow, a ring at the impact point, the path on the table, and
    the height of the strike as a dimension.

    Args:
        view: Projection to the picture.
        place: Positions of object, line, striker and camera.
        tail: (3,) start of the arrow [m], in the world frame.
    """
    hit = view.project(place.hit)[0]
    start = view.project(tail)[0]
    ground = view.project(tail * np.array([1.0, 1.0, 0.0]))[0]
    height = f"{1000 * place.strike_height:.0f} mm"
    under = np.array([tail, place.hit]) * np.array([1.0, 1.0, 0.0])
    return [
        ink.polyline(np.array([start, hit]), ink.STRIKER, 3, "3 8", 0.8),
        ink.disc(hit, 12, "none", ink.STRIKER, 3.5, "5 4"),
        ink.polyline(view.project(under), ink.STRIKER, 1.5, "2 6", 0.7),
        *ink.measure(ground, start, height, 34, ink.STRIKER, -16, "end"),
    ]


def _camera_symbol(place: Setting) -> Array:
    """Corners (12, 3) [m] of the camera symbol: its box (8) and lens hood (4), in the world frame.

    The symbol stands in front of the object, opposite the tag that faces the camera if there is one. Its
    distance is proportional to the object's size, not that of the real camera.
    """
    size = place.reach
    reach = place.low[1] - 0.95 * size
    centre = np.array(
        [
            np.clip(place.camera[0], place.low[0], place.high[0]),
            reach,
            min(place.camera[2], 0.9 * place.high[2]),
        ]
    )
    if place.tag is not None:
        seen = place.body.tag_centre(place.tag)
        if seen is not None:
            centre = np.array([seen[0], reach, max(seen[2], 0.14 * size)])
    half, deep, wide = 0.06 * size, 0.17 * size, 0.085 * size
    box = [
        centre + np.array([x, y, z])
        for y in (-deep, 0.0)
        for x, z in ((-half, -half), (half, -half), (half, half), (-half, half))
    ]
    opening = [
        centre + np.array([x, 1.3 * wide, z])
        for x, z in ((-wide, -wide), (wide, -wide), (wide, wide), (-wide, wide))
    ]
    return np.array([*box, *opening])


def _camera(view: View, place: Setting, camera: Array) -> list[str]:
    """SVG elements of the camera symbol with the `camera` corners (12, 3) [m], and of its line of sight.

    The corners are in the world frame.
    """
    flat = view.project(camera)
    centre = camera[4:8].mean(axis=0)
    target = centre * np.array([1.0, 0.0, 1.0]) + np.array([0.0, place.low[1] - 0.1 * place.size, 0.0])
    return [
        ink.polyline(view.project(np.array([centre, target])), ink.CAMERA, 3, "9 8"),
        *(ink.polygon(flat[list(quad)], tone, ink.CAMERA, 1.5) for quad, tone in HOOD),
        *(ink.polygon(flat[list(quad)], tone, "#fff", 1.2) for quad, tone in BOX),
    ]


def _labels(
    view: View, place: Setting, tail: Array, camera: Array, line_ends: Array, arc: Array
) -> list[str]:
    """SVG elements of the words in the picture: striker, camera and its distance, edge, tipping, tag.

    Args:
        view: Projection to the picture.
        place: Positions of object, line, striker and camera.
        tail: (3,) start of the striker's arrow [m], in the world frame as all positions here.
        camera: (12, 3) corners of the camera symbol [m].
        line_ends: (2, 3) ends of the pivot line [m].
        arc: (n, 3) arc of the tipping arrow [m].
    """
    start, end = view.project(tail)[0], view.project(line_ends)[0]
    curve = view.project(arc)
    beside = curve[len(curve) // 2]
    flat = view.project(camera)
    left, low = float(flat[:, 0].min()), float(flat[:, 1].max())
    side = "seen from opposite the camera" if place.turned else "camera"
    distance = f"{-1000 * place.camera[1]:.0f} mm from the mark"
    edge = "rim on the line" if place.rolls else "this edge on the line"
    parts = [
        ink.text((start[0] + 8, start[1] - 26), "striker", 26, ink.STRIKER, "start"),
        ink.text((left, low + 30), side, 26, ink.CAMERA, "start"),
        *([] if place.turned else [ink.text((left, low + 58), distance, 22, ink.CAMERA, "start")]),
        ink.text((end[0] + 26, end[1] + 6), edge, 26, ink.PIVOT, "start"),
        ink.text((min(beside[0] + 16, WIDTH - 180), beside[1] - 14), "tips this way", 24, ink.PIVOT, "start"),
    ]
    if place.tag is not None:
        marker = next(each for each in place.body.spec.marker if each.name == place.tag)
        if marker.T_object_marker is not None:
            corners = view.project(place.body.tag_corners(marker, 0.66 * marker.size_m))
            below = (float(corners[:, 0].mean()), float(corners[:, 1].max()) + 22)
            parts.append(ink.pill(below, f"tag {place.tag}", 24, ink.CAMERA))
    return parts
