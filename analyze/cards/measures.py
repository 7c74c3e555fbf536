"""Two small dimensioned pictures of a placement card: as seen by the camera, and from above."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from analyze.cards import ink
from analyze.cards.body import draw_body
from analyze.cards.setting import Setting
from analyze.cards.view import View, from_above, from_the_camera
from analyze.types import Array

WIDTH, HEIGHT = 400.0, 390.0
"""Size of a picture [px]."""
NUMBER_PX, NAME_PX = 27, 18
"""Font sizes of numbers and of names [px]."""


def side_picture(place: Setting) -> str:
    """Picture (an <svg> element) of a strike as seen by the camera, with dimensions.

    It shows the height of the strike, the pivot line (on the table, under the edge), and the object at rest
    and tipped to the angle at which it balances. A strike turned by 180° is seen from the side opposite the
    camera.

    Args:
        place: Positions of object, line, striker and camera.
    """
    size = place.size
    tail = np.array([place.low[0] - 0.5 * size, place.hit[1], place.strike_height])
    ground = tail * np.array([1.0, 1.0, 0.0])
    tipped = place.body.tipped(place.tip_angle).corners
    below = np.array([[place.low[0], 0.0, -0.1 * size]])
    seen = np.vstack([place.body.corners, tipped, [tail, ground], below])
    view = from_the_camera().fitted(seen, (76, 46), (WIDTH - 30, HEIGHT - 30))
    start, floor, hit, pivot = view.project(np.array([tail, ground, place.hit, np.zeros(3)]))
    outline = view.project(tipped)
    outline = outline[ConvexHull(outline).vertices]
    parts = [
        ink.polyline(np.array([[20.0, floor[1]], [WIDTH - 16, floor[1]]]), "#b9b4ab", 5),
        ink.polyline(np.vstack([outline, outline[:1]]), ink.PIVOT, 2, "8 7", 0.75),
        *draw_body(view, place.body, () if place.tag is None else (place.tag,), ink.CAMERA),
        *ink.arrow(np.array([start, hit]), ink.STRIKER, 8),
        *ink.measure(floor, start, f"{1000 * place.strike_height:.0f}", NUMBER_PX, ink.STRIKER, -12, "end"),
        *_angle(view, place, pivot),
        ink.text(
            outline[np.argmin(outline[:, 1])] - np.array([0.0, 12.0]),
            f"{np.degrees(place.tip_angle):.0f}°",
            NUMBER_PX,
            ink.PIVOT,
        ),
        ink.disc(pivot, 9, ink.PIVOT, "#fff", 2),
        ink.text((pivot[0], floor[1] + 26), "line", NAME_PX, ink.PIVOT, "middle"),
        ink.text((start[0] + 4, start[1] - 14), "striker", NAME_PX, ink.STRIKER, "start"),
    ]
    return ink.picture(WIDTH, HEIGHT, parts, "as seen by the camera")


def _angle(view: View, place: Setting, pivot: Array) -> list[str]:
    """SVG elements of the balance angle: its two sides from the pivot, and an arc with an arrow head.

    The first side is vertical, the second leans in the direction of tipping.

    Args:
        view: Projection to the picture.
        place: Positions of object, line, striker and camera.
        pivot: (2,) pivot in the picture [px].
    """
    radius = 0.62 * float(place.high[2])
    angles = np.linspace(0.0, place.tip_angle, 20)
    arc = view.project(np.stack([radius * np.sin(angles), np.zeros(20), radius * np.cos(angles)], axis=1))
    leaning = 1.1 * radius * np.array([np.sin(place.tip_angle), 0.0, np.cos(place.tip_angle)])
    ends = view.project(np.array([[0.0, 0.0, 1.1 * radius], leaning]))
    return [
        ink.polyline(np.array([ends[0], pivot, ends[1]]), ink.PIVOT, 1.6),
        *ink.arrow(arc, ink.PIVOT, 3.4),
    ]


def plan_picture(place: Setting) -> str:
    """Picture (an <svg> element) of a strike as seen from above, with dimensions.

    It shows the object, the pivot line (on the table, under the edge about which the object tips), the mark
    on that line, its distance from the edge's near end, the striker's path and, unless the strike is turned
    by 180°, the camera.

    Args:
        place: Positions of object, line, striker and camera.
    """
    size = place.size
    front, back = place.low[1] - 0.5 * place.reach, place.high[1] + 0.15 * size
    left, right = place.low[0] - 0.7 * place.reach, max(place.high[0], 0.0) + 0.55 * size
    reach = np.array([[left, front, 0.0], [right, back, 0.0]])
    view = from_above().fitted(reach, (20, 14), (WIDTH - 20, HEIGHT - 14))
    shift = np.array([max(place.high[0], 0.0) + 0.14 * size, 0.0, 0.0])
    near = np.array([0.0, -place.front_to_mark, 0.0])
    flat = view.project(
        np.array(
            [
                [left, place.hit[1], 0],
                place.hit,
                [0, front, 0],
                [0, back, 0],
                near + shift,
                shift,
                near,
                [right, place.hit[1], 0],
                [0, 0, 0],
            ]
        )
    )
    tail, hit, line_front, line_back, from_, to, end, far, mark = flat
    parts = [
        *draw_body(view, place.body),
        ink.polyline(np.array([line_front, line_back]), ink.PIVOT, 3, "12 8"),
        ink.polyline(np.array([hit, far]), ink.STRIKER, 1.6, "3 7", 0.8),
        *_contact(view, place),
        ink.polyline(np.array([end, from_ + np.array([8.0, 0.0])]), ink.INK, 1.2),
        *ink.measure(from_, to, f"{1000 * place.front_to_mark:.0f}", NUMBER_PX, ink.INK, 14, "start"),
        *ink.arrow(np.array([tail, hit]), ink.STRIKER, 8),
        ink.disc(mark, 5, "#fff", ink.PIVOT, 3),
        ink.text((tail[0], tail[1] - 16), "striker", NAME_PX, ink.STRIKER, "start"),
        *([] if place.turned else _camera_from_above(view, place, front)),
        ink.text((far[0] - 2, far[1] - 8), "mark", NAME_PX, ink.MUTED, "end"),
    ]
    return ink.picture(WIDTH, HEIGHT, parts, "from above")


def _contact(view: View, place: Setting) -> list[str]:
    """SVG element of the pivot edge on the pivot line, or of a disc where a rim touches the line.

    The disc, at the mark of the line (its point y = 0 in the world frame), also stands for an edge that was
    not found.
    """
    if place.edge is None:
        return [ink.disc(view.project(np.zeros((1, 3)))[0], 9, ink.PIVOT, "#fff", 2)]
    ends = view.project(np.array([[0.0, place.edge[0], 0.0], [0.0, place.edge[1], 0.0]]))
    return [ink.polyline(ends, ink.PIVOT, 7)]


def _camera_from_above(view: View, place: Setting, front: float) -> list[str]:
    """SVG elements of a camera symbol that points up in the picture, with the word "camera" beside it.

    Args:
        view: Projection to the picture.
        place: Positions of object, line, striker and camera.
        front: Position of the symbol along the pivot line, y in the world frame [m].
    """
    x = float(np.clip(place.camera[0], place.low[0], place.high[0] + 0.2 * place.size))
    at = view.project(np.array([[x, front, 0.0]]))[0] - np.array([0.0, 4.0])
    body = np.array([[-13, 0], [13, 0], [13, -22], [-13, -22]]) + at
    lens = np.array([[-7, -22], [-15, -36], [15, -36], [7, -22]]) + at
    beside = min(float(at[0]) - 24.0, float(view.project(np.zeros((1, 3)))[0, 0]) - 14.0)
    return [
        ink.polygon(body, ink.CAMERA),
        ink.polygon(lens, "#7cc0ac", ink.CAMERA, 1.5),
        ink.text((beside, float(at[1]) - 4.0), "camera", NAME_PX, ink.CAMERA, "end"),
    ]
