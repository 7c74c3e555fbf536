"""Cans with flat cards on the flank, struck over their round base and seen; for tests and a benchmark.

The motion in the plane of the tip is that of the simulation with friction (sliding.py); to it comes what a
round base allows: the can yaws about its point of contact and rolls along its rim. Nothing of the solver is
used. Not modelled: what yaw and rolling do to the tip, and the flex of a card that stands off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from analyze.geometry.object_model import load_object_model
from analyze.motion.strike import analyse_strike
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.object_markers import unplaced_markers
from analyze.registration.round_body import rim_centre
from analyze.registration.views import strike_view
from schemas.object_spec import Cylinder, MarkerSpec, ObjectSpec, Shape
from schemas.strike_plan import Pivot
from tests.analyze.estimation.bodies import planned_strike
from tests.analyze.motion import sliding
from tests.analyze.motion.tipping import camera as rig_camera
from tests.analyze.registration.tagged_boxes import EDGE_RADIUS, EDGE_SD, SIZE, T0, Draw, about, drawn_track

MAX_OBLIQUE = math.radians(60.0)
"""angle between a tag's normal and the direction to the camera, in the plane of the table, up to which the
tag is seen"""
HAND, YAW = math.radians(3.0), math.radians(2.0)
"""1 sigma of the turn with which a can is put down [rad], and of its yaw and its rolling along the rim [rad
per rad of tipping angle]"""


@dataclass(frozen=True)
class TaggedCan:
    """True size, tags and table of one can."""

    radius: float
    height: float
    spec: ObjectSpec
    T: dict
    """true pose T_object_marker (4, 4) [m] by marker"""
    azimuths: dict
    """direction of each tag about the can's axis [rad]"""
    table: np.ndarray
    """(3,) pose of the table against the recorded W: tilts about x and y [rad], height [m]"""
    camera: object

    @property
    def model(self):
        return load_object_model(self.spec, None, "can")

    @property
    def sizes(self):
        return {marker.name: marker.size_m for marker in self.spec.marker}

    @property
    def thickness(self):
        return {marker.name: marker.thickness_m for marker in self.spec.marker}


def draw_can(rng, azimuths_deg, stands_off=0.0, stated=None, draw=None) -> TaggedCan:
    """Random can with tags at given directions about its axis, each a card that touches the flank.

    `stands_off` [m] is the height of the cards over the flank beyond their thickness, `stated` the thickness
    that the object file gives.
    """
    draw = draw or Draw()
    radius, height = rng.uniform(0.03, 0.04), rng.uniform(0.12, 0.16)
    thickness = 1e-4 + stands_off
    T, markers, azimuths = {}, [], {}
    for number, degrees in enumerate(azimuths_deg):
        angle = math.radians(degrees) + rng.normal(0, math.radians(2.0))
        out = np.array([math.cos(angle), math.sin(angle), 0.0])
        side = np.array([-math.sin(angle), math.cos(angle), 0.0])
        R = np.stack([side, [0.0, 0.0, 1.0], out], axis=-1) @ about([0, 0, 1], rng.uniform(-0.5, 0.5))
        pose = np.eye(4)
        # A card rocks on the line where it touches the flank, and hardly along it.
        rock = about([0, 0, 1], rng.normal(0, math.radians(1.5))) @ about(side, rng.normal(0, draw.card_tilt))
        pose[:3, :3] = rock @ R
        pose[:3, 3] = out * (radius + thickness + rng.normal(0, draw.card))
        pose[:3, 3] += side * rng.normal(0, 5e-4) + np.array(
            [0, 0, rng.uniform(0.015, 0.03) * (1 - 2 * (number % 2))]
        )
        T[number], azimuths[number] = pose, angle
        given = thickness if stated is None else stated
        markers.append(MarkerSpec(id=number, size_m=SIZE, thickness_m=given))
    spec = ObjectSpec(
        name="can",
        mass_kg=0.1,
        mass_sd_kg=1e-4,
        shape=Shape(cylinder=Cylinder(radius_m=radius, height_m=height)),
        edge_radius_m=EDGE_RADIUS,
        marker=markers,
    )
    table = np.array([*rng.normal(0, draw.table_tilt, 2), rng.normal(0, draw.table_height)])
    return TaggedCan(radius, height, spec, T, azimuths, table, rig_camera())


def rim_plan(can, azimuth, number, heading=0.0):
    """Planned strike over the rim of the base, in the direction `azimuth` [rad] about the can's axis."""
    box = SimpleNamespace(
        size=np.array([2 * can.radius, 2 * can.radius, can.height]), edge_radius=EDGE_RADIUS
    )
    strike = planned_strike(box, 2, -1, 1, 1, number)
    tip, along = (
        np.array([math.cos(azimuth), math.sin(azimuth), 0]),
        np.array([-math.sin(azimuth), math.cos(azimuth), 0]),
    )
    R = np.stack([tip, along, [0, 0, 1.0]])
    point = tip * (can.radius - EDGE_RADIUS) + np.array([0, 0, EDGE_RADIUS - can.height / 2])
    pivot = Pivot(point=point.tolist(), direction=along.tolist(), radius_m=EDGE_RADIUS, sd_m=EDGE_SD)
    return strike.model_copy(
        update={
            "id": f"s{number}",
            "axis_id": f"p0t{math.degrees(azimuth):.0f}",
            "R_world_object": R.tolist(),
            "p_world_object": (np.array([0, 0, EDGE_RADIUS]) - R @ point).tolist(),
            "pivot": pivot,
            "rolls": True,
            "heading_rad": heading,
            "phi_predicted_rad": math.atan2(can.radius, can.height / 2),
            "visible_markers": [],
        }
    )


def seen_tips(can, rng, azimuths_deg, draw=None, hand=HAND, yaw=YAW):
    """Views of simulated strikes over the rim, made by the code that a session uses.

    Args:
        can: true can, tags and table.
        rng: generator of all errors.
        azimuths_deg: planned direction of each strike's tip about the can's axis.
        draw: 1 sigma of the errors; None for the defaults of `Draw`.
        hand: 1 sigma of the turn with which the can is put down [rad].
        yaw: 1 sigma of the yaw and of the rolling along the rim, per radian of tipping angle [rad].
    """
    draw, markers, views = draw or Draw(), unplaced_markers(can.spec), []
    for number, degrees in enumerate(azimuths_deg, 1):
        plan = rim_plan(can, math.radians(degrees), number)
        course = _course(can, rng)
        turns = rng.normal(0, hand) + rng.normal(0, yaw) * course.theta
        psi = rng.normal(0, draw.yaw) + rng.normal(0, yaw) * course.theta
        at = rng.normal(0, draw.place, 2)
        tracks = []
        for name in can.T:
            facing = can.azimuths[name] - math.radians(degrees) - turns[0] + math.pi / 2
            if abs((facing + math.pi) % (2 * math.pi) - math.pi) < MAX_OBLIQUE:
                R, p = _poses(can, name, math.radians(degrees), course, turns, psi, at)
                tracks.append(drawn_track(can.camera, name, course, R, p, draw, rng))
        end_ns = T0 + int(course.time[-1] * 1e9)
        motion = analyse_strike(tracks, markers, can.camera, StrikeTask(plan.id, plan, T0, end_ns))
        view = strike_view(tracks, markers, can.camera, plan, motion, rim_centre=rim_centre(can.model, plan))
        if view is not None:
            views.append(view)
    return views


def _course(can, rng):
    """Motion in the plane of a tip over the rim, as of a box of the can's width."""
    a, b = can.radius - EDGE_RADIUS, can.height / 2 - EDGE_RADIUS
    R, phi = math.hypot(a, b), math.atan2(a, b)
    inertia = can.radius**2 / 4 + can.height**2 / 12
    body = sliding.Body(
        R=R, phi=phi, inertia=inertia, rho=EDGE_RADIUS, friction=rng.uniform(0.5, 0.8), height=can.height
    )
    holding = min(0.95 * can.height, (inertia + R * R) / (R * math.cos(phi)))
    push = sliding.push_for(body, rng.uniform(1.1, 1.4), holding)
    course = sliding.simulate(body, [push], seconds=0.6, phase=rng.uniform(0, 1))
    kept = course.theta < 1.2
    return replace(
        course,
        time=course.time[kept],
        theta=course.theta[kept],
        slip=course.slip[kept],
        lift=course.lift[kept],
    )


def _poses(can, name, azimuth, course, turns, psi, at):
    """True rotation (n, 3, 3) and position (n, 3) [m], in the camera frame, of one tag.

    Args:
        can: the can.
        name: the tag.
        azimuth: planned direction of the tip about the can's axis [rad].
        course: motion in the plane of the tip.
        turns: (n,) turn of the can about its own axis against the plan [rad]: as put down, and as it rolls.
        psi: (n,) direction of the tip about the vertical [rad].
        at: (2,) place of the point of contact on the table [m].
    """
    T = can.T[name]
    E = about([1, 0, 0], can.table[0]) @ about([0, 1, 0], can.table[1])
    R_cw = can.camera.T_world_camera[:3, :3].T
    rim = can.radius - EDGE_RADIUS
    lowest = np.array([rim, 0.0, EDGE_RADIUS - can.height / 2])
    Rs, ps = [], []
    for theta, slip, lift, turn, direction in zip(
        course.theta, course.slip, course.lift, turns, psi, strict=True
    ):
        tipped = about([0, 0, 1], direction) @ about([0, 1, 0], theta)
        R = tipped @ about([0, 0, 1], turn - azimuth)
        moved = np.array([slip + EDGE_RADIUS * theta, -rim * (turn - turns[0]), 0.0])
        contact = about([0, 0, 1], direction) @ moved + np.array([*at, EDGE_RADIUS + lift])
        p = R @ T[:3, 3] - tipped @ lowest + contact
        Rs.append(R_cw @ E @ R @ T[:3, :3])
        ps.append(R_cw @ (E @ p + np.array([0, 0, can.table[2]]) - can.camera.T_world_camera[:3, 3]))
    return np.array(Rs), np.array(ps)


def errors_but_turn(can, places):
    """Rotation (n, 3) [rad] and displacement (n, 3) [m] of the places found, the first tag's turn taken off.

    On a can O's direction about the axis is a convention: the first tag found has the true one.
    """
    first = places[0]
    turn = first.T_object_marker[:3, :3] @ can.T[first.marker_id][:3, :3].T
    angle = math.atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    back = about([0, 0, 1], -angle)
    turns, away = [], []
    for place in places:
        truth = can.T[place.marker_id]
        D = back @ place.T_object_marker[:3, :3] @ truth[:3, :3].T
        turns.append(0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]]))
        away.append(back @ place.T_object_marker[:3, 3] - truth[:3, 3])
    return np.array(turns), np.array(away)
