"""Tosses in the virtual world: accuracy of the flight, drag, hand, cushion, bad tosses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from acquire.virtual.air_drag import AIR_KG_M3, AirDrag
from acquire.virtual.objects import load_object
from acquire.virtual.primitive_meshes import box_mesh
from acquire.virtual.station import G_M_S2
from acquire.virtual.toss import TossKind, TossMotion
from acquire.virtual.world import World
from tests.tossed import planned_tosses, toss

HOLD_S = 0.05


def idle(_angle, _rate, _time_ns):
    return 0.0


def flown(thing, motion, seconds):
    """State after a time in the air, and the true start."""
    world = World(thing, idle)
    world.toss(motion, HOLD_S)
    world.step_to(round((HOLD_S + seconds) * 1e9))
    return world.state()


def independent(thing, motion, seconds):
    """Place of c (3,) and rotation after a time, by another integrator (Hairer's DOP853)."""
    body = thing.body
    drag = AirDrag(thing.mesh_vertices, thing.mesh_faces, body.com_object, thing.drag_coefficient)

    def slope(_time, y):
        q, v, w = y[3:7] / np.linalg.norm(y[3:7]), y[7:10], y[10:13]
        R = Rotation.from_quat(q).as_matrix()
        wrench = drag.wrench(R.T @ v, w)
        turn = 0.5 * np.append(q[3] * w + np.cross(q[:3], w), -q[:3] @ w)
        rate = np.linalg.solve(body.inertia_com, wrench[3:] - np.cross(w, body.inertia_com @ w))
        return np.concatenate([v, turn, R @ wrench[:3] / body.mass_kg - [0, 0, G_M_S2], rate])

    start = [*motion.p_world_com, *Rotation.from_matrix(motion.R_world_object).as_quat()]
    found = solve_ivp(
        slope,
        (0, seconds),
        [*start, *motion.velocity_world, *motion.rate_object],
        "DOP853",
        rtol=1e-9,
        atol=1e-11,
    )
    return found.y[:3, -1], Rotation.from_quat(found.y[3:7, -1])


@pytest.mark.parametrize("name", ["carton", "spray", "salt"])
def test_flight_agrees_with_another_integrator(name):
    thing, rng = load_object(name, 3), np.random.default_rng(7)
    axis = rng.normal(size=3)
    motion = TossMotion(
        Rotation.random(random_state=5).as_matrix(),
        np.array([0.0, 1.0, 0.2]),
        np.array([0.1, -0.1, 2.4]),
        2 * np.pi * 4 * axis / np.linalg.norm(axis),
        -3.0,
    )
    state = flown(thing, motion, 0.5)
    com, turned = independent(thing, motion, 0.5)
    R = Rotation.from_quat(np.roll(state.q_world_object_wxyz, -1))
    assert np.linalg.norm(state.p_world_object + R.apply(thing.body.com_object) - com) < 5e-5
    assert np.degrees((turned.inv() * R).magnitude()) < 0.02


def test_drag_of_a_plate_is_that_of_the_formula():
    vertices, faces = box_mesh(np.array([0.05, 0.04, 0.001]))
    drag = AirDrag(vertices, faces, np.zeros(3), 1.1)
    wrench = drag.wrench(np.array([0.0, 0.0, 2.0]), np.zeros(3))
    assert wrench == pytest.approx([0, 0, -0.5 * AIR_KG_M3 * 1.1 * 0.1 * 0.08 * 4.0, 0, 0, 0], abs=1e-12)
    # About its middle a plate of edge a is braked by 1/2 rho Cd b int (w x)^3 on one half of each side;
    # panels of 15 mm have a little less.
    turning = drag.wrench(np.zeros(3), np.array([0.0, 10.0, 0.0]))
    assert turning[4] == pytest.approx(-AIR_KG_M3 * 1.1 * 0.08 * 100 * 0.05**4 / 4, rel=0.07)


def test_a_fine_mesh_has_few_panels_and_the_drag_of_a_coarse_one():
    vertices, faces = box_mesh(np.array([0.04, 0.03, 0.075]))
    fine = vertices[faces]
    for _ in range(5):
        a, b, c = fine[:, 0], fine[:, 1], fine[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        fine = np.concatenate(
            [np.stack(three, axis=1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    few = AirDrag(vertices, faces, np.zeros(3), 1.0)
    many = AirDrag(fine.reshape(-1, 3), np.arange(3 * len(fine)).reshape(-1, 3), np.zeros(3), 1.0)
    assert len(many._factors) < 500
    v, w = np.array([1.0, -0.5, 1.5]), np.array([8.0, 10.0, -5.0])
    assert many.wrench(v, w) == pytest.approx(few.wrench(v, w), rel=0.02, abs=2e-6)


def test_a_hand_holds_still_and_a_cushion_brings_to_rest():
    thing = load_object("carton", 2)
    motion = TossMotion(
        np.eye(3), np.array([0.0, 1.0, 0.1]), np.array([0, 0, 2.0]), np.array([9.0, 6, 9]), 0.0
    )
    world = World(thing, idle)
    world.toss(motion, 0.3)
    world.step_to(290_000_000)
    assert world.at_rest
    assert not world.has_landed
    com = world.state().p_world_object + thing.body.com_object
    assert com == pytest.approx(motion.p_world_com, abs=1e-12)
    world.step_to(400_000_000)
    assert not world.at_rest
    world.step_to(3_000_000_000)
    assert world.has_landed
    assert world.at_rest
    # The next strike finds the table as it was.
    world.place(np.eye(3), np.zeros(3), np.array([-0.04, 0.0, 0.08]))
    world.step_to(3_500_000_000)
    assert world.at_rest
    assert world.state().p_world_object[2] == pytest.approx(0.075, abs=2e-5)


def test_strikes_after_a_toss_are_those_without():
    thing = load_object("carton", 2)
    ends = []
    for tossed in (False, True):
        world = World(thing, idle)
        if tossed:
            world.toss(
                TossMotion(
                    np.eye(3), np.array([0, 1.0, 0.1]), np.array([0, 0, 1.0]), np.array([9.0, 6, 9]), 0.0
                ),
                0.1,
            )
            world.step_to(1_000_000_000)
            world._qpos[7] = -0.5
            world._qvel[6] = 0.0
        start = world.time_ns
        world.place(np.eye(3), np.zeros(3), np.array([-0.04, 0.0, 0.08]))
        world.push(np.array([-0.04, 0.0, 0.14]), np.array([0.02, 0.0, 0.0]), 0.01)
        world.step_to(start + 300_000_000)
        ends.append(world.state())
    assert ends[1].p_world_object == pytest.approx(ends[0].p_world_object, abs=1e-6)
    assert ends[1].q_world_object_wxyz == pytest.approx(ends[0].q_world_object_wxyz, abs=1e-5)


@pytest.fixture(scope="module")
def carton():
    return load_object("carton", 4)


def test_good_tosses_are_within_a_persons_scatter(carton):
    planned = planned_tosses(carton, 1)[0]
    found = [toss(carton, planned, seed) for seed in range(8)]
    turns = [np.linalg.norm(each.motion.rate_object) / (2 * np.pi) for each in found]
    assert 2.3 < min(turns) < max(turns) < 3.7
    flights = [(each.landing_ns - each.release_ns) * 1e-9 for each in found]
    assert 0.33 < min(flights) < max(flights) < 0.52
    axes = np.array([each.motion.rate_object / np.linalg.norm(each.motion.rate_object) for each in found])
    off = np.degrees(np.arccos(axes @ np.array(planned.spin_axis_object)))
    assert 3.0 < np.median(off) < 12.0


@pytest.mark.parametrize("kind", [kind for kind in TossKind if kind is not TossKind.GOOD])
def test_bad_tosses_are_bad_in_their_way(carton, kind):
    found = toss(carton, planned_tosses(carton, 1)[0], 3, kind)
    seconds = (found.landing_ns - found.release_ns) * 1e-9
    rate = found.motion.rate_object
    if kind is TossKind.SLOW:
        assert np.linalg.norm(rate) < 2 * np.pi * 1.2
    if kind in {TossKind.SHORT, TossKind.EARLY}:
        assert 0.1 < seconds < 0.32
    if kind is TossKind.PRINCIPAL:
        principal = np.linalg.eigh(carton.body.inertia_com)[1].T @ rate / np.linalg.norm(rate)
        assert np.degrees(np.arccos(np.abs(principal).max())) < 3.0
    if kind is TossKind.AWAY:
        assert abs(found.states[-1].p_world_object[0]) > 0.5


def test_the_drag_coefficient_is_the_objects(carton):
    motion = TossMotion(
        np.eye(3), np.array([0, 1.0, 0.1]), np.array([0, 0, 2.4]), np.array([9.0, 6, 9]), -3.0
    )
    free = flown(dataclasses.replace(carton, drag_coefficient=0.0), motion, 0.4)
    braked = flown(carton, motion, 0.4)
    R = Rotation.from_quat(np.roll(free.q_world_object_wxyz, -1))
    com = free.p_world_object + R.apply(carton.body.com_object)
    assert com[2] == pytest.approx(0.1 + 2.4 * 0.4 - 0.5 * G_M_S2 * 0.16, abs=1e-6)
    assert 0.005 < np.linalg.norm(braked.p_world_object - free.p_world_object) < 0.03
