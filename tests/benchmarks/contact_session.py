"""Sessions for `make bench-contact`: a virtual object struck on tables of given friction and restitution.

Physics of the virtual rig (acquire/virtual/world.py), without images: the true poses are given to the
analysis as a tracker would see them (honesty/observed.py), through the landing. A strike is a finger's push
at the planned height. Tag places, lens, noise of every frame and the table's tilt are drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from acquire.virtual.objects import VirtualObject, load_object
from acquire.virtual.station import G_M_S2
from acquire.virtual.world import World
from acquire.virtual.world_state import WorldState
from analyze.errors import AnalyzeError
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.pipeline.sections import next_face_angle, rolling_outline, scanned_edge_sd, strike_supports
from analyze.planning.examine import Bench
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import prepare_object
from analyze.planning.view import default_camera
from analyze.types import TipMotion
from schemas.object_spec import object_sha256
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.strike_result import USABLE_VERDICTS
from tests.acquire.simulated_rig import STRIKER
from tests.analyze.simulated_session import manifest
from tests.benchmarks.honesty.disturbances import DISTURBANCES
from tests.benchmarks.honesty.observed import T0, View, draw_view, observe
from tests.benchmarks.honesty.statics import TrueTip
from tests.benchmarks.honesty.struck import StruckMotion

MS = 1_000_000
SETTLE_NS, LONGEST_NS, AFTER_LANDING_NS = 600 * MS, 1_600 * MS, 150 * MS
TRIES = 2
ENERGY_SD = 0.03
"""relative error of the energy of a strike that aims at one"""
TILT_SD = math.radians(0.05)
LEAST_FRICTION_PLANNED = 0.3
"""least friction [ ] with which strikes are planned: on a smoother table the planner refuses most edges"""
RATE_HZ = 120.0


@dataclass(frozen=True)
class Table:
    """Table on which a session takes place."""

    friction: float
    restitution: float
    """coefficient of restitution of a single contact"""


@dataclass(frozen=True)
class StruckStrike:
    """One simulated strike: true poses from the push on, and the analysed motion."""

    planned: PlannedStrike
    truth: StruckMotion
    motion: TipMotion


@dataclass(frozen=True)
class ContactSession:
    """A session with its evidence and truth."""

    thing: VirtualObject
    table: Table
    evidence: Evidence
    strikes: tuple[StruckStrike, ...]


def contact_session(
    name: str, seed: int, table: Table, rate: float | None = RATE_HZ, strikes: int = 9
) -> ContactSession | None:
    """Simulate a session; None if the planner refuses the object.

    Args:
        name: name of the virtual object.
        seed: seed of masses, errors and pushes.
        table: the table.
        rate: frames per second; None to draw 120 or 240.
        strikes: number of planned strikes.
    """
    thing = replace(load_object(name, seed), friction=table.friction)
    rng = np.random.default_rng([0xC047, seed, *name.encode(), round(1000 * table.friction)])
    return session_of(thing, table, rng, rate, PlanRequest(strikes))


def session_of(
    thing: VirtualObject,
    table: Table,
    rng: np.random.Generator,
    rate: float | None = RATE_HZ,
    request: PlanRequest | None = None,
) -> ContactSession | None:
    """Simulate a session of an object; None if the planner refuses it.

    Args:
        thing: the object, with the table's friction.
        table: the table.
        rng: generator of errors and pushes.
        rate: frames per second; None to draw 120 or 240.
        request: what to plan. The energies are the plan's where it tests contents, else drawn.
    """
    request = request or PlanRequest()
    shape = thing.shape_file or ("", None)
    model = load_object_model(thing.spec, shape[1], shape[0])
    sha = object_sha256(thing.spec, shape[1])
    try:
        bench = Bench(STRIKER, default_camera(), max(0.9 * table.friction, LEAST_FRICTION_PLANNED))
        plan = plan_strikes(prepare_object(model, thing.spec, bench), sha, request)
    except AnalyzeError:
        return None
    view = draw_view(DISTURBANCES["none"], rng)
    view = replace(view, rate=rate or view.rate)
    tilt = float(rng.normal(0.0, TILT_SD))
    world = World(
        thing, lambda *_: 0.0, table_tilt=(0.0, tilt), arm_angle=-2.5, table_restitution=table.restitution
    )
    struck = tuple(
        _struck(world, thing, model, each, view, rng, each.aim.energy_ratio if request.contents else None)
        for each in plan.strikes
    )
    return ContactSession(thing, table, _evidence(thing, model, plan, sha, struck), struck)


def _struck(
    world: World, thing: VirtualObject, model: ObjectModel, planned: PlannedStrike, view: View,
    rng: np.random.Generator, aimed: float | None = None,
) -> StruckStrike:  # fmt: skip
    drawn = rng.uniform(1.03, 1.3) if aimed is None else aimed * (1 + rng.normal(0, ENERGY_SD))
    energy, found = float(drawn), None
    for attempt in range(TRIES):
        truth = _poses(world, thing, planned, energy, float(rng.uniform(0.002, 0.004)))
        tracked, _ = observe(planned, truth, view, DISTURBANCES["none"], rng)
        task = StrikeTask(
            f"{planned.id}.{attempt + 1}",
            planned,
            T0,
            None,
            rolling_outline(model, planned),
            next_face_angle(model, planned),
            supports=strike_supports(model, planned),
            edge_sd=scanned_edge_sd(thing.spec, model, planned),
        )
        found = StruckStrike(planned, truth, analyse_motion(tracked, task, MotionSettings()))
        if found.motion.verdict in USABLE_VERDICTS and found.motion.fit is not None and truth.over:
            break
        energy *= 1.1
    assert found is not None
    return found


def _poses(
    world: World, thing: VirtualObject, planned: PlannedStrike, energy: float, seconds: float
) -> StruckMotion:
    """True poses of one push, from its beginning until after the landing."""
    R, p = np.array(planned.R_world_object), np.array(planned.p_world_object)
    point = R @ np.array(planned.impact.point) + p
    world.place(R, p, point + np.array([-0.5, 0.0, 0.3]))
    until = world.time_ns + SETTLE_NS
    while world.time_ns < until and not world.at_rest:
        world.step_to(world.time_ns + 20 * MS)
    tip = true_tip(thing, planned)
    impulse = math.sqrt(2 * thing.body.mass_kg * G_M_S2 * tip.rise * energy * tip.i_edge) / point[2]
    world.push(np.array([point[0], 0.0, point[2]]), np.array([impulse, 0.0, 0.0]), seconds)
    begun = world.time_ns
    states = [world.state()]
    end, over = begun + LONGEST_NS, False
    while world.time_ns < end:
        world.step_to(world.time_ns + MS)
        states.append(world.state())
        theta = tipped(states[-1], R)
        over = over or theta > tip.phi + 0.1
        moved = world.time_ns - begun > 150 * MS
        if moved and end == begun + LONGEST_NS and (_speed(states) < 0 and (over or theta < 0.005)):
            end = world.time_ns + AFTER_LANDING_NS
    time = np.array([1e-9 * (state.time_ns - begun) for state in states])
    wxyz = np.array([state.q_world_object_wxyz for state in states])
    position = np.array([state.p_world_object for state in states])
    R_rest = Rotation.from_quat(wxyz[0, [1, 2, 3, 0]]).as_matrix()
    return StruckMotion(time, position, wxyz[:, [1, 2, 3, 0]], R_rest, tip, energy, over)


def _speed(states: list[WorldState]) -> float:
    return float(states[-1].angular_velocity[1])


def tipped(state: WorldState, R_rest: np.ndarray) -> float:
    """Tipping angle [rad] of a state since rest."""
    w, x, y, z = state.q_world_object_wxyz
    turned = Rotation.from_quat([x, y, z, w]).as_matrix() @ R_rest.T
    return float(np.arctan2(turned[0, 2], turned[2, 2]))


def true_tip(thing: VirtualObject, planned: PlannedStrike) -> TrueTip:
    """Balance over the planned edge, from the true masses."""
    body, line = thing.body, np.array(planned.pivot.direction)
    arm = np.array(planned.R_world_object) @ (body.com_object - np.array(planned.pivot.point))
    R, phi = float(np.hypot(arm[0], arm[2])), math.atan2(-arm[0], arm[2])
    i_com = float(line @ body.inertia_com @ line)
    i_edge = i_com + body.mass_kg * (R + planned.pivot.radius_m) ** 2
    return TrueTip(
        phi, body.mass_kg * G_M_S2 * R / i_edge, i_edge, i_com, np.array(planned.pivot.point), line,
        planned.pivot.radius_m, R - float(arm[2]),
    )  # fmt: skip


def _evidence(
    thing: VirtualObject, model: ObjectModel, plan: StrikePlan, sha: str, struck: tuple[StruckStrike, ...]
) -> Evidence:
    motions = tuple(each.motion for each in struck)
    stated = manifest(thing.spec).model_copy(
        update={"gravity_tilt_sd_rad": TILT_SD, "g_m_s2": G_M_S2, "object_sha256": sha}
    )
    head = RecordingHead(
        Path("r.mcap"), stated, "c" * 64, tuple(motion.strike_id for motion in motions), files=("r.mcap",)
    )
    return Evidence((head,), thing.spec, model, plan, sha, motions)
