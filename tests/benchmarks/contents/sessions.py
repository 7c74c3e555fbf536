"""Sessions of boxes with contents: strikes simulated, seen with noise, and analysed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.pipeline.sections import next_face_angle, rolling_outline
from analyze.types import TipMotion
from schemas.object_spec import Box as BoxShape
from schemas.object_spec import MarkerSpec, ObjectSpec, Shape, object_sha256
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range, StrikePlan
from schemas.strike_result import USABLE_VERDICTS
from tests.analyze.motion.drawn_strikes import T0, seen
from tests.analyze.motion.sliding import Body as PlanarBody
from tests.analyze.motion.sliding import Course
from tests.analyze.simulated_session import manifest
from tests.benchmarks.contents.bodies import Box, Edge, chosen_edges, needed_energy
from tests.benchmarks.contents.moving import floor_path
from tests.benchmarks.contents.planar import Courses, Curves, Lanes, simulate

RATE = 120.0
"""frames per second"""
REST = 0.25
"""time filmed before the push [s]"""
FILMED = 1.2
"""time filmed after it [s]; a body that lies stays there"""
ATTEMPTS = 3
"""times that a strike is made until it is usable"""
TEST_ENERGIES = (1.06, 1.25, 1.6)
"""energy ratios of the strikes on the first edge"""
OTHER_ENERGIES = (1.08, 1.2)
"""energy ratios of the strikes on the other edges"""
ENERGY_SD = 0.03
"""relative error of the energy ratio that a strike has"""
NOISE = (math.radians(0.02), math.radians(0.045))
"""range of the noise of the tipping angle per frame; its geometric mean is 0.03 degrees"""
TILT_SD, MASS_SD, RADIUS_SD, FACE_SD = math.radians(0.05), 1e-4, 1e-4, 5e-5
REST_SD = math.radians(0.01)
"""scatter of the pose at rest from strike to strike"""


@dataclass(frozen=True)
class Made:
    """One strike of a session: edge, plan entry, and its lanes of the simulation."""

    edge: Edge
    planned: PlannedStrike
    energies: tuple[float, ...]
    """energy ratio of each attempt"""
    heights: tuple[float, ...]


@dataclass(frozen=True)
class Session:
    """Box with the strikes that are made, before they are simulated."""

    box: Box
    seed: int
    strikes: tuple[Made, ...]
    spec: ObjectSpec
    lean: float
    noise: float


def draw_session(box: Box, seed: int, energies: Sequence[float] = TEST_ENERGIES) -> Session:
    """Strikes of a contents test on a box: `energies` on one edge, two strikes on each of the others."""
    rng = np.random.default_rng((0xC0117, seed))
    edges = chosen_edges(box, rng)
    assert edges is not None
    stated = max(0.0, box.radius + rng.normal(0, RADIUS_SD))
    spec = ObjectSpec(
        name="box",
        mass_kg=box.mass + rng.normal(0, MASS_SD),
        mass_sd_kg=MASS_SD,
        shape=Shape(box=BoxShape(size_m=box.size.tolist()), surface_sd_m=FACE_SD),
        edge_radius_m=stated,
        edge_radius_sd_m=RADIUS_SD,
        shell_thickness_m=box.wall,
        marker=[MarkerSpec(id=0, size_m=0.03)],
    )
    strikes: list[Made] = []
    for number, edge in enumerate(edges):
        for energy in energies if number == 0 else OTHER_ENERGIES:
            planned = _planned(f"s{len(strikes) + 1}", box, edge, stated, energy, rng)
            drawn = energy * (1 + rng.normal(0, ENERGY_SD, ATTEMPTS))
            heights = planned.aim.impact_height_m * rng.uniform(0.85, 1.05, ATTEMPTS)
            top = 0.98 * box.size[edge.face]
            strikes.append(Made(edge, planned, tuple(drawn), tuple(np.minimum(heights, top))))
    noise = float(NOISE[0] * (NOISE[1] / NOISE[0]) ** rng.random())
    return Session(box, seed, tuple(strikes), spec, float(rng.normal(0, TILT_SD)), noise)


def _planned(
    name: str, box: Box, edge: Edge, radius: float, energy: float, rng: np.random.Generator
) -> PlannedStrike:
    """Plan entry of a strike over an edge, at the centre of percussion or near the top."""
    up, ahead = np.zeros(3), np.zeros(3)
    up[edge.face], ahead[edge.third] = -edge.sign, edge.side
    direction = np.cross(up, ahead)
    corner = 0.5 * box.size * (ahead - up)
    inertia, _ = needed_energy(box, edge)
    com = box.resting_com(edge.pose)
    height = min(inertia / (box.mass * float((com - corner) @ up)), 0.95 * float(box.size[edge.face]))
    point = corner + radius * (up - ahead)
    R_world_object = np.array([ahead, direction, up])
    faces = f"{'xyz'[edge.face]}{'+' if edge.sign > 0 else '-'}"
    return PlannedStrike(
        id=name,
        plane_id=faces,
        axis_id=f"{faces}/{'xyz'[edge.third]}{'+' if edge.side > 0 else '-'}",
        R_world_object=R_world_object.tolist(),
        p_world_object=(np.array([0, 0, radius]) - R_world_object @ point).tolist(),
        pivot=Pivot(point=point.tolist(), direction=direction.tolist(), radius_m=radius, sd_m=2 * FACE_SD),
        impact=Impact(point=(corner + height * up).tolist(), direction=ahead.tolist()),
        impact_height_m=height,
        impulse_n_s=Range(min=0.01, target=0.02, max=0.03),
        tip_speed_m_s=Range(min=0.1, target=0.2, max=0.3),
        energy_ratio=energy,
        phi_predicted_rad=max(0.05, box.balance(edge) + rng.normal(0, 0.05)),
        phi_predicted_sd_rad=0.05,
        i_edge_predicted_kg_m2=inertia,
        visible_markers=[0],
        camera_pose=np.eye(4).tolist(),
        friction_needed=0.2,
    )


def lanes_of(session: Session) -> int:
    """Number of simulated motions of a session: all attempts of all its strikes."""
    return ATTEMPTS * len(session.strikes)


def simulate_sessions(sessions: Sequence[Session]) -> Courses:
    """Motions of all attempts of all strikes of several sessions, in their order."""
    rows, paths, starts = [], [], []
    for session in sessions:
        rng = np.random.default_rng((0x51A, session.seed))
        for made in session.strikes:
            for energy, height in zip(made.energies, made.heights, strict=True):
                row, places, parameter, start = _lane(session, made.edge, energy, height, rng)
                rows.append(row)
                paths.append((parameter, places))
                starts.append(start)
    lanes = Lanes(*np.array(rows).T)
    curves = Curves.through(
        np.array([each[0] for each in paths]), np.array([each[1] for each in paths]), np.array(starts)
    )
    return simulate(lanes, curves)


def _lane(
    session: Session, edge: Edge, energy: float, height: float, rng: np.random.Generator
) -> tuple[list[float], np.ndarray, np.ndarray, float]:
    """Entries of `Lanes`; places (NODES, 2) of what moves, its parameters (NODES,) and that at rest."""
    box, axis = session.box, edge.along
    path = box.path(edge)
    moving = (box.mass - box.fixed) * (path.share if path else 0.0)
    still = box.mass - box.fixed - moving
    fixed, inertia = box.fixed, float(box.inertia[axis, axis])
    # From the middle of the box's face on the table, ahead and up.
    rigid = np.array(
        [edge.side * box.com[edge.third], 0.5 * box.size[edge.face] - edge.sign * box.com[edge.face]]
    )
    com = rigid
    if still > 0 and path is not None:
        place = np.array([path.still[0], path.still[1] + box.wall])
        inertia += fixed * still / (fixed + still) * float((place - rigid) @ (place - rigid))
        com = (fixed * rigid + still * place) / (fixed + still)
    needed_inertia, needed = needed_energy(box, edge)
    rho = box.radius
    row = [
        fixed + still,
        inertia,
        0.5 * box.size[edge.third] - rho - com[0],
        com[1],
        box.size[edge.third] - 2 * rho,
        rho,
        box.friction,
        box.table_rate,
        box.table_damping,
        moving,
        box.inner_friction,
        box.inner_damping,
        session.lean,
        math.sqrt(2 * needed * energy * needed_inertia) / height,
        height,
        rng.uniform(0.002, 0.004),
    ]
    path = path or floor_path(0.05, 0.02, 0.5)
    return row, path.places - (com - np.array([0.0, box.wall])), path.parameter, path.start


def session_evidence(session: Session, courses: Courses, first: int) -> Evidence:
    """Evidence of a session from its simulated motions, which begin at lane number `first`."""
    rng = np.random.default_rng((0xE71D, session.seed))
    spec = session.spec
    model = load_object_model(spec, None, spec.name)
    plan = StrikePlan(
        object_name=spec.name,
        object_sha256=object_sha256(spec, None),
        strikes=[made.planned for made in session.strikes],
    )
    # The true faces are off the stated ones.
    faces = {pose: rng.normal(0, FACE_SD) for pose in [(a, s) for a in range(3) for s in (-1, 1)]}
    motions: list[TipMotion] = []
    for number, made in enumerate(session.strikes):
        lanes = range(first + ATTEMPTS * number, first + ATTEMPTS * (number + 1))
        made_again = (
            _analysed(session, made, courses, lane, faces, (model, attempt), rng)
            for attempt, lane in enumerate(lanes)
        )
        motions.append(first_usable(made_again))
    stated = manifest(spec).model_copy(update={"gravity_tilt_sd_rad": TILT_SD, "g_m_s2": 9.80665})
    ids = tuple(motion.strike_id for motion in motions)
    head = RecordingHead(Path("r.mcap"), stated, "c" * 64, ids, files=("r.mcap",))
    return Evidence((head,), spec, model, plan, plan.object_sha256, tuple(motions))


def first_usable(attempts: Iterator[TipMotion]) -> TipMotion:
    """First motion that an estimate can use, or the last one made."""
    motion = next(attempts)
    while motion.verdict not in USABLE_VERDICTS or motion.fit is None:
        following = next(attempts, None)
        if following is None:
            break
        motion = following
    return motion


def _analysed(
    session: Session,
    made: Made,
    courses: Courses,
    lane: int,
    faces: dict[tuple[int, int], float],
    how: tuple[ObjectModel, int],
    rng: np.random.Generator,
) -> TipMotion:
    """Motion of one attempt as the tracker sees it, analysed; `how` is the object's model and the attempt."""
    model, attempt = how
    frames = (np.arange(-round(REST * RATE), round(FILMED * RATE)) + rng.random()) / RATE

    def sampled(values: np.ndarray) -> np.ndarray:
        return np.where(frames < 0, 0.0, np.interp(frames, courses.time, values[:, lane]))

    box, planned, edge = session.box, made.planned, made.edge
    theta = sampled(courses.theta)
    course = Course(frames, theta, sampled(courses.slip), sampled(courses.lift))
    planar = PlanarBody(R=0.1, phi=box.balance(edge), inertia=0.004, rho=box.radius)
    tracked, _ = seen(course, planar, rng, session.noise)
    turned = rng.normal(0, REST_SD)
    # The followed point is the plan's, beside the true centre line of the rounding.
    stated = planned.pivot.radius_m
    off = np.array([faces[edge.third, edge.side], -faces[edge.pose]]) + (box.radius - stated) * np.array(
        [-1, 1]
    )
    cos, sin = np.cos(theta), np.sin(theta)
    along = -off[0] * (cos - 1) - off[1] * sin + (box.radius - stated) * theta
    over = off[0] * sin - off[1] * (cos - 1)
    angle = tracked.angle
    moved = np.where(theta > math.radians(0.3), turned, 0.0)
    tracked = replace(
        tracked,
        angle=replace(angle, slip=angle.slip + along, theta=angle.theta - moved),
        lift=tracked.lift + over,
    )
    task = StrikeTask(
        f"{planned.id}.{attempt + 1}",
        planned,
        T0,
        None,
        rolling_outline(model, planned),
        next_face_angle(model, planned),
    )
    return analyse_motion(tracked, task, MotionSettings())
