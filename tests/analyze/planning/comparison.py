"""Our set of strikes beside the paper's on one body: which is singular, how near each comes to c. Used by
test and benchmark.

Same errors, same number of strikes, same estimator for both: only the choice of axes differs.
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
from analyze.planning.footing import SHARES, footing
from analyze.planning.impact import StrikerModel
from analyze.planning.information import Candidate, Errors, Information, spread
from analyze.planning.paper_plan import paper_plan
from analyze.planning.paper_strikes import paper_axis
from analyze.planning.pivots import PivotAxis, pivot_axes, swing
from analyze.planning.prepared import Prepared, prepare
from analyze.planning.refusal import refusal_message
from analyze.types import EquiPlane
from tests.analyze.planning.random_bodies import RandomBody

ANGLE_SD = np.radians(0.3)
EDGE_SD = 0.0003
K_SD = 0.01
STRIKES = 9
FRICTION = 0.6
STEEPEST = np.radians(80)
NOTHING = Errors(tilt=1e-9, axis_angle=1e-9, strike_angle=1e-9)


@dataclass(frozen=True)
class Outcome:
    """One way to plan, on one body."""

    refusal: str = ""
    """why there is no set; empty: there is one"""
    spread: float = 0.0
    """least singular value of the normals over sqrt(3 or more), c where it is; below `design.SINGULAR`:
    singular"""
    falls_over: bool = False
    """c lies beyond the support of a plane: the object cannot be put down so"""
    distances: np.ndarray | None = None
    """(draws,) m, of c from the truth"""

    @property
    def singular(self) -> bool:
        return not self.refusal and self.spread < design.SINGULAR


@dataclass(frozen=True)
class Compared:
    kind: str
    paper: Outcome
    paper_as_printed: bool
    ours: Outcome
    """edges of stable planes, chosen by information; like the paper's, not asked whether they slip or can be
    reached"""
    checked: Outcome
    """with every check"""


def compare(body: RandomBody, draws: int, seed: int) -> Compared:
    """Plan one body each way and measure it `draws` times."""
    rng = np.random.default_rng((seed, 0xC0))
    prepared = prepare(
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


def _unchecked(body: RandomBody, prepared: Prepared) -> list[Candidate]:
    """As `prepare`: of faces on which it surely stands, else also of those that hold the expected c."""
    believed = prepared.believed
    free: list[Candidate] = []
    for share in SHARES:
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
        if design.can_determine_com(Information(tuple(free), prepared.information.belief, NOTHING)):
            break
    return free


def _ours(
    body: RandomBody, prepared: Prepared, candidates: list[Candidate], draws: int, rng: np.random.Generator
) -> Outcome:
    noise = np.diag([ANGLE_SD**2, K_SD**2])
    known = tuple(replace(each, axis=replace(each.axis, sd=EDGE_SD), noise=noise) for each in candidates)
    found = design.choose_design(Information(known, prepared.information.belief, NOTHING), STRIKES)
    if found is None:
        return Outcome(
            refusal_message(prepared.model, prepared.planes, prepared.stable, known, prepared.rejected)
        )
    return outcome(body, [known[i].axis for i in found.chosen], found.repeats, draws, rng)


def outcome(
    body: RandomBody, axes: list[PivotAxis], repeats: tuple[int, ...], draws: int, rng: np.random.Generator
) -> Outcome:
    width = true_spread(axes, body.com)
    falls = any(axis.plane.margin(body.com[None]) <= 0 for axis in axes)
    if falls or width < design.SINGULAR:
        return Outcome(spread=width, falls_over=falls)
    return Outcome(spread=width, distances=measure(body, axes, repeats, draws, rng))


def true_phi(axis: PivotAxis, com: np.ndarray, shift: np.ndarray) -> float:
    arm = com - axis.point - shift
    return float(np.arctan2(-(arm @ axis.tip), arm @ axis.plane.up))


def true_spread(axes: list[PivotAxis], com: np.ndarray) -> float:
    """As the design's criterion, with c where it is."""
    return spread(
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
    """Distances (draws,) [m] of the estimate from c: an error of the edge per axis, of the angle per
    strike."""
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
