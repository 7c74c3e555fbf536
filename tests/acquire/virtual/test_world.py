"""Simulated world: tips compared with theory (docs/explanation/method.md, section 3), rest, strikes.

The formulas here are independent of the simulator's.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from acquire.errors import AcquireError
from acquire.virtual import world as world_module
from acquire.virtual.objects import load_object
from acquire.virtual.station import ARM_INERTIA_KG_M2
from acquire.virtual.world import World

G = 9.81
UPRIGHT = np.eye(3)
ON_SIDE_X = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""rotation (3, 3) from O to W of an object whose O's x points up, and whose z lies along W's y"""


def parked(position, velocity, _time_ns):
    return -1.0 * (position + 0.8) - 0.05 * velocity


@dataclass
class Tip:
    """One simulated tip about the world's +y axis: true pendulum parameters, angle over time, states."""

    phi: float
    k: float
    gain: float
    """potential energy gained by c up to the balance, m g (h2 - h1) [J]"""
    energy: float
    """potential energy of c at the balance, m g (R + rho) [J]"""
    time: np.ndarray
    theta: np.ndarray
    states: list
    edge_path: np.ndarray
    """(n, 3) path of the edge's centre line in W [m]"""


def object_of(name, friction, seed=1):
    return dataclasses.replace(load_object(name, seed), friction=friction)


def place(world, thing, R, height=None):
    corners = thing.hull_vertices @ R.T
    low = corners.min(axis=0)
    world.place(R, np.array([0.0, 0.0, -low[2]]), np.array([low[0], 0.0, height or -low[2]]))
    base = corners[np.abs(corners[:, 2] - low[2]) < 1e-6]
    rho = thing.edge_radius_m
    return np.array([base[:, 0].max() - rho, 0.0, low[2] + rho])


def tip(thing, R=UPRIGHT, energy_ratio=1.1, seconds=1.0):
    """Simulate a tip of a resting object whose initial velocity corresponds to `energy_ratio`.

    The ratio is kinetic energy over the energy needed to reach balance.
    """
    states = []
    world = World(thing, parked, on_tick=states.append)
    edge = place(world, thing, R)
    world.step_to(300_000_000)
    assert world.at_rest
    body, rho = thing.body, thing.edge_radius_m
    arm = R @ body.com_object - edge
    reach, phi = np.hypot(arm[0], arm[2]), np.arctan2(-arm[0], arm[2])
    inertia = (R @ body.inertia_com @ R.T)[1, 1]
    k = body.mass_kg * G * reach / (inertia + body.mass_kg * (reach + rho) ** 2)
    h1 = rho + reach * np.cos(phi)
    gain = body.mass_kg * G * (reach + rho - h1)
    omega = np.sqrt(2 * energy_ratio * gain / (inertia + body.mass_kg * (h1**2 + arm[0] ** 2)))
    start = world.state()
    data = world._data
    data.qvel[0:3] = np.cross([0, omega, 0], start.p_world_object - [edge[0], 0.0, 0.0])
    data.qvel[3:6] = R.T @ [0, omega, 0]
    world._at_rest = False
    states.clear()
    world.step_to(world.time_ns + round(seconds * 1e9))
    turns = [rotation_of(state) for state in states]
    theta = np.array([np.arctan2((A @ R.T)[0, 2], (A @ R.T)[2, 2]) for A in turns])
    path = np.array([state.p_world_object + A @ R.T @ edge for state, A in zip(states, turns, strict=True)])
    time = np.array([state.time_ns for state in states]) * 1e-9
    end = int(np.argmax(theta > phi + 0.35)) or len(theta)
    return Tip(
        phi, k, gain, body.mass_kg * G * (reach + rho), time[3:end], theta[3:end], states[3:end], path[3:end]
    )


def rotation_of(state):
    w, x, y, z = state.q_world_object_wxyz
    return Rotation.from_quat([x, y, z, w]).as_matrix()


def fitted(tip):
    """Balance angle phi [rad] and rate k [1/s^2] of theta'' = -k sin(phi - theta), fitted to a tip."""
    t, theta = tip.time[::5], tip.theta[::5]

    def residual(p):
        solution = solve_ivp(
            lambda _t, y: [y[1], -p[1] * np.sin(p[0] - y[0])],
            (t[0], t[-1]),
            p[2:4],
            t_eval=t,
            rtol=1e-8,
            atol=1e-10,
        )
        return solution.y[0] - theta

    rate = (theta[1] - theta[0]) / (t[1] - t[0])
    return least_squares(residual, [tip.phi, tip.k, theta[0], rate], x_scale=[0.1, 10, 0.01, 0.1]).x[:2]


def energy(thing, state):
    A = rotation_of(state)
    c = A @ thing.body.com_object
    v = state.linear_velocity + np.cross(state.angular_velocity, c)
    w = A.T @ state.angular_velocity
    m = thing.body.mass_kg
    return 0.5 * m * v @ v + 0.5 * w @ thing.body.inertia_com @ w + m * G * (state.p_world_object + c)[2]


@pytest.mark.parametrize(
    ("name", "R"),
    [("carton", UPRIGHT), ("carton", ON_SIDE_X), ("spray", UPRIGHT), ("juice", UPRIGHT), ("salt", UPRIGHT)],
)
def test_tip_follows_the_pendulum_about_the_roundings_centre_line(name, R):
    thing = object_of(name, friction=2.0)
    result = tip(thing, R)
    phi, k = fitted(result)
    assert phi == pytest.approx(result.phi, abs=np.radians(0.1))
    assert k == pytest.approx(result.k, rel=0.005)
    rolled = thing.edge_radius_m * (result.theta - result.theta[0])
    assert np.ptp(result.edge_path[:, 0] - rolled) < 5e-5
    assert np.ptp(result.edge_path[:, 2]) < 2e-5


def test_wider_rounding_moves_the_axis_as_predicted():
    thing = dataclasses.replace(object_of("carton", friction=2.0), edge_radius_m=0.003)
    result = tip(thing)
    phi, k = fitted(result)
    assert phi == pytest.approx(result.phi, abs=np.radians(0.1))
    assert k == pytest.approx(result.k, rel=0.005)


def test_energy_is_conserved_while_the_object_pivots():
    thing = object_of("carton", friction=2.0)
    result = tip(thing)
    energies = np.array([energy(thing, state) for state in result.states])
    assert np.ptp(energies) < 0.005 * result.energy


def test_just_too_little_energy_rocks_back_and_just_enough_tips():
    thing = object_of("carton", friction=2.0)
    assert tip(thing, energy_ratio=0.97).theta.max() < tip(thing).phi
    assert tip(thing, energy_ratio=1.03, seconds=1.5).theta.max() > tip(thing).phi


def test_rest_stays_at_rest(monkeypatch):
    monkeypatch.setattr(world_module, "_REST_TICKS", 10**9)
    thing = load_object("carton", 1)
    states = []
    world = World(thing, parked, on_tick=states.append, table_tilt=(0.01, 0.02))
    place(world, thing, UPRIGHT)
    world.step_to(2_300_000_000)
    path = np.array([state.p_world_object for state in states])[300:]
    assert np.ptp(path, axis=0).max() < 5e-5
    assert not world.at_rest


def test_object_slides_if_friction_is_too_low():
    thing = object_of("carton", friction=0.05)
    states = []
    world = World(thing, parked, on_tick=states.append, table_tilt=(0.0, -0.1))
    place(world, thing, UPRIGHT)
    world.step_to(500_000_000)
    acceleration = G * (np.sin(0.1) - 0.05 * np.cos(0.1))
    assert states[-1].p_world_object[0] - states[99].p_world_object[0] == pytest.approx(
        0.5 * acceleration * (0.5**2 - 0.1**2), rel=0.05
    )


class SwingMotor:
    """Motor that holds the arm, accelerates it to a speed, is off during the contact, then catches it."""

    def __init__(self, speed):
        self.rate, self.caught = speed / world_module.ARM_LENGTH_M, False

    def __call__(self, position, velocity, time_ns):
        if time_ns < 500_000_000:
            return parked(position, velocity, time_ns)
        if not self.caught and position < -0.02:
            return 0.2 * (self.rate - velocity)
        if not self.caught and position < 0.012:
            return 0.0
        self.caught = True
        return -1.0 * (position + 0.5) - 0.08 * velocity


@pytest.mark.parametrize(("name", "height"), [("carton", 0.12), ("juice", 0.13), ("salt", 0.12)])
def test_one_strike_is_one_contact_with_the_impulse_that_the_arm_lost(name, height):
    thing = object_of(name, friction=0.8)
    contacts, states = [], []
    swing = SwingMotor(0.42)
    world = World(thing, swing, on_contact=contacts.append, on_tick=states.append)
    place(world, thing, UPRIGHT, height)
    world.step_to(2_000_000_000)
    assert len(contacts) == 1
    contact = contacts[0]
    assert 0.001 < contact.duration_s < 0.008
    i = next(i for i, state in enumerate(states) if state.time_ns > contact.time_ns) - 2
    j = next(
        i for i, state in enumerate(states) if state.time_ns >= contact.time_ns + contact.duration_s * 1e9
    )
    arm_speed = [world_module.ARM_LENGTH_M * states[n].arm_velocity for n in (i, j)]
    assert contact.impulse_n_s == pytest.approx(
        ARM_INERTIA_KG_M2 / world_module.ARM_LENGTH_M**2 * -np.diff(arm_speed)[0], rel=0.05
    )
    assert contact.p_world_contact[2] == pytest.approx(height, abs=0.003)
    assert np.linalg.norm(states[i].linear_velocity) < 1e-4
    rebound = states[j].angular_velocity[1] * height - arm_speed[1]
    assert rebound / arm_speed[0] == pytest.approx(0.4, abs=0.07)


def test_a_push_gives_the_object_its_impulse():
    """A push through the centre of mass, without friction, gives momentum m v = J and no rotation."""
    thing = object_of("carton", 1e-6)
    contacts = []
    world = World(thing, parked, on_contact=contacts.append)
    place(world, thing, UPRIGHT)
    world.step_to(1_000_000_000)
    assert world.at_rest
    impulse, begun_ns = np.array([0.018, 0.004, 0.0]), world.time_ns
    touched = world.state().p_world_object + thing.body.com_object
    world.push(touched, impulse, 0.006)
    with pytest.raises(AcquireError, match="one at a time"):
        world.push(touched, impulse, 0.006)
    world.step_to(begun_ns + 8_000_000)
    state = world.state()
    of_com = state.linear_velocity + np.cross(
        state.angular_velocity, rotation_of(state) @ thing.body.com_object
    )
    np.testing.assert_allclose(of_com[:2] * thing.body.mass_kg, impulse[:2], rtol=0.01)
    assert np.abs(state.angular_velocity).max() < 0.05
    (contact,) = contacts
    assert (contact.time_ns, contact.duration_s) == (begun_ns, 0.006)
    assert contact.impulse_n_s == pytest.approx(np.linalg.norm(impulse))


def test_stand_is_moved_in_after_the_object_and_the_arm_may_hang_where_it_stands():
    thing = load_object("carton", 1)
    world = World(thing, lambda *_: 0.0, arm_angle=0.05)
    place(world, thing, UPRIGHT)
    world.step_to(300_000_000)
    assert world.state().p_world_object == pytest.approx([0, 0, 0.075], abs=5e-5)


def test_the_same_seed_gives_the_same_motion_to_the_last_bit():
    def run():
        world = World(load_object("spray", 7), SwingMotor(0.5))
        place(world, load_object("spray", 7), UPRIGHT, 0.12)
        world.step_to(1_200_000_000)
        return world.state()

    one, two = run(), run()
    assert np.array_equal(one.p_world_object, two.p_world_object)
    assert np.array_equal(one.q_world_object_wxyz, two.q_world_object_wxyz)


def test_placement_without_a_rotation_matrix_is_refused():
    world = World(load_object("carton", 1), parked)
    with pytest.raises(AcquireError, match="rotation"):
        world.place(np.diag([1.0, 1.0, -1.0]), np.zeros(3), np.zeros(3))
