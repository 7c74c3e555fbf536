"""Simulated sessions for `make coverage`: tips of random bodies on sliding, rounded, misplaced edges.

The planner plans the strikes; each is simulated in the plane with dry friction
(tests/analyze/motion/sliding.py), which shares no code with the estimators. Masses are random points, not the
estimator's cells. Calibration errors are drawn once per session (tilt, scale, mass, radius of the edges),
scan errors for every face: an edge lies where its two displaced faces meet. Does not model: a table's slope
beyond its effect on the vertical, air, a third dimension of the tip, images.
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
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.strike_task import StrikeTask
from analyze.motion.tip_angle import PlanarMotion
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.pipeline.sections import next_face_angle, rolling_outline
from analyze.planning.impact import StrikerModel
from analyze.types import TipMotion
from schemas.object_spec import MarkerSpec, ObjectSpec, Shape, object_sha256
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.strike_result import Verdict
from tests.analyze.geometry.shapes import stl
from tests.analyze.motion.drawn_strikes import T0, seen
from tests.analyze.motion.sliding import Body, push_for, simulate
from tests.analyze.planning.planned import make_plan
from tests.analyze.planning.random_bodies import KINDS, shape_of
from tests.analyze.simulated_session import manifest

STRIKES = 9
POINTS = 12_000
WALL = 0.003
RADIUS, RADIUS_SD = 1e-3, 3e-4
OWN_RADIUS = 0.3
"""sd of one edge's radius against the others, as a fraction of RADIUS_SD"""
TILT_SD = math.radians(0.2)
SCAN_SD = 3e-4
"""displacement of each face along its normal [m]"""
LINE_SD = 5e-5
"""displacement of each edge beyond that of its faces [m]"""
SCALE_SD = 2e-3
MASS_SD = 1e-4
ANGLE_SD = 2e-4
"""error of each axis's angle [rad]: lens, resting face"""
NOISE = (0.02, 0.1)
"""range of noise [deg per frame]"""
MIN_PHI = math.radians(4)
"""least phi [rad] of a body that is put down; others fall over"""
TRIES = 3
"""attempts at each planned strike until one is usable"""


@dataclass(frozen=True)
class Truth:
    """Ground truth of one session."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray
    regions: np.ndarray | None
    """(3,) true masses of shell, part above and part below the dividing plane [kg]; None for a body that is
    not a shell and two uniform parts"""
    dividing_plane_normal: np.ndarray
    """(3,) unit normal of the dividing plane in O"""
    points: np.ndarray
    masses: np.ndarray
    in_shell: np.ndarray


@dataclass(frozen=True)
class Filled:
    """Masses of a body's points."""

    masses: np.ndarray
    regions: np.ndarray | None
    dividing_plane_normal: np.ndarray


@dataclass(frozen=True)
class PlannedBody:
    """Shape with its plan, and points uniform in its volume."""

    spec: ObjectSpec
    model: ObjectModel
    plan: StrikePlan
    points: np.ndarray
    in_shell: np.ndarray


@lru_cache(maxsize=4)
def planned_body(seed: int) -> PlannedBody | None:
    """Random shape with its plan; None if it cannot be planned."""
    rng = np.random.default_rng((seed, 0xB0D1))
    triangles = shape_of(KINDS[seed % len(KINDS)], rng)
    volume = (
        float(np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum()) / 6e9
    )
    shape = stl(triangles)
    spec = ObjectSpec(
        name=f"body {seed}",
        mass_kg=min(300 * abs(volume), 0.2),
        mass_sd_kg=MASS_SD,
        shape=Shape.model_validate(
            {"file": "b.stl", "unit": "mm", "scale_sd": SCALE_SD, "surface_sd_m": SCAN_SD}
        ),
        edge_radius_m=RADIUS,
        edge_radius_sd_m=RADIUS_SD,
        shell_thickness_m=WALL,
        marker=[MarkerSpec(id=0, size_m=0.03)],
    )
    model = load_object_model(spec, shape, "b.stl")
    try:
        plan = make_plan(
            model, spec, object_sha256(spec, shape), StrikerModel(fastest_m_s=5.0), strikes=STRIKES
        )
    except PlanError:
        return None
    low, high = model.bounds
    points = rng.uniform(low, high, (POINTS, 3))
    depth = model.depth(points)
    return PlannedBody(spec, model, plan, points[depth > 0], depth[depth > 0] < WALL)


Analyse = Callable[[PlanarMotion, StrikeTask, MotionSettings], TipMotion]


def session(shape: int, seed: int, analyse: Analyse = analyse_motion) -> tuple[Evidence, Truth] | None:
    """Session on a shape, its strikes given to `analyse`; None without a plan, or if no body stands."""
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
    head = RecordingHead(
        Path("r.mcap"), stated, "c" * 64, tuple(motion.strike_id for motion in motions), files=("r.mcap",)
    )
    return Evidence((head,), spec, body.model, plan, plan.object_sha256, tuple(motions)), truth


def _drawn_truth(body: PlannedBody, rng: np.random.Generator) -> Truth | None:
    """Ground truth with a filling that lets the body stand on every face of the plan; None without one."""
    scale = 1 + rng.normal(0, SCALE_SD)
    for _ in range(40):
        filled = _in_class(body, rng) if rng.random() < 0.6 else _outside(body, rng)
        masses = body.spec.mass_kg * filled.masses / filled.masses.sum()
        points = scale * body.points
        com = masses @ points / masses.sum()
        arm = points - com
        second = (arm * masses[:, None]).T @ arm
        if all(MIN_PHI < _balance(com, strike) < math.radians(65) for strike in body.plan.strikes):
            inertia = np.trace(second) * np.eye(3) - second
            return Truth(
                float(masses.sum()),
                com,
                inertia,
                filled.regions,
                filled.dividing_plane_normal,
                points,
                masses,
                body.in_shell,
            )
    return None


def _in_class(body: PlannedBody, rng: np.random.Generator) -> Filled:
    """Filling with a wall and two uniform parts on either side of a plane; one in six leaves a part empty."""
    surface, upper = rng.uniform(0.1, 0.7), rng.uniform(0.1, 0.9)
    if rng.random() < 1 / 6:
        upper = float(rng.integers(2))
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)
    heights = body.points @ normal
    above = ~body.in_shell & (heights > np.quantile(heights[~body.in_shell], rng.uniform(0.3, 0.7)))
    parts = (body.in_shell, above, ~body.in_shell & ~above)
    shares = np.array([surface, (1 - surface) * upper, (1 - surface) * (1 - upper)])
    masses = sum(share * part / part.sum() for share, part in zip(shares, parts, strict=True))
    return Filled(np.asarray(masses), body.spec.mass_kg * shares, normal)


def _outside(body: PlannedBody, rng: np.random.Generator) -> Filled:
    """Filling with a shell and two to four lumps inside."""
    inside = np.flatnonzero(~body.in_shell)
    masses = rng.uniform(0.2, 0.6) * body.in_shell / body.in_shell.sum()
    for share in (1 - masses.sum()) * rng.dirichlet(np.ones(int(rng.integers(2, 5)))):
        off = body.points - body.points[rng.choice(inside)]
        lump = np.exp(-np.sum(off**2, axis=1) / (2 * rng.uniform(0.006, 0.02) ** 2)) * ~body.in_shell
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
    faces: dict[tuple[float, ...], float] = {}
    edges: dict[str, tuple[float, float, float]] = {}
    found: list[TipMotion] = []
    for strike in body.plan.strikes:
        rest, wall, lean = _faces_at(body.model, strike)
        below = faces.setdefault(rest, rng.normal(0, SCAN_SD))
        # A wall that is not known, as of a round rim, is one of its own.
        outer = faces.setdefault(wall or (float(len(faces)),), rng.normal(0, SCAN_SD))
        drawn = (rng.normal(0, LINE_SD), rng.normal(0, OWN_RADIUS * RADIUS_SD), rng.normal(0, ANGLE_SD))
        own, rounder, turned = edges.setdefault(strike.axis_id, drawn)
        ahead, risen = own + (outer + below * math.sin(lean)) / math.cos(lean), -below
        rho = max(radius + rounder, 1e-4)
        inset = (rho - RADIUS) * (1 + math.sin(lean)) / math.cos(lean)
        # In the rest pose, along and off the table: true minus planned position of the rounding's centre
        # line.
        at = np.array(strike.R_world_object) @ (scale * np.array(strike.pivot.point))
        off = np.array([at[0] + ahead - inset, at[2] + risen + (rho - RADIUS)])
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


def _faces_at(
    model: ObjectModel, strike: PlannedStrike
) -> tuple[tuple[float, ...], tuple[float, ...] | None, float]:
    """Resting face and side face at a pivot edge, as rounded plane equations, and the side face's lean [rad].

    The centre line of the rounding lies one radius inside both. The side face is None, and its lean 0, if no
    face of the hull passes there, as at a round rim.
    """
    forward, _, up = np.array(strike.R_world_object)
    gaps = model.hull_planes @ np.append(strike.pivot.point, 1.0) + strike.pivot.radius_m
    near = model.hull_planes[np.abs(gaps) < 5e-5]
    near = near[np.abs(near[:, :3] @ strike.pivot.direction) < 1e-3]
    rest = min(near.tolist(), key=lambda plane: float(np.dot(plane[:3], up)), default=[*-up, 0.0])
    walls = [plane for plane in near.tolist() if np.dot(plane[:3], forward) > 0.5]
    if not walls:
        return _rounded_equation(rest), None, 0.0
    wall = max(walls, key=lambda plane: float(np.dot(plane[:3], forward)))
    lean = math.atan2(float(np.dot(wall[:3], up)), float(np.dot(wall[:3], forward)))
    return _rounded_equation(rest), _rounded_equation(wall), lean


def _rounded_equation(plane: list[float]) -> tuple[float, ...]:
    return tuple(round(value, 3) + 0.0 for value in plane)


def _strike(
    body: PlannedBody,
    planned: PlannedStrike,
    planar: Body,
    off: np.ndarray,
    noise: float,
    rng: np.random.Generator,
    analyse: Analyse,
) -> TipMotion:
    """Simulate a strike until it is usable, at most three times; one in ten does not tip over."""
    motion = None
    for _ in range(TRIES):
        energy = rng.uniform(0.85, 0.97) if rng.random() < 0.1 else rng.uniform(1.03, 1.3)
        height = min(planned.impact_height_m, 0.98 * planar.height)
        course = simulate(planar, [push_for(planar, energy, height)], phase=rng.uniform(0, 1), seconds=1.0)
        tracked, _ = seen(course, planar, rng, noise)
        # Tracking follows the plan's point, which turns about the true one, with the plan's rounding.
        cos, sin = np.cos(course.theta), np.sin(course.theta)
        along = -off[0] * (cos - 1) - off[1] * sin + (planar.rho - planned.pivot.radius_m) * course.theta
        over = off[0] * sin - off[1] * (cos - 1)
        tracked = replace(
            tracked, angle=replace(tracked.angle, slip=tracked.angle.slip + along), lift=tracked.lift + over
        )
        task = StrikeTask(
            f"{planned.id}.1",
            planned,
            T0,
            None,
            rolling_outline(body.model, planned),
            next_face_angle(body.model, planned),
        )
        motion = analyse(tracked, task, MotionSettings())
        if motion.verdict in (Verdict.GOOD, Verdict.ROCKED_BACK) and motion.fit is not None:
            break
    assert motion is not None
    return motion
