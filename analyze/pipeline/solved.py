"""Joint solution of a set of strikes with its checks: the part of an estimate that every answer needs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from analyze.errors import EstimationError
from analyze.estimation.cells import Cells, cells_from_voxels, shell_thickness
from analyze.estimation.checks import Checks, check_solution
from analyze.estimation.edge_radii import RadiusCheck, without_refuted_radii
from analyze.estimation.fixture import fixture_prior
from analyze.estimation.inertia import inertial_parameters_from_joint, shape_prior
from analyze.estimation.joint import JointSolution, MomentModel, solve_joint
from analyze.estimation.markers import can_subtract, without_markers
from analyze.estimation.mass_properties import InertialParameters
from analyze.estimation.moment_prior import widened, with_flight
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from analyze.estimation.profile import profiled_posterior
from analyze.geometry.voxels import voxelise
from analyze.pipeline.equiplanes import equiplanes, systematic_errors
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.fixture import FixtureEstimate, object_alone
from analyze.pipeline.frame_rate import FrameRate, check_frame_rates, drop_untimed_k, stated_scale
from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.rim_heading import with_heading_errors
from analyze.pipeline.surface_error import SurfaceError, with_surface_error
from analyze.pipeline.too_few import contradiction_text, too_few_text
from analyze.pipeline.tosses import FlightAnswer, answer_of_flights, disagreement
from analyze.types import EquiPlane, TipMotion
from schemas.strike_result import USABLE_VERDICTS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.geometry.object_model import ObjectModel
    from schemas.object_spec import ObjectSpec

CELLS = 4000
"""approximate number of cells that the body's volume is divided into"""
PRIOR_WIDENING = 10.0
"""factor on the shape's prior of the moments where strikes are compared with tosses"""
MIN_STRIKES = 3
"""fewest usable strikes for an estimate without tosses"""


@dataclass(frozen=True)
class EstimateOptions:
    """Choices of the user for one estimate: object file, strikes to leave out, estimator, random seed."""

    object_path: Path | None = None
    """object file that replaces the recording's; None to use the recording's"""
    exclude: frozenset[str] = frozenset()
    """ids of strikes to leave out; with the recording's number before them if several hold such an id"""
    estimator: str | None = None
    """estimator of balance angle phi and rate constant k: pivot_fit, rolling_fit, moment_balance or
    sign_change; None for the one that suits each motion"""
    seed: int = 0
    """seed of the random draws behind region, part and filling intervals"""


@dataclass(frozen=True)
class SolvedStrikes:
    """Joint solution of the strikes used, with priors, inertial parameters and checks."""

    evidence: Evidence
    """evidence, with the error of the shape's faces that the strikes show"""
    used: tuple[TipMotion, ...]
    """motions of the strikes used, in recording order"""
    planes: tuple[EquiPlane, ...]
    """equi-planes (through pivot line and centre of mass) of these motions; k is left out where its time is
    not sure"""
    systematic: SystematicErrors
    """errors that strikes share"""
    prior: ComPrior
    """prior of the centre of mass"""
    moments: MomentModel
    """mass, gravity, and the shape's prior of the moments"""
    scale: Scale
    """mass and gravity that the solution started from"""
    solution: JointSolution
    """unknowns with covariance, and the strikes' robust weights"""
    struck: InertialParameters
    """inertial parameters of the body that tipped"""
    bare: InertialParameters
    """those without markers, where their poses are known"""
    inertial: InertialParameters
    """those of the object alone: without markers, without fixture"""
    fixture: FixtureEstimate | None
    """body that was struck, and errors by their cause, where the object is held in a fixture"""
    checks: Checks
    """checks of the solution"""
    radius_check: RadiusCheck | None
    """comparison of the stated edge radii with the strikes' own; None if none are stated"""
    rates: tuple[FrameRate, ...]
    """checked frame rates of recordings whose times come from a video file"""
    surface_error: SurfaceError | None
    """error of the shape's faces, assumed and estimated; None if the object file states it"""
    flight: FlightAnswer | None
    """answer of the tosses; used in the solution if it agrees with the strikes; None without a good toss"""
    struck_cells: Cells
    """the body that tipped, divided into cells"""
    cells: Cells
    """the object, without its fixture, divided into cells"""


def solve_strikes(evidence: Evidence, options: EstimateOptions) -> SolvedStrikes:
    """Solve for centre of mass and moments from all usable strikes together, and check the solution.

    Args:
        evidence: fitted motions of all strikes, with object, shape and plan.
        options: choices of the user.

    Raises:
        EstimationError: fewer than three strikes can be used, and no toss is good or these contradict it.
    """
    flight = answer_of_flights(evidence, placed_markers(evidence.spec), options.exclude)
    used = _used_motions(evidence, options, 0 if flight is not None else MIN_STRIKES)
    prior = ComPrior.from_bounds(*evidence.model.bounds)
    evidence, surface_error = with_surface_error(evidence, used, prior, options.estimator)
    spec, model, systematic = evidence.spec, evidence.model, systematic_errors(evidence)
    stated_planes, radius_check = without_refuted_radii(
        equiplanes(evidence, used, options.estimator), recorded_in(evidence, used), systematic, prior
    )
    stated_planes = with_heading_errors(stated_planes, evidence, systematic, prior)
    scale = stated_scale(evidence)
    struck_cells = body_cells(spec, model)
    cells = struck_cells if model.held is None else body_cells(spec, model.own)
    prior_of_moments = shape_prior(cells)
    if model.held is not None:
        prior_of_moments = fixture_prior(model.held, prior_of_moments)
    moments = MomentModel(scale, prior_of_moments)
    rates = check_frame_rates(evidence, stated_planes, systematic, prior, moments, struck_cells)
    planes, scale = drop_untimed_k(evidence, stated_planes, scale, rates)
    moments = replace(moments, scale=scale)
    solution = solve_joint(planes, systematic, prior, moments)
    if flight is not None:
        flight = _compared(flight, planes, systematic, prior, moments, solution)
        if not flight.agrees and len(used) < MIN_STRIKES:
            raise EstimationError(contradiction_text(flight.disagreement, len(used)))
        if flight.agrees:
            moments = replace(moments, prior=with_flight(moments.prior, flight.estimate))
            solution = solve_joint(planes, systematic, prior, moments, solution)
    posterior = profiled_posterior(planes, systematic, prior, moments, solution)
    struck = inertial_parameters_from_joint(solution, prior, scale, posterior)
    checks = check_solution(
        planes, systematic, prior, moments, solution, (model.hull_vertices, model.hull_planes)
    )
    bare = without_markers(struck, spec.marker) if can_subtract(spec.marker) else struck
    inertial, fixture = object_alone(bare, model)
    return SolvedStrikes(
        evidence=evidence,
        used=tuple(used),
        planes=tuple(planes),
        systematic=systematic,
        prior=prior,
        moments=moments,
        scale=scale,
        solution=solution,
        struck=struck,
        bare=bare,
        inertial=inertial,
        fixture=fixture,
        checks=checks,
        radius_check=radius_check,
        rates=tuple(rates),
        surface_error=surface_error,
        flight=flight,
        struck_cells=struck_cells,
        cells=cells,
    )


def _compared(
    flight: FlightAnswer,
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel,
    alone: JointSolution,
) -> FlightAnswer:
    """Answer of the tosses with its disagreement with the strikes' own, and with what those determine.

    Args:
        flight: answer of the tosses.
        planes: equi-planes of the strikes; without any the tosses are not compared.
        systematic: errors that strikes share.
        prior: prior of the centre of mass.
        moments: mass, gravity, and the shape's prior of the moments.
        alone: solution of the strikes without the tosses.
    """
    by_strikes = inertial_parameters_from_joint(alone, prior, moments.scale)
    flight = replace(flight, sd_without=by_strikes.inertia_sd, measured_without=by_strikes.measured)
    if not planes:
        return flight
    # What the strikes measured, not what the shape suggests: a lump far from the middle refutes that.
    wide = replace(moments, prior=widened(moments.prior, PRIOR_WIDENING))
    measured = solve_joint(planes, systematic, prior, wide, alone)
    tossed = replace(wide, prior=with_flight(wide.prior, flight.estimate))
    both = solve_joint(planes, systematic, prior, tossed, alone)
    return replace(flight, disagreement=disagreement(flight.estimate, measured, both))


def recorded_in(evidence: Evidence, motions: Sequence[TipMotion]) -> list[int]:
    """Number of the recording that holds each motion's strike."""
    return [evidence.recorded_in.get(motion.strike_id, 0) for motion in motions]


def body_cells(spec: ObjectSpec, model: ObjectModel) -> Cells:
    """A body divided into about `CELLS` cells, with its given or an assumed shell (outer wall)."""
    pitch = (model.volume / CELLS) ** (1 / 3)
    return cells_from_voxels(voxelise(model, pitch, shell_thickness(spec, model)))


def _used_motions(evidence: Evidence, options: EstimateOptions, needed: int) -> list[TipMotion]:
    """Motions to estimate from: fitted, tipped over or rocked back, and not excluded by the user.

    They are in recording order.

    Args:
        evidence: motions of all strikes.
        options: choices of the user, of which the strikes to exclude are used.
        needed: least number of motions.

    Raises:
        EstimationError: there are fewer than `needed`.
    """
    usable = usable_motions(evidence)
    used = [motion for motion in usable if motion.strike_id not in options.exclude]
    if len(used) < needed:
        ids = [motion.strike_id for motion in usable]
        raise EstimationError(
            too_few_text(needed, evidence.motions, ids, options.exclude, evidence.plan, evidence.tosses)
        )
    return used


def usable_motions(evidence: Evidence) -> list[TipMotion]:
    """Motions that have a fit, of an object that tipped over or rocked back, in recording order."""
    return [
        motion for motion in evidence.motions if motion.fit is not None and motion.verdict in USABLE_VERDICTS
    ]
