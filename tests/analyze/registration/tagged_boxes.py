"""Boxes with tags stuck on anywhere, placed by hand, struck and seen; for tests and a benchmark.

The benchmark is `make bench-registration`. Motions come from the planar simulation with dry friction of
tests/analyze/motion/sliding.py. Nothing of the solver is used. Drawn at random: places of the tags and how
they lie on their faces, the hand's placements, tilt and height of the table against the recorded
T_world_camera, true places of the edges. Corners are either drawn with noise and a bias that depends on the
place within a pixel, or found in rendered images.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from analyze.geometry.object_model import load_object_model
from analyze.geometry.station import turned_camera
from analyze.motion.strike import analyse_strike
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.object_markers import unplaced_markers
from analyze.registration.views import strike_view
from analyze.tracking.track import track_markers
from analyze.types import ImageFrame, Marker, MarkerTrack
from schemas.object_spec import Box, MarkerSpec, ObjectSpec, Shape
from tests.analyze.estimation.bodies import planned_strike
from tests.analyze.motion import sliding
from tests.analyze.motion.tipping import camera as rig_camera
from tests.analyze.tracking.rendering import corners_of, project, render

T0 = 10**18
SIZE = 0.03
EDGE_SD, EDGE_RADIUS = 5e-5, 1e-3
"""1 sigma of an edge's place, and radius of its rounding [m]"""
CORNER_PX, LOCK_PX = 0.012, 0.015
"""white noise of a corner (1 sigma), and amplitude of a bias that depends on its place within a pixel [px]"""


@dataclass(frozen=True)
class Draw:
    """1 sigma of the errors that are drawn: angles [rad], lengths [m], corners [px]."""

    card: float = 1e-4
    card_tilt: float = math.radians(0.2)
    yaw: float = math.radians(1.0)
    place: float = 1.5e-3
    table_tilt: float = math.radians(0.1)
    table_height: float = 5e-4
    lock_px: float = LOCK_PX
    """amplitude of the corners' bias that depends on the place within a pixel [px]"""
    impact_turn: float = 0.0
    """rotation about the vertical by the impact [rad]"""
    drift: float = 0.0
    """rotation about the vertical while the object tips, per angle of tipping [rad/rad]"""
    wobble: float = 0.0
    """rotation about the vertical from frame to frame [rad]"""
    aside: float = 0.0
    """displacement of the edge along itself from frame to frame [m]"""


ALLOWED = Draw(
    lock_px=0.02 * math.sqrt(2),
    impact_turn=math.radians(0.05),
    drift=math.radians(0.1),
    wobble=math.radians(0.05),
    aside=2e-4,
)
"""all errors that the solver allows for: lens and pixels that are off by 0.02 px, a body that does not quite
turn about its edge"""


@dataclass(frozen=True)
class TaggedBox:
    """True size, tags and table of one box, and its edges that are struck."""

    size: np.ndarray
    spec: ObjectSpec
    T: dict
    """true pose T_object_marker (4, 4) [m] by marker"""
    table: np.ndarray
    """(3,) pose of the table against the recorded W: tilts about x and y [rad], height [m]"""
    edges: tuple
    """edges that are struck, each as (face, sign, along, side)"""
    camera: object

    @property
    def model(self):
        return load_object_model(self.spec, None, "box")

    @property
    def sizes(self):
        return {marker.name: marker.size_m for marker in self.spec.marker}

    @property
    def thickness(self):
        return {marker.name: marker.thickness_m for marker in self.spec.marker}


def about(axis, angle):
    """Rotation (3, 3) about an axis by Rodrigues' formula, independent of the code under test."""
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * K @ K


def draw_box(rng, draw=None, edges=5) -> TaggedBox:
    """Random box of 60 to 200 mm with a tag on each side.

    `edges` is the number of edges that are struck, of those that the camera can watch.
    """
    draw = draw or Draw()
    size = np.array([rng.uniform(0.06, 0.09), rng.uniform(0.055, 0.08), rng.uniform(0.11, 0.19)])
    T, markers = {}, []
    for number in range(6):
        axis, sign = number // 2, 1 if number % 2 == 0 else -1
        normal = np.eye(3)[axis] * sign
        u, v = (np.eye(3)[i] for i in range(3) if i != axis)
        v = v if np.cross(u, v) @ normal > 0 else -v
        spin = rng.uniform(0, 2 * math.pi)
        R = np.stack(
            [math.cos(spin) * u + math.sin(spin) * v, -math.sin(spin) * u + math.cos(spin) * v, normal],
            axis=-1,
        )
        tilt = rng.normal(0, draw.card_tilt, 2)
        room = [max(size[i] / 2 - 0.022, 0.0) for i in range(3) if i != axis]
        thickness = 1e-4
        centre = normal * (size[axis] / 2 + thickness + rng.normal(0, draw.card))
        centre = centre + u * rng.uniform(-1, 1) * room[0] + v * rng.uniform(-1, 1) * min(room[1], 0.03)
        pose = np.eye(4)
        pose[:3, :3] = about(u, tilt[0]) @ about(v, tilt[1]) @ R
        pose[:3, 3] = centre
        T[number] = pose
        markers.append(MarkerSpec(id=number, size_m=SIZE, thickness_m=thickness))
    spec = ObjectSpec(
        name="box",
        mass_kg=0.1,
        mass_sd_kg=1e-4,
        shape=Shape(box=Box(size_m=size.tolist())),
        edge_radius_m=EDGE_RADIUS,
        marker=markers,
    )
    table = np.array([*rng.normal(0, draw.table_tilt, 2), rng.normal(0, draw.table_height)])
    every = [(f, s, a, d) for f in range(3) for s in (-1, 1) for a in range(3) if a != f for d in (-1, 1)]
    box = TaggedBox(size, spec, T, table, (), rig_camera())
    able = [edge for edge in every if math.degrees(_balance(size, edge)) < 48 and _in_view(box, edge)]
    chosen = rng.permutation(len(able))[:edges]
    return replace(box, edges=tuple(able[i] for i in chosen))


def _balance(size, edge):
    face, _, along, _ = edge
    return math.atan2(size[3 - face - along] / 2, size[face] / 2)


def plan_of(size, edge, number=0):
    """Planned strike over an edge; the marker seen in it is that of the side that faces the camera."""
    strike = planned_strike(SimpleNamespace(size=size, edge_radius=EDGE_RADIUS), *edge, number)
    pivot = strike.pivot.model_copy(update={"sd_m": EDGE_SD})
    return strike.model_copy(
        update={"id": f"s{number}", "pivot": pivot, "phi_predicted_rad": _balance(size, edge)}
    )


def facing(plan):
    """Number of the tag on the side that faces the camera."""
    direction = -np.array(plan.pivot.direction) * math.cos(plan.heading_rad)
    axis = int(np.argmax(np.abs(direction)))
    return 2 * axis + (0 if direction[axis] > 0 else 1)


def poses(box, plan, course, yaw=0.0, at=(0.0, 0.0), off_edge=(0.0, 0.0, 0.0), lay=None):
    """True rotation (n, 3, 3) and position (n, 3) [m], in the camera frame, of the tag that faces it.

    `yaw` and `at` are of all frames, or one for each. `lay` is the rotation of the object against the plan
    before it was put down (a wrong placement).
    """
    number = facing(plan)
    T = box.T[number]
    E = about([1, 0, 0], box.table[0]) @ about([0, 1, 0], box.table[1])
    R_cw = box.camera.T_world_camera[:3, :3].T
    lay = np.eye(3) if lay is None else lay
    R_nominal = np.array(plan.R_world_object) @ lay
    on_table = about([0, 0, 1], plan.heading_rad)
    pivot = lay.T @ np.array(plan.pivot.point) + np.array(off_edge)
    Rs, ps = [], []
    yaws, places = np.broadcast_to(yaw, len(course.theta)), np.broadcast_to(at, (len(course.theta), 2))
    for theta, slip, lift, turn, place in zip(
        course.theta, course.slip, course.lift, yaws, places, strict=True
    ):
        R = about([0, 0, 1], turn) @ about([0, 1, 0], theta) @ R_nominal
        edge = about([0, 0, 1], turn) @ np.array([slip + EDGE_RADIUS * theta, 0.0, 0.0])
        edge = edge + np.array([*place, EDGE_RADIUS + lift])
        p = R @ (T[:3, 3] - pivot) + edge
        Rs.append(R_cw @ E @ on_table @ R @ T[:3, :3])
        ps.append(
            R_cw @ (E @ on_table @ p + np.array([0, 0, box.table[2]]) - box.camera.T_world_camera[:3, 3])
        )
    return np.array(Rs), np.array(ps)


def _in_view(box, edge):
    plan = plan_of(box.size, edge)
    turn = np.linspace(0, _balance(box.size, edge) + math.radians(28), 12)
    R, p = poses(box, plan, SimpleNamespace(theta=turn, slip=0 * turn, lift=0 * turn))
    seen = np.array([project(box.camera, corners_of(SIZE) @ a.T + b) for a, b in zip(R, p, strict=True)])
    return bool(
        np.all(seen > 12)
        and np.all(seen[..., 0] < box.camera.width - 12)
        and np.all(seen[..., 1] < box.camera.height - 12)
    )


def strike_course(box, edge, rng):
    """Simulated motion of a box struck over an edge, mostly hard enough to tip over."""
    face, _, along, _ = edge
    a, b = box.size[3 - face - along] / 2 - EDGE_RADIUS, box.size[face] / 2 - EDGE_RADIUS
    R, phi = math.hypot(a, b), math.atan2(a, b)
    height = box.size[face]
    inertia = (box.size[face] ** 2 + box.size[3 - face - along] ** 2) / 12
    body = sliding.Body(
        R=R, phi=phi, inertia=inertia, rho=EDGE_RADIUS, friction=rng.uniform(0.4, 0.8), height=height
    )
    holding = min(0.95 * height, (inertia + R * R) / (R * math.cos(phi)))
    return sliding.simulate(
        body, [sliding.push_for(body, rng.uniform(1.05, 1.4), holding)], seconds=0.7, phase=rng.uniform(0, 1)
    )


def seen_strikes(box, rng, strikes=8, draw=None, rendered=False, wrong=None, section=None, turned=()):
    """Views of simulated strikes for registration, made by the code that a session uses.

    Args:
        box: true box, tags and table.
        rng: generator of all errors.
        strikes: number of strikes, over the box's edges in turn.
        draw: 1 sigma of the errors; None for the defaults of `Draw`.
        rendered: True to find the corners in rendered images, False to draw them.
        wrong: by number of a strike, rotation (3, 3) of the object against its placement card.
        section: section of a curved flank from the shape; None for an edge.
        turned: numbers of the strikes with object and striker turned by 180 degrees on the table.
    """
    draw, markers, views = draw or Draw(), unplaced_markers(box.spec), []
    off = {edge: rng.normal(0, EDGE_SD, 3) for edge in box.edges}
    for number in range(strikes):
        edge = box.edges[number % len(box.edges)]
        plan = plan_of(box.size, edge, number + 1)
        plan = plan.model_copy(update={"heading_rad": math.pi if number in turned else 0.0})
        across = off[edge] - np.array(plan.pivot.direction) * (off[edge] @ np.array(plan.pivot.direction))
        course = strike_course(box, edge, rng)
        if rendered:
            course = _shortened(course)
        lay = (wrong or {}).get(number, np.eye(3))
        yaw, at = rng.normal(0, draw.yaw), rng.normal(0, draw.place, 2)
        R, p = poses(box, plan, course, *_unsteady(yaw, at, course, draw, rng), across, lay)
        plan = plan.model_copy(update={"visible_markers": [facing(plan)]})
        tracks = (
            _rendered(box, plan, course, R, p, rng)
            if rendered
            else [drawn_track(box.camera, facing(plan), course, R, p, draw, rng)]
        )
        time_ns = T0 + int(course.time[-1] * 1e9)
        camera = turned_camera(box.camera, plan.heading_rad)
        motion = analyse_strike(tracks, markers, camera, StrikeTask(plan.id, plan, T0, time_ns))
        view = strike_view(tracks, markers, box.camera, plan, motion, section=section)
        if view is not None:
            views.append(view)
    return views


def _shortened(course):
    """Part of a motion to be rendered: some frames at rest, and none long after the landing."""
    first = int(np.searchsorted(course.time, 0)) - 8
    last = min(
        len(course.time),
        int(np.argmax(course.theta > 1.5)) + 2 if np.any(course.theta > 1.5) else len(course.time),
    )
    kept = slice(first, last)
    return replace(
        course,
        time=course.time[kept],
        theta=course.theta[kept],
        slip=course.slip[kept],
        lift=course.lift[kept],
    )


def _unsteady(yaw, at, course, draw, rng):
    """Heading (n,) [rad] and place (n, 2) [m] in every frame; unchanged if none of their errors is drawn."""
    if not (draw.impact_turn or draw.drift or draw.wobble or draw.aside):
        return yaw, at
    tips = course.theta > 0
    drawn = (
        rng.normal(0, draw.impact_turn)
        + rng.normal(0, draw.drift) * course.theta
        + rng.normal(0, draw.wobble, len(tips))
    )
    return yaw + tips * drawn, at + (tips * rng.normal(0, draw.aside, len(tips)))[:, None] * np.array(
        [0.0, 1.0]
    )


def drawn_track(camera, number, course, R, p, draw, rng):
    """Track of tag `number` at true poses R (n, 3, 3), p (n, 3) [m] in the camera frame; with errors."""
    ideal = np.array([project(camera, corners_of(SIZE) @ a.T + b) for a, b in zip(R, p, strict=True)])
    # A bias that repeats with the pixels, in its own way for every corner.
    lock = draw.lock_px * np.sin(2 * math.pi * (ideal + rng.uniform(0, 1, (4, 2))))
    seen = ideal + lock + rng.normal(0, CORNER_PX, ideal.shape)
    inside = np.all((seen > 2) & (seen < [camera.width - 3, camera.height - 3]), axis=(1, 2))
    stop = int(np.argmin(inside)) if not np.all(inside) else len(seen)
    time_ns = np.rint(course.time * 1e9).astype(np.int64) + T0
    return MarkerTrack(
        number, time_ns[:stop], seen[:stop], np.full(stop, CORNER_PX), R[:stop], p[:stop], len(seen)
    )


def _rendered(box, plan, course, R, p, rng):
    time_ns = np.rint(course.time * 1e9).astype(np.int64) + T0
    frames = (
        ImageFrame(int(time_ns[i]), i, render(box.camera, [(facing(plan), SIZE, R[i], p[i])], rng))
        for i in range(len(time_ns))
    )
    return track_markers(
        frames, box.camera, [Marker(m.name, m.size_m, None) for m in box.spec.marker], [facing(plan)]
    ).tracks


def errors(box, place):
    """Rotation (3,) [rad] and displacement (3,) [m] in O of an estimated MarkerPlace from the true one."""
    truth = box.T[place.marker_id]
    D = place.T_object_marker[:3, :3] @ truth[:3, :3].T
    turn = 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
    return turn, place.T_object_marker[:3, 3] - truth[:3, 3]
