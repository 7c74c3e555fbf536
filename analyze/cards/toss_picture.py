"""Pictures of a toss card: the object in the hands with its spin, and the flight seen from the side.

The large picture is drawn in the thrower's frame: x to the right, y away from the thrower (towards the
camera), z up. It is W, the world frame, turned by 180° about z.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import ConvexHull

from analyze.cards import ink
from analyze.cards.body import PlacedObject, draw_body
from analyze.cards.drawn_shape import DrawnShape
from analyze.cards.view import View, from_the_front_right
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import PlannedToss

Place = Callable[[float, float], Array]
"""pixel (2,) of a point given by y and z [m] in W"""
WIDTH, HEIGHT = 1000.0, 800.0
"""size of the large picture [px]"""
SIDE_WIDTH, SIDE_HEIGHT = 760.0, 330.0
"""size of the picture from the side [px]"""
AZIMUTH, ELEVATION = np.radians(22.0), np.radians(16.0)
"""direction of the eye [rad]: from the thrower to the right, and upwards"""
TURNED = np.diag([-1.0, -1.0, 1.0])
"""rotation (3, 3) from W to the thrower's frame"""
GROUND, CUSHION, CUSHION_RIM, PERSON = "#f5f3ef", "#e9c9a8", "#b98a5c", "#c3c9d0"
ARC = np.linspace(np.radians(-60.0), np.radians(215.0), 48)
"""angles of the arrow that shows the spin [rad]"""


def hold_picture(shape: DrawnShape, spec: ObjectSpec, toss: PlannedToss, com: Array, facing: str) -> str:
    """Picture (an <svg> element) of the object as the thrower holds it, with spin axis and direction.

    Args:
        shape: faces and edges to draw.
        spec: object file, with its tags.
        toss: the planned toss.
        com: (3,) expected centre of mass in O [m].
        facing: name of the tag or side that faces the camera.
    """
    R = TURNED @ np.array(toss.R_world_object)
    body = PlacedObject(shape, spec, R, -R @ com)
    axis = R @ np.array(toss.spin_axis_object)
    right = axis if axis[0] > 0 else -axis
    out, back = (_exit(body.corners, sign * right) for sign in (1, -1))
    far = 0.45 * shape.size
    tips = np.array([(out + far) * right, -(back + far) * right])
    arc = _spin_arc((out + 0.45 * far) * right, axis, 0.33 * shape.size)
    view = from_the_front_right(np.zeros(3), 5 * shape.size, float(AZIMUTH), float(ELEVATION))
    view = view.fitted(np.vstack([body.corners, tips, arc]), (90, 130), (WIDTH - 90, HEIGHT - 130))
    ends = view.project(np.array([tips[0], out * right, -back * right, tips[1]]))
    parts = [f'<rect width="{WIDTH:g}" height="{HEIGHT:g}" rx="14" fill="{GROUND}"/>']
    parts += _towards_camera(view)
    parts.append(ink.polyline(ends[2:], ink.RED, 7))
    parts += draw_body(view, body)
    parts.append(ink.polyline(ends[1:3], ink.RED, 3, "4 11", 0.85))
    parts.append(ink.polyline(ends[:2], ink.RED, 7))
    parts += [ink.disc(end, 13, ink.RED, "#fff", 3) for end in ends[1:3]]
    curve = view.project(arc)
    parts += [ink.polyline(curve[:-6], "#fff", 17), *ink.arrow(curve, ink.BLUE, 10)]
    top = curve[int(np.argmin(curve[:, 1]))]
    parts += [
        ink.text((top[0], top[1] - 26), "spin this way", 28, ink.BLUE),
        ink.text((ends[3][0], ends[3][1] - 22), "spin axis", 28, ink.RED),
        ink.text((WIDTH / 2, HEIGHT - 62), "a finger of each hand on each red dot", 28, ink.RED),
        ink.text((WIDTH / 2, HEIGHT - 24), f"as you see it; {facing} faces the camera", 25, ink.MUTED),
    ]
    return ink.picture(WIDTH, HEIGHT, parts, "the object in the hands, with its spin axis and direction")


def side_picture(shape: DrawnShape, spec: ObjectSpec, toss: PlannedToss, com: Array, rise: float) -> str:
    """Picture (an <svg> element) of camera, table, flight and cushion, seen along the table, with sizes.

    Args:
        shape: faces and edges to draw.
        spec: object file, with its tags.
        toss: the planned toss.
        com: (3,) expected centre of mass in O [m].
        rise: rise of the centre of mass [m].
    """
    apex, R = np.array(toss.p_world_apex), np.array(toss.R_world_object)
    reach = float(np.linalg.norm(shape.hull - com, axis=1).max())
    held = apex - [0.0, 0.0, rise]
    floor = float(held[2]) - reach
    edge = min(0.55, float(apex[1]) - reach - 0.08)
    camera = np.array([0.0, -0.42, 0.08])
    person = float(apex[1]) + 0.34
    view = View(np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]), np.zeros(3), None)
    frame = np.array(
        [[0, -0.56, 0.0], [0, person + 0.1, apex[2] + reach + 0.06], [0, 0, min(floor - 0.16, -0.1)]]
    )
    view = view.fitted(frame, (16, 30), (SIDE_WIDTH - 16, SIDE_HEIGHT - 10))

    def at(y: float, z: float) -> Array:
        return view.project(np.array([[0.0, y, z]]))[0]

    parts = [f'<rect width="{SIDE_WIDTH:g}" height="{SIDE_HEIGHT:g}" rx="14" fill="{GROUND}"/>']
    sight = np.array([at(camera[1], camera[2]), at(apex[1], apex[2] + reach), at(apex[1], held[2] - reach)])
    parts.append(f'<g opacity="0.22">{ink.polygon(sight, ink.CAMERA)}</g>')
    parts.append(
        ink.polygon(np.array([at(-0.5, 0), at(edge, 0), at(edge, -0.025), at(-0.5, -0.025)]), "#d6d2ca")
    )
    parts += _person(at, person, held, reach)
    parts.append(_cushion(at, float(apex[1]), floor, reach))
    ghost = PlacedObject(shape, spec, R, apex - R @ com)
    parts.append(f'<g opacity="0.45">{"".join(draw_body(view, ghost))}</g>')
    parts += draw_body(view, PlacedObject(shape, spec, R, held - R @ com))
    lens = at(camera[1], camera[2])
    parts += [
        ink.polygon(lens + np.array([[-46, -15], [0, -15], [0, 15], [-46, 15]]), ink.CAMERA),
        ink.polygon(lens + np.array([[0, -8], [14, -15], [14, 15], [0, 8]]), ink.CAMERA),
        ink.text(lens + np.array([-46, -26]), "camera", 21, ink.CAMERA, "start"),
        ink.disc(at(0.0, 0.0), 6, ink.PIVOT, "#fff", 1.5),
        ink.text(at(0.0, 0.0) + np.array([0, -14]), "line", 19, ink.PIVOT),
    ]
    low = at(0.0, -0.025)[1] + 36
    ends = np.array([[at(0.0, 0)[0], low], [at(apex[1], 0)[0], low]])
    parts += ink.measure(ends[0], ends[1], f"{1000 * apex[1]:.0f} mm", 22, ink.PIVOT, 20)
    beside = float(apex[1]) - reach - 0.05
    up = np.array([at(beside, held[2]), at(beside, apex[2])])
    parts += ink.arrow(up, ink.BLUE, 5)
    parts.append(ink.text(up.mean(axis=0) - np.array([12, -7]), f"{1000 * rise:.0f} mm", 22, ink.BLUE, "end"))
    return ink.picture(SIDE_WIDTH, SIDE_HEIGHT, parts, "camera, table, flight and cushion seen from the side")


def _exit(corners: Array, direction: Array) -> float:
    """Distance [m] from the origin to the hull of corners (n, 3) along a unit vector (3,)."""
    planes = ConvexHull(corners).equations
    along = planes[:, :3] @ direction
    ahead = along > 1e-9
    return float((-planes[ahead, 3] / along[ahead]).min())


def _spin_arc(centre: Array, axis: Array, radius: float) -> Array:
    """Points (n, 3) [m] of an arc about an axis, in the direction of a turn by the right-hand rule."""
    up = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
    up /= np.linalg.norm(up)
    beside = np.cross(axis, up)
    return centre + radius * (np.cos(ARC)[:, None] * up + np.sin(ARC)[:, None] * beside)


def _towards_camera(view: View) -> list[str]:
    """SVG elements of an arrow in the corner of the picture, which points to the camera."""
    along = view.axes[:2] @ np.array([0.0, 1.0, 0.0]) * [1.0, -1.0]
    start = np.array([150.0, 140.0])
    ends = np.array([start, start + 80 * along / np.linalg.norm(along)])
    return [
        *ink.arrow(ends, ink.CAMERA, 8),
        ink.text(start + np.array([0.0, 38.0]), "to the camera", 26, ink.CAMERA),
    ]


def _cushion(at: Place, y: float, top: float, reach: float) -> str:
    """SVG element of the cushion under the flight."""
    left, right = at(y - 1.5 * reach, top), at(y + 1.5 * reach, top - 0.09)
    wide, high = right - left
    return (
        f'<rect x="{left[0]:.1f}" y="{left[1]:.1f}" width="{wide:.1f}" height="{high:.1f}" '
        f'rx="{high / 2.2:.1f}" fill="{CUSHION}" stroke="{CUSHION_RIM}" stroke-width="2"/>'
    )


def _person(at: Place, y: float, held: Array, reach: float) -> list[str]:
    """SVG elements of the thrower, whose arms reach to the object."""
    head, neck, hip = at(y, 0.42), at(y, 0.33), at(y + 0.03, -0.2)
    hand = at(float(held[1]) + 0.6 * reach, float(held[2]))
    elbow = at(y - 0.06, float(held[2]) - 0.02)
    return [
        ink.polyline(np.array([neck, hip]), PERSON, 46),
        ink.polyline(np.array([neck + np.array([0.0, 20.0]), elbow, hand]), PERSON, 18),
        ink.disc(head, 30, PERSON),
        ink.text(hip + np.array([0, 10]), "you", 21, ink.MUTED),
    ]
