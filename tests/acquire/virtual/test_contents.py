"""Contents that move in virtual objects: rest, momentum, energy, sloshing, friction, files."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from acquire.demo import DemoPlan
from acquire.errors import ConfigError
from acquire.virtual.devices import DeviceOptions, prepare_devices
from acquire.virtual.filled_object import with_contents
from acquire.virtual.given_contents import ContentsKind, GivenContents, parse_contents
from acquire.virtual.given_truth import read_given_truth
from acquire.virtual.moving_contents import MovingContents
from acquire.virtual.object_archive import open_object, save_object
from acquire.virtual.objects import VirtualObject, load_object
from acquire.virtual.sloshing import first_mode
from acquire.virtual.station import G_M_S2
from acquire.virtual.world import World
from acquire.virtual.world_model import model_xml
from tests.benchmarks.contents.moving import level_path

MS = 1_000_000
WALL = 0.0025
"""thickness of the carton's walls [m]"""
DOWN = np.array([0.0, 0.0, -1.0])


@cache
def filled(text: str, name: str = "carton") -> VirtualObject:
    return with_contents(load_object(name, 1), parse_contents(text))


def damped(thing: VirtualObject, rate: float) -> VirtualObject:
    assert thing.contents is not None
    return replace(thing, contents=replace(thing.contents, damping_per_s=rate))


class Held:
    """Container that is held, or floats freely, with its contents."""

    def __init__(self, thing: VirtualObject, *, gravity: bool = True, free: bool = False) -> None:
        pull = np.array([0.0, 0.0, -G_M_S2 if gravity else 0.0])
        text = model_xml(thing, pull)
        if not free:
            text = text.replace('<freejoint name="object"/>', "")
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.inside = MovingContents(thing.contents, self.model, self.data)
        first = self.model.joint("contents_x")
        self.place = slice(int(first.qposadr[0]), int(first.qposadr[0]) + 3)
        self.speed = slice(int(first.dofadr[0]), int(first.dofadr[0]) + 3)

    def run(self, seconds: float) -> np.ndarray:
        """Places (n, 3) of the moving mass, one a millisecond."""
        rows = []
        for _ in range(round(1e3 * seconds)):
            self.inside.step(5)
            rows.append(self.data.qpos[self.place].copy())
        return np.array(rows)


def test_a_level_liquid_has_its_centroid_where_the_plane_theory_has_it():
    contents = filled("liquid:0.2:0.4").contents
    assert contents is not None
    width, height = 0.08 - 2 * WALL, 0.15 - 2 * WALL
    path = level_path(width, height, 0.4)
    for number in (20, 23, 26, 29):
        slope = path.parameter[number]
        across, up = path.places[number]
        found = contents.lowest(np.array([math.sin(slope), 0.0, -math.cos(slope)]))
        assert found[[0, 2]] == pytest.approx([across, up - height / 2], abs=4e-4)


@pytest.mark.parametrize("text", ["liquid:0.2:0.5", "powder:0.2:30", "lump:0.2:0.2"])
@pytest.mark.parametrize("name", ["carton", pytest.param("juice", marks=pytest.mark.slow)])
def test_contents_rest_where_the_object_is_set_down(text, name):
    thing = filled(text, name)
    world = World(thing, lambda angle, rate, _: -0.2 * (angle + 1.2) - 0.02 * rate, arm_angle=-1.2)
    world.step_to(500 * MS)
    assert world.at_rest
    assert world.state().linear_velocity == pytest.approx(np.zeros(3), abs=1e-9)
    assert thing.body.mass_kg == pytest.approx(load_object(name, 1).body.mass_kg)
    assert thing.rigid_body.mass_kg == pytest.approx(0.8 * thing.body.mass_kg)
    assert thing.body.com_object[2] < load_object(name, 1).body.com_object[2]


@pytest.mark.parametrize("name", ["carton", pytest.param("juice", marks=pytest.mark.slow)])
def test_a_liquid_swings_with_the_period_of_its_first_mode(name):
    held = Held(damped(filled("liquid:0.2:0.5", name), 0.0))
    held.inside.settle(np.eye(3))
    held.data.qvel[held.speed] = [0.03, 0.0, 0.0]
    x = held.run(0.8)[:, 0]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(x))))
    found = 2 * np.mean(np.diff(turns)) * 1e-3
    thing = load_object(name, 1)
    width = float(np.ptp(thing.hull_vertices[:, 0])) - 2 * WALL
    depth = 0.5 * (float(np.ptp(thing.hull_vertices[:, 2])) - 2 * WALL)
    expected = 2 * math.pi * math.sqrt(first_mode(width, depth).length / G_M_S2)
    assert found == pytest.approx(expected, rel=0.12)


def test_without_friction_energy_stays_and_damping_takes_it():
    swings = []
    for rate in (0.0, 4.0):
        held = Held(damped(filled("liquid:0.2:0.5"), rate))
        held.inside.settle(np.eye(3))
        held.data.qvel[held.speed] = [0.05, 0.0, 0.0]
        x = np.abs(held.run(1.2)[:, 0])
        swings.append((x[:300].max(), x[-300:].max()))
    (begun, ended), (_, later) = swings
    assert ended == pytest.approx(begun, rel=0.03)
    # Amplitudes fall by exp(-damping t / 2).
    assert later < 0.25 * begun


@pytest.mark.parametrize("text", ["liquid:0.3:0.5", "lump:0.3:0.02"])
def test_a_container_that_floats_keeps_its_momentum(text):
    held = Held(filled(text), gravity=False, free=True)
    held.model.opt.gravity[:] = [0.0, 0.0, -G_M_S2]
    held.inside.settle(np.eye(3))
    held.model.opt.gravity[:] = 0.0
    held.data.qpos[2] = 1.0
    held.data.qpos[held.model.joint("arm").qposadr[0]] = -1.5
    held.data.qvel[:6] = [0.1, -0.2, 0.3, 5.0, 3.0, -4.0]
    held.model.body("arm").pos[:] = [9.0, 0.0, 0.0]
    root = held.model.body("object").id

    def momentum() -> np.ndarray:
        mujoco.mj_forward(held.model, held.data)
        mujoco.mj_subtreeVel(held.model, held.data)
        mass = held.model.body_subtreemass[root]
        linear = mass * held.data.subtree_linvel[root]
        turning = held.data.subtree_angmom[root]
        return np.concatenate([linear, turning])

    before = momentum()
    places = held.run(0.3)
    after = momentum()
    assert np.ptp(places, axis=0).max() > 1e-3
    assert after[:3] == pytest.approx(before[:3], abs=1e-3 * float(np.linalg.norm(before[:3])))
    assert after[3:] == pytest.approx(before[3:], abs=2e-3 * float(np.linalg.norm(before[3:])))


@pytest.mark.parametrize(("text", "angle", "slides"), [
    ("powder:0.2:30", 22, False),
    ("powder:0.2:30", 38, True),
    ("lump:0.1:0.3", 12, False),
    ("lump:0.1:0.3", 22, True),
])  # fmt: skip
def test_friction_holds_up_to_its_angle(text, angle, slides):
    held = Held(filled(text))
    held.inside.settle(np.eye(3))
    start = held.data.qpos[held.place].copy()
    turn = Rotation.from_rotvec([0.0, np.radians(angle), 0.0]).as_matrix()
    held.model.opt.gravity[:] = turn.T @ [0.0, 0.0, -G_M_S2]
    moved = float(np.linalg.norm(held.run(0.3)[-1] - start))
    assert (moved > 5e-3) is slides
    assert slides or moved < 1e-3


def test_contents_change_the_tip_and_the_same_seed_repeats_it():
    def largest(thing: VirtualObject) -> float:
        world = World(thing, lambda *_: 0.0, arm_angle=-2.5)
        world.place(np.eye(3), np.array([0.0, 0.0, 0.075]), np.array([-0.5, 0.0, 0.3]))
        world.step_to(600 * MS)
        world.push(np.array([-0.04, 0.0, 0.12]), np.array([0.0115, 0.0, 0.0]), 0.003)
        angles = []
        while world.time_ns < 1000 * MS:
            world.step_to(world.time_ns + 5 * MS)
            angles.append(2 * math.asin(abs(world.state().q_world_object_wxyz[2])))
        return max(angles)

    lump = filled("lump:0.2:0.1")
    rigid = replace(lump, contents=None)
    assert largest(lump) == largest(lump)
    assert abs(largest(lump) - largest(rigid)) > math.radians(0.05)


def test_an_archive_keeps_the_contents(tmp_path):
    thing = filled("liquid:0.2:0.5")
    save_object(thing, tmp_path / "object.npz")
    found = open_object(str(tmp_path / "object.npz"), 1)
    assert found.contents is not None
    assert thing.contents is not None
    assert found.contents.lowest(DOWN) == pytest.approx(thing.contents.lowest(DOWN))
    assert found.rigid_body.mass_kg == thing.rigid_body.mass_kg
    assert found.contents.moving_part(DOWN).share == thing.contents.moving_part(DOWN).share


def test_a_rig_has_the_contents_and_the_table_that_its_options_give(tmp_path):
    given = DeviceOptions("carton", 1, "127.0.0.1", contents=parse_contents("liquid:0.2:0.5"), friction=0.3)
    devices = prepare_devices(given, tmp_path)
    found = open_object(str(tmp_path / "virtual-object.npz"), 1)
    assert found.contents is not None
    assert (found.friction, devices.virtual_object.friction) == (0.3, 0.3)
    assert "--contents" in DemoPlan().arguments(contents=True)
    assert "--contents" not in DemoPlan().arguments(contents=False)


def test_a_truth_file_states_contents(tmp_path):
    (tmp_path / "truth.toml").write_text('[truth.contents]\nkind = "lump"\nshare = 0.1\nfriction = 0.15\n')
    given = read_given_truth(tmp_path / "truth.toml").contents
    assert given is not None
    assert (given.kind, given.share, given.lump_friction) == (ContentsKind.LUMP, 0.1, 0.15)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("water:0.2", "give KIND:SHARE"),
        ("liquid", "give KIND:SHARE"),
        ("liquid:x", "give KIND:SHARE"),
        ("liquid:0.99", "share"),
        ("lump:0.1:3", "friction"),
    ],
)
def test_other_texts_are_refused(text, said):
    with pytest.raises(ConfigError, match=said):
        parse_contents(text)


def test_contents_that_do_not_fit_are_refused():
    thing = load_object("carton", 1)
    lump = GivenContents(kind=ContentsKind.LUMP, share=0.1, size_m=0.1)
    with pytest.raises(ConfigError, match="a lump of 100 mm does not fit"):
        with_contents(thing, lump)
    heavy = replace(thing, body=replace(thing.body, mass_kg=4.0))
    with pytest.raises(ConfigError, match=r"800 g of liquid fill \d+\.\d % of the cavity"):
        with_contents(heavy, GivenContents(kind=ContentsKind.LIQUID, share=0.2))
