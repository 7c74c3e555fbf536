"""Comparison of our choice of strikes with the paper's on one body; used by a test and a benchmark.

Errors, number of strikes and estimator are the same for both: only the choice of axes differs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analyze.errors import PlanError
from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.equiplane import equiplane_normal
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.planning import design, view
from analyze.planning.examine import Bench
from analyze.planning.footing import Q_SCALES, footing
from analyze.planning.impact import StrikerModel
from analyze.planning.information import Candidate, Information, SharedErrors, normal_spread
from analyze.planning.paper_plan import paper_plan
from analyze.planning.paper_strikes import paper_axis
from analyze.planning.pivots import PivotAxis, pivot_axes, swing
from analyze.planning.prepared import PreparedObject, prepare_object
from analyze.planning.refusal import refusal_message
from analyze.types import EquiPlane
from tests.analyze.planning.random_bodies import RandomBody

ANGLE_SD = np.radians(0.3)
EDGE_SD = 0.0003
K_SD = 0.01
STRIKES = 9
FRICTION = 0.6
STEEPEST = np.radians(80)
NO_SHARED_ERRORS = SharedErrors(tilt=1e-9, axis_angle=1e-9, strike_angle=1e-9)


@dataclass(frozen=True)
class Outcome:
    """Set of axes that one planning method chose for a body, and the precision it reaches."""

    refusal: str = ""
    """reason why there is no set; empty if there is one"""
    spread: float = 0.0
    """`normal_spread` of the equi-planes at the true c; singular below `design.MIN_NORMAL_SPREAD`"""
    falls_over: bool = False
    """True if the true c lies outside the support of a plane, so that the object falls over"""
    distances: np.ndarray | None = None
    """(draws,) distances of the estimate from the true c [m]; None if there is no estimate"""

    @property
    def singular(self) -> bool:
        return not self.refusal and self.spread < design.MIN_NORMAL_SPREAD


@dataclass(frozen=True)
class Compared:
    """Outcomes of the paper's and our planning for one body."""

    kind: str
    paper: Outcome
    paper_as_printed: bool
    ours: Outcome
    """edges of stable planes chosen by information; like the paper's, without checks of slip and reach"""
    checked: Outcome
    """edges chosen like `ours`, with every check of the axes, such as those of slip and reach"""


def compare(body: RandomBody, draws: int, seed: int) -> Compared:
    """Plan one body by each method and simulate the estimate of c `draws` times."""
    rng = np.random.default_rng((seed, 0xC0))
    prepared = prepare_object(
        body.model, body.spec, Bench(StrikerModel(fastest_m_s=5.0), view.default_camera(), FRICTION)
    )
    try:
        found = paper_plan(body.model, body.spec.mass_kg)
        axes = [
            replace(paper_axis(prepared, strike, f"paper{i}"), sd=EDGE_SD)
            for i, strike in enumerate(found.struck)
        ]
        paper, printed = outcome(body, axes, (STRIKES // 3,) * 3, draws, rng), found.as_printed
    except PlanError as error:
        paper, printed = Outcome(str(error)), False
    return Compared(
        body.kind,
        paper,
        printed,
        _ours(body, prepared, _unchecked(body, prepared), draws, rng),
        _ours(body, prepared, [each.candidate for each in prepared.usable], draws, rng),
    )


def _unchecked(body: RandomBody, prepared: PreparedObject) -> list[Candidate]:
    """Candidates on the faces that `prepare_object` chooses, without its checks of the axes."""
    believed = prepared.believed
    free: list[Candidate] = []
    for share in Q_SCALES:
        every = pivot_axes(
            body.model, body.spec, footing(body.model, prepared.planes, believed.region, share), believed
        )
        swings = [
            swing(axis, believed.region.centre, body.spec.mass_kg, believed.unit_inertia, 9.81)
            for axis in every
        ]
        free = [
            Candidate(axis, expected, np.eye(2))
            for axis, expected in zip(every, swings, strict=True)
            if expected.phi < STEEPEST
        ]
        if design.can_determine_com(Information(tuple(free), prepared.information.belief, NO_SHARED_ERRORS)):
            break
    return free


def _ours(
    body: RandomBody,
    prepared: PreparedObject,
    candidates: list[Candidate],
    draws: int,
    rng: np.random.Generator,
) -> Outcome:
    noise = np.diag([ANGLE_SD**2, K_SD**2])
    known = tuple(replace(each, axis=replace(each.axis, sd=EDGE_SD), noise=noise) for each in candidates)
    found = design.choose_design(Information(known, prepared.information.belief, NO_SHARED_ERRORS), STRIKES)
    if found is None:
        information = replace(prepared.information, candidates=known)
        return Outcome(refusal_message(replace(prepared, information=information)))
    return outcome(body, [known[i].axis for i in found.chosen], found.repeats, draws, rng)


def outcome(
    body: RandomBody, axes: list[PivotAxis], repeats: tuple[int, ...], draws: int, rng: np.random.Generator
) -> Outcome:
    width = true_spread(axes, body.com)
    falls = any(axis.plane.margin(body.com[None]) <= 0 for axis in axes)
    if falls or width < design.MIN_NORMAL_SPREAD:
        return Outcome(spread=width, falls_over=falls)
    return Outcome(spread=width, distances=measure(body, axes, repeats, draws, rng))


def true_phi(axis: PivotAxis, com: np.ndarray, shift: np.ndarray) -> float:
    arm = com - axis.point - shift
    return float(np.arctan2(-(arm @ axis.tip), arm @ axis.plane.up))


def true_spread(axes: list[PivotAxis], com: np.ndarray) -> float:
    """`normal_spread` of the axes' equi-planes at the true c."""
    return normal_spread(
        np.array(
            [
                equiplane_normal(axis.direction, axis.plane.up, true_phi(axis, com, np.zeros(3)))
                for axis in axes
            ]
        )
    )


def measure(
    body: RandomBody, axes: list[PivotAxis], repeats: tuple[int, ...], draws: int, rng: np.random.Generator
) -> np.ndarray:
    """Distances (draws,) [m] of the estimate from the true c.

    Each axis has an error of its edge, each strike one of its angle.
    """
    systematic = SystematicErrors(gravity_tilt_sd=1e-9, axis_angle_sd=1e-9, strike_angle_sd=1e-9)
    prior = ComPrior.from_bounds(body.model.bounds[0], body.model.bounds[1])
    distances = np.zeros(draws)
    for draw in range(draws):
        planes = []
        for axis, many in zip(axes, repeats, strict=True):
            shift = EDGE_SD * (rng.standard_normal() * axis.tip + rng.standard_normal() * axis.plane.up)
            phis = true_phi(axis, body.com, shift) + ANGLE_SD * rng.standard_normal(many)
            planes += [_plane(f"{axis.id}.{i}", axis, float(phi)) for i, phi in enumerate(phis)]
        distances[draw] = np.linalg.norm(centre_of_mass(planes, systematic, prior).position - body.com)
    return distances


def _plane(name: str, axis: PivotAxis, phi: float) -> EquiPlane:
    normal = equiplane_normal(axis.direction, axis.plane.up, phi)
    return EquiPlane(
        name,
        axis.id,
        axis.point,
        axis.direction,
        axis.plane.up,
        normal,
        phi,
        float(ANGLE_SD),
        None,
        None,
        0.0,
        axis.radius,
        EDGE_SD,
    )
