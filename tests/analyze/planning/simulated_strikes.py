"""Strikes simulated by the virtual rig's physics, without images or wall clock.

Used by a test and a benchmark. The prediction is given the true mass, c and inertia: its physics is tested,
not the hypothesis.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from acquire.virtual.objects import VirtualObject, load_object
from acquire.virtual.world import World
from acquire.virtual.world_state import WorldState
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning import feasibility, impact
from analyze.planning.hypothesis import hypothesis
from analyze.planning.pivots import PivotAxis, Swing, pivot_axes, swing
from analyze.planning.stable_planes import resting_planes

G = 9.81
ARM_LENGTH = 0.12
SURE = 0.002
"""smallest distance [m] of c from the edges of its support"""
SLID = 5e-4
"""displacement [m] of an end of the edge on the table, relative to rolling, above which it slipped"""
LIFTED = 1e-3
"""height [m] of the whole edge above which it left the table"""
ON_TABLE = 1e-4
STRIKER = impact.StrikerModel(0.1736, 0.4)
REST_NS, LONGEST_NS, STEP_NS = 430_000_000, 1_600_000_000, 100_000_000


@dataclass(frozen=True)
class Bench:
    """Virtual object with the axes over which it can be tipped."""

    thing: VirtualObject
    model: ObjectModel
    axes: tuple[PivotAxis, ...]


@dataclass(frozen=True)
class Trial:
    """One strike to simulate."""

    axis: PivotAxis
    expected: Swing
    point: impact.ImpactPoint
    energy: float
    friction: float
    planned: bool
    """True if struck at the height that the planner would choose; False if lower or higher"""
    case: feasibility.StrikeCase


@dataclass(frozen=True)
class Seen:
    """Largest slip [m] and lift [m] until balance or until the object rocked back."""

    slip: float
    lift: float
    over: bool

    @property
    def outcome(self) -> str:
        if self.slip > SLID:
            return "slips"
        return "lifts" if self.lift > LIFTED else "holds"


def predicted(tips: feasibility.TipOutcomes, index: int) -> str:
    """Outcome that the planner predicts: slips, lifts or holds."""
    if tips.slip[index] > feasibility.SLIP_LIMIT:
        return "slips"
    return "lifts" if tips.least_load[index] <= 0 else "holds"


def bench(name: str, seed: int = 1) -> Bench:
    """A virtual object with every edge of every face on which it stands."""
    thing = load_object(name, seed)
    shape = thing.shape_file or ("", None)
    model = load_object_model(thing.spec, shape[1], shape[0])
    planes = [plane for plane in resting_planes(model) if plane.margin(thing.body.com_object[None]) > SURE]
    return Bench(thing, model, tuple(pivot_axes(model, thing.spec, planes, hypothesis(model))))


def trials(
    on: Bench,
    energies: tuple[float, ...],
    frictions: tuple[float, ...],
    elsewhere: float,
    rng: np.random.Generator,
) -> list[Trial]:
    """Strikes on every axis with every energy and friction.

    A fraction `elsewhere` of them is at the lowest, middle or highest impact point.
    """
    body = on.thing.body
    unit = body.inertia_com / body.mass_kg
    found: list[Trial] = []
    for axis in on.axes:
        expected = swing(axis, body.com_object, body.mass_kg, unit, G)
        points = impact.impact_points(on.model, axis, [expected], [], impact.StrikerModel())
        best = impact.best_impact(points, 9.0)
        if best is None:
            continue
        for energy in energies:
            for friction in frictions:
                other = rng.random() < elsewhere
                point = (
                    points[(0, len(points) // 2, len(points) - 1)[int(rng.integers(3))]] if other else best
                )
                impulse = impact.impulse_for(expected, point.height, energy)
                case = feasibility.strike_case(
                    axis, expected, body.com_object, unit, point.height, impulse, friction
                )
                speed = impact.tip_speed_for(STRIKER, expected, point.height, impulse)
                if 0.05 < speed < 1.5:
                    found.append(Trial(axis, expected, point, energy, friction, not other, case))
    return found


def strike(on: Bench, trial: Trial) -> Seen | None:
    """Simulate a strike; None if the object did not come to rest beforehand, or the arm missed it."""
    axis = trial.axis
    impulse = impact.impulse_for(trial.expected, trial.point.height, trial.energy)
    speed = impact.tip_speed_for(STRIKER, trial.expected, trial.point.height, impulse)
    states: list[WorldState] = []
    contacts: list = []
    thing = dataclasses.replace(on.thing, friction=trial.friction)
    world = World(thing, _Arm(speed), on_tick=states.append, on_contact=contacts.append, arm_angle=-0.55)
    R, p = axis.R_world_object, axis.p_world_object
    world.place(R, p, R @ trial.point.point + p)
    world.step_to(REST_NS)
    if not world.at_rest:
        return None
    states.clear()
    for end in range(REST_NS + STEP_NS, REST_NS + LONGEST_NS + 1, STEP_NS):
        world.step_to(end)
        if contacts and (_angle(world.state(), R) > trial.expected.phi + 0.05 or world.at_rest):
            break
    return _seen(states, contacts, trial) if contacts else None


def _seen(states: list[WorldState], contacts: list, trial: Trial) -> Seen:
    axis = trial.axis
    theta = np.array([_angle(state, axis.R_world_object) for state in states])
    ends = [axis.point + axis.direction * along for along in (0.0, *feasibility.axis_ends(axis))]
    path = np.array([[state.p_world_object + _turn(state) @ end for end in ends] for state in states])
    released = contacts[0].time_ns + contacts[0].duration_s * 1e9
    first = int(np.searchsorted([state.time_ns for state in states], released))
    over = bool(theta.max() > trial.expected.phi)
    last = int(np.argmax(theta > trial.expected.phi)) if over else int(np.argmax(theta)) + 1
    if theta.max() < np.radians(1):
        last = min(len(states), first + 300)
    rise = path[:last, :, 2] - axis.radius
    slid = np.abs(path[:last, :, 0] - path[0, :, 0] - axis.radius * (theta[:last] - theta[0])[:, None])
    slip = float(np.where(rise < ON_TABLE, slid, 0.0).max())
    lift = float(rise[first:].min(axis=1).max()) if last > first else 0.0
    return Seen(slip, lift, over)


def _turn(state: WorldState) -> np.ndarray:
    w, x, y, z = state.q_world_object_wxyz
    return Rotation.from_quat([x, y, z, w]).as_matrix()


def _angle(state: WorldState, R: np.ndarray) -> float:
    turned = _turn(state) @ R.T
    return float(np.arctan2(turned[0, 2], turned[2, 2]))


class _Arm:
    """Torque of the arm's motor, as a function of time and state.

    It holds the arm back, accelerates it, lets it coast through the contact and catches it.
    """

    def __init__(self, speed: float) -> None:
        self._rate, self._caught = speed / ARM_LENGTH, False

    def __call__(self, position: float, velocity: float, time_ns: int) -> float:
        if time_ns < REST_NS + 20_000_000:
            return -1.0 * (position + 0.6) - 0.05 * velocity
        if not self._caught and position < -0.02:
            return 0.2 * (self._rate - velocity)
        if not self._caught and position < 0.012:
            return 0.0
        self._caught = True
        return -1.0 * (position + 0.5) - 0.08 * velocity
