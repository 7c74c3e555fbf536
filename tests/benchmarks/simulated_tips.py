"""Whole sessions of sliding, rounded, misplaced tips of random bodies, as cameras see them: what `make coverage` is run on.

Shapes are planned by the planner; what happens is simulated strike by strike in the plane with dry friction (motion/sliding.py of the
tests), which shares nothing with the estimators; masses are random points, not the estimator's cells. What calibration gets wrong is drawn
once per session: tilt, scale, mass, radius of the edges; scanned faces are off by face, edges by edge.
Does not model: a table's slope beyond its effect on the vertical, air, a third dimension of the tip, images.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.motion.strike import MotionSettings, StrikeTask, analyse_motion
from analyze.motion.tip_angle import PlanarMotion
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.pipeline.sections import landing_of, section_of
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import make_plan
from analyze.types import TipMotion
from schemas.object_spec import MarkerSpec, ObjectSpec, Shape, object_sha256
from schemas.result import Verdict
from schemas.strike_plan import PlannedStrike, StrikePlan
from tests.analyze.geometry.shapes import stl
from tests.analyze.motion.drawn_strikes import T0, seen
from tests.analyze.motion.sliding import Body, push_for, simulate
from tests.analyze.planning.random_bodies import KINDS, shape_of
from tests.analyze.simulated_session import manifest

STRIKES = 9
POINTS = 12_000
WALL = 0.003
RADIUS, RADIUS_SD = 1e-3, 3e-4
OWN_RADIUS = 0.3
"""of RADIUS_SD: one edge against the others"""
TILT_SD = math.radians(0.2)
SCAN_SD = 3e-4
SCALE_SD = 2e-3
MASS_SD = 1e-4
ANGLE_SD = 2e-4
"""rad, of each axis: lens, resting face"""
NOISE = (0.02, 0.1)
"""degrees per frame"""
SUREST = math.radians(4)
"""least phi of a body that is put down: others fall over"""
TRIES = 3
"""strikes of one kind, until one can be used"""


@dataclass(frozen=True)
class Truth:
    """What is to be found."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray
    regions: np.ndarray | None
    """(3,) kg: wall, above, below; None outside the class of a wall and two even parts"""
    border: np.ndarray
    """(3,) normal"""
    points: np.ndarray
    masses: np.ndarray
    in_wall: np.ndarray


@dataclass(frozen=True)
class Filled:
    """Points of a body with their masses."""

    masses: np.ndarray
    regions: np.ndarray | None
    border: np.ndarray


@dataclass(frozen=True)
class PlannedBody:
    """A shape with its plan, and points spread evenly in it."""

    spec: ObjectSpec
    model: ObjectModel
    plan: StrikePlan
    points: np.ndarray
    in_wall: np.ndarray


@lru_cache(maxsize=4)
def planned_body(seed: int) -> PlannedBody | None:
    """A random shape; None: it cannot be planned."""
    rng = np.random.default_rng((seed, 0xB0D1))
    triangles = shape_of(KINDS[seed % len(KINDS)], rng)
    volume = float(np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum()) / 6e9
    shape = stl(triangles)
    spec = ObjectSpec(
        name=f"body {seed}",
        mass_kg=min(300 * abs(volume), 0.2),
        mass_sd_kg=MASS_SD,
        shape=Shape.model_validate({"file": "b.stl", "unit": "mm", "scale_sd": SCALE_SD, "surface_sd_m": SCAN_SD}),
        edge_radius_m=RADIUS,
        edge_radius_sd_m=RADIUS_SD,
        shell_thickness_m=WALL,
        marker=[MarkerSpec(id=0, size_m=0.03)],
    )
    model = load_object_model(spec, shape, "b.stl")
    try:
        plan = make_plan(model, spec, object_sha256(spec, shape), StrikerModel(fastest_m_s=5.0), strikes=STRIKES)
    except PlanError:
        return None
    low, high = model.bounds
    points = rng.uniform(low, high, (POINTS, 3))
    depth = model.depth(points)
    return PlannedBody(spec, model, plan, points[depth > 0], depth[depth > 0] < WALL)


Analyse = Callable[[PlanarMotion, StrikeTask, MotionSettings], TipMotion]


def session(shape: int, seed: int, analyse: Analyse = analyse_motion) -> tuple[Evidence, Truth] | None:
    """One session on the shape of that number, its strikes given to `analyse`; None where it has no plan or none of its bodies stands."""
    body = planned_body(shape)
    if body is None:
        return None
    rng = np.random.default_rng((seed, shape, 0x5E55))
    truth = _drawn_truth(body, rng)
    if truth is None:
        return None
    motions = _motions(body, truth, rng, analyse)
    spec = body.spec.model_copy(update={"mass_kg": truth.mass + rng.normal(0, MASS_SD)})
    plan = body.plan
    stated = manifest(spec).model_copy(update={"gravity_tilt_sd_rad": TILT_SD})
    head = RecordingHead(Path("r.mcap"), stated, "c" * 64, tuple(motion.strike_id for motion in motions), files=("r.mcap",))
    return Evidence((head,), spec, body.model, plan, plan.object_sha256, tuple(motions)), truth


def _drawn_truth(body: PlannedBody, rng: np.random.Generator) -> Truth | None:
    """A filling with which it stands on every face of the plan."""
    scale = 1 + rng.normal(0, SCALE_SD)
    for _ in range(40):
        filled = _in_class(body, rng) if rng.random() < 0.6 else _outside(body, rng)
        masses = body.spec.mass_kg * filled.masses / filled.masses.sum()
        points = scale * body.points
        com = masses @ points / masses.sum()
        arm = points - com
        second = (arm * masses[:, None]).T @ arm
        if all(SUREST < _balance(com, strike) < math.radians(65) for strike in body.plan.strikes):
            inertia = np.trace(second) * np.eye(3) - second
            return Truth(float(masses.sum()), com, inertia, filled.regions, filled.border, points, masses, body.in_wall)
    return None


def _in_class(body: PlannedBody, rng: np.random.Generator) -> Filled:
    """A wall and two even parts on either side of a plane; one in six leaves a part empty."""
    surface, upper = rng.uniform(0.1, 0.7), rng.uniform(0.1, 0.9)
    if rng.random() < 1 / 6:
        upper = float(rng.integers(2))
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)
    heights = body.points @ normal
    above = ~body.in_wall & (heights > np.quantile(heights[~body.in_wall], rng.uniform(0.3, 0.7)))
    parts = (body.in_wall, above, ~body.in_wall & ~above)
    shares = np.array([surface, (1 - surface) * upper, (1 - surface) * (1 - upper)])
    masses = sum(share * part / part.sum() for share, part in zip(shares, parts, strict=True))
    return Filled(np.asarray(masses), body.spec.mass_kg * shares, normal)


def _outside(body: PlannedBody, rng: np.random.Generator) -> Filled:
    """A wall and two to four lumps inside."""
    inside = np.flatnonzero(~body.in_wall)
    masses = rng.uniform(0.2, 0.6) * body.in_wall / body.in_wall.sum()
    for share in (1 - masses.sum()) * rng.dirichlet(np.ones(int(rng.integers(2, 5)))):
        off = body.points - body.points[rng.choice(inside)]
        lump = np.exp(-np.sum(off**2, axis=1) / (2 * rng.uniform(0.006, 0.02) ** 2)) * ~body.in_wall
        masses = masses + share * lump / lump.sum()
    return Filled(masses, None, np.zeros(3))


def _balance(com: np.ndarray, strike: PlannedStrike) -> float:
    turned = np.array(strike.R_world_object) @ (com - np.array(strike.pivot.point))
    return math.atan2(-turned[0], turned[2])


def _motions(body: PlannedBody, truth: Truth, rng: np.random.Generator, analyse: Analyse) -> list[TipMotion]:
    scale = float(truth.points[0] @ body.points[0] / (body.points[0] @ body.points[0])) - 1
    tilt, radius = rng.normal(0, TILT_SD), RADIUS + rng.normal(0, RADIUS_SD)
    friction = rng.uniform(0.35, 0.8)
    noise = math.radians(rng.uniform(*NOISE))
    faces: dict[str, float] = {}
    edges: dict[str, tuple[float, float, float]] = {}
    found: list[TipMotion] = []
    for strike in body.plan.strikes:
        risen = faces.setdefault(strike.plane_id, rng.normal(0, SCAN_SD))
        drawn = (rng.normal(0, SCAN_SD), rng.normal(0, OWN_RADIUS * RADIUS_SD), rng.normal(0, ANGLE_SD))
        ahead, rounder, turned = edges.setdefault(strike.axis_id, drawn)
        rho = max(radius + rounder, 1e-4)
        # In the rest pose, along and off the table: where the rounding's centre line is, less where the plan has it.
        at = np.array(strike.R_world_object) @ (scale * np.array(strike.pivot.point))
        off = np.array([at[0] + ahead - (rho - RADIUS), at[2] + risen + (rho - RADIUS)])
        arm = np.array(strike.R_world_object) @ (truth.com - np.array(strike.pivot.point))
        back, up = off[0] - arm[0], arm[2] - off[1]
        line = np.array(strike.pivot.direction)
        tall = float(np.ptp(body.model.hull_vertices @ np.array(strike.R_world_object)[2]))
        planar = Body(
            R=math.hypot(back, up),
            phi=math.atan2(back, up) + tilt + turned,
            inertia=float(line @ truth.inertia @ line) / truth.mass,
            rho=rho,
            friction=friction,
            height=tall,
        )
        found.append(_strike(body, strike, planar, off, noise, rng, analyse))
    return found


def _strike(
    body: PlannedBody, planned: PlannedStrike, planar: Body, off: np.ndarray, noise: float, rng: np.random.Generator, analyse: Analyse
) -> TipMotion:
    """Struck until it can be used, three times at most; most a little over the top, one in ten not over it."""
    motion = None
    for _ in range(TRIES):
        energy = rng.uniform(0.85, 0.97) if rng.random() < 0.1 else rng.uniform(1.03, 1.3)
        height = min(planned.impact_height_m, 0.98 * planar.height)
        course = simulate(planar, [push_for(planar, energy, height)], phase=rng.uniform(0, 1), seconds=1.0)
        tracked, _ = seen(course, planar, rng, noise)
        # The camera follows the plan's point, which turns about the true one, and takes the plan's rounding.
        cos, sin = np.cos(course.theta), np.sin(course.theta)
        along = -off[0] * (cos - 1) - off[1] * sin + (planar.rho - planned.pivot.radius_m) * course.theta
        over = off[0] * sin - off[1] * (cos - 1)
        tracked = replace(tracked, angle=replace(tracked.angle, slip=tracked.angle.slip + along), lift=tracked.lift + over)
        task = StrikeTask(f"{planned.id}.1", planned, T0, None, section_of(body.model, planned), landing_of(body.model, planned))
        motion = analyse(tracked, task, MotionSettings())
        if motion.verdict in (Verdict.GOOD, Verdict.ROCKED_BACK) and motion.fit is not None:
            break
    assert motion is not None
    return motion
