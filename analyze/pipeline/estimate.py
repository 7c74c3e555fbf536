"""Joint estimate of one object's centre of mass, inertia and region masses from its recordings.

The regions are the shell (outer wall) and the interior on either side of a plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.agreement import (
    Agreement,
    CentreDifference,
    EstimatorDisagreement,
    agreement,
    centre_difference,
    estimator_disagreements,
)
from analyze.estimation.cells import Cells
from analyze.estimation.checks import Checks
from analyze.estimation.contact_properties import ContactProperties
from analyze.estimation.edge_radii import EdgeRadius, RadiusCheck, estimated_radii
from analyze.estimation.fill_level import FillLevel
from analyze.estimation.joint import JointSolution
from analyze.estimation.labelled_parts import parts_of_bodies, parts_of_cells
from analyze.estimation.mass_properties import CentreOfMass, InertialParameters, MassDistribution
from analyze.estimation.part_masses import PartMasses, measured_moments, part_masses
from analyze.estimation.priors import Scale
from analyze.estimation.rest_turns import RestTurns
from analyze.estimation.scatter import ScatterRange, scatter_range
from analyze.estimation.sensitivity import ErrorSource, Sensitivity, sensitivity
from analyze.estimation.shape_errors import Box, box_of, shape_errors
from analyze.estimation.voxel_map import VoxelMap, voxel_map
from analyze.estimation.what_ifs import Alternative
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.filling import estimate_filling, filling_label
from analyze.pipeline.fixture import FixtureEstimate, alternatives_alone, paper_alone
from analyze.pipeline.frame_rate import (
    FrameRate,
    with_estimated_gravity,
)
from analyze.pipeline.loose_contents import LooseContents, loose_contents
from analyze.pipeline.prediction import StrikePrediction, predict_strikes
from analyze.pipeline.shells import region_masses
from analyze.pipeline.solved import (
    MIN_STRIKES,
    EstimateOptions,
    SolvedStrikes,
    recorded_in,
    solve_strikes,
)
from analyze.pipeline.surface_error import SurfaceError
from analyze.pipeline.tosses import FlightAnswer
from analyze.pipeline.what_ifs import estimate_alternatives
from analyze.planning.stable_planes import resting_planes
from analyze.tracking.print_likeness import PrintDifference, PrintedSurface
from analyze.types import EquiPlane

if TYPE_CHECKING:
    pass

from analyze.pipeline.equiplanes import turns_at_rest
from analyze.pipeline.paper import PaperEstimate, paper_estimate


@dataclass(frozen=True)
class Agreements:
    """Results of three comparisons: recordings with each other, with the paper's method, and estimators.

    The first two compare centres of mass; the paper is VISAPP 2013. Estimators are the ways to fit one
    strike's motion.
    """

    recordings: Agreement
    """agreement of the recordings' centres of mass with each other"""
    centres: CentreDifference | None
    """difference between the paper's centre of mass and ours; None without the paper's"""
    estimators: tuple[EstimatorDisagreement, ...]
    """one entry per pair of estimators that disagree on a strike; empty if none do"""


@dataclass(frozen=True)
class Estimate:
    """Joint estimate of one object's mass, centre of mass, inertia and masses of parts.

    It includes its checks and the evidence (fitted motions of all strikes) that it was made from.
    """

    evidence: Evidence
    """fitted motions of all strikes, with object, shape and plan"""
    options: EstimateOptions
    """choices of the user"""
    fitted_planes: tuple[EquiPlane, ...]
    """equi-planes (through pivot line and centre of mass) of the strikes used, as fitted, in recording order:
    perpendicular to the table at the balance angle phi, not corrected for the table's tilt"""
    inertial: InertialParameters
    """mass, centre of mass, inertia tensor and moments of the object, without its markers where the pose of
    each marker with a mass is known, otherwise with them; always without its fixture"""
    com_struck: CentreOfMass
    """centre of mass of the body that tipped, markers included"""
    scale: Scale
    """mass and gravity that the joint estimate started from"""
    solved_scale: Scale
    """mass and gravity behind moments about edges: `scale`, with gravity as estimated where it was a free
    parameter"""
    cells: Cells
    """the object, without its fixture, divided into cells, with the given or assumed shell (outer wall)"""
    distribution: MassDistribution
    """masses of the shell and of the interior on either side of a plane"""
    parts: PartMasses | None
    """masses of labelled parts; None where the object file labels none"""
    filling: FillLevel | None
    """level and mass of a filling; None where the object file names none"""
    paper: PaperEstimate | None
    """centre of mass (of the same body as `inertial`'s) and masses of shell and interior parts by the paper's
    method (VISAPP 2013); None with fewer strikes than it needs"""
    checks: Checks
    """checks of the joint estimate: predictions, gravity, possible moments, place of the centre of mass"""
    predictions: tuple[StrikePrediction, ...]
    """leave-one-out predictions of the strikes used"""
    agreements: Agreements
    """agreement between recordings, estimators and methods"""
    frame_rates: tuple[FrameRate, ...]
    """checked frame rates, one per recording whose frame times come from a video file's time stamps"""
    voxels: VoxelMap
    """density [kg/m³] by cell: of all that have the measured moments, the one of maximum entropy"""
    sensitivity: Sensitivity
    """influence of strikes and error sources on the centre of mass"""
    alternatives: tuple[Alternative, ...]
    """changes of centre of mass and moments under the what-ifs of the robustness table"""
    edge_radii: tuple[EdgeRadius, ...]
    """radii of the rounded pivot edges, as all strikes determine them"""
    radius_check: RadiusCheck | None
    """comparison of the stated edge radii with the strikes' own; None if none are stated"""
    scatter: ScatterRange
    """sd of the balance angle from strike to strike beyond the fits' errors, stated and by the strikes"""
    rest: RestTurns | None
    """turns of the object at rest before the fitted strikes, as its markers show; None if no place of a
    marker on it is known"""
    surface_error: SurfaceError | None
    """error of the shape's faces, assumed and estimated; None if the object file states it"""
    print_differences: tuple[PrintDifference, ...]
    """pairs of strikes used that show different print on one face, so that one was placed otherwise"""
    contents: LooseContents
    """tests whether the body that tipped is rigid, and its centre of mass by pose"""
    fixture: FixtureEstimate | None = None
    """body that was struck, and errors by their cause, where the object is held in a fixture; else None"""
    contact: ContactProperties | None = None
    """friction and restitution on the table; None unless `with_contact_properties` added them"""
    flight: FlightAnswer | None = None
    """answer of the tosses; part of the estimate if it agrees with the strikes; None without a good toss"""

    @property
    def com(self) -> CentreOfMass:
        """Centre of mass of the object without its markers (printed tags), with covariance.

        Position (3,) [m] and covariance (3, 3) [m^2] are in the object frame O. The markers are included if
        the pose of any marker that has a mass is not known.
        """
        return self.inertial.com

    @property
    def com_balanced(self) -> CentreOfMass:
        """Centre of mass in which the strikes' planes meet: `com`, but with the fixture if there is one."""
        return self.com if self.fixture is None else self.fixture.struck.com

    @property
    def planes(self) -> tuple[EquiPlane, ...]:
        """Equi-planes of the strikes used, in recording order, corrected for the table's estimated tilt.

        Each passes through a strike's pivot line and the centre of mass of the body that tipped. When the
        object is turned to the balance angle, the plane is parallel to gravity as estimated.
        """
        return self.com.planes


def estimate_evidence(evidence: Evidence, options: EstimateOptions | None = None) -> Estimate:
    """Estimate centre of mass, moments and masses of shell and interior parts from fitted motions.

    No files are read.

    Args:
        evidence: fitted motions of all strikes, with object, shape and plan.
        options: choices of the user; None for the defaults; `exclude` holds ids as the evidence names them.

    Returns:
        The estimate from all strikes together: inertial parameters, region masses, checks of the strikes
        against each other, and the paper's estimate (VISAPP 2013) for comparison. The same evidence and
        options give the same estimate.

    Raises:
        EstimationError: fewer than three strikes can be used and no toss is good, or parts or filling cannot
            be estimated.
        ShapeError: a label of the object file names a part that the shape does not have.
    """
    options = options or EstimateOptions()
    solved = solve_strikes(evidence, options)
    evidence, used, inertial, checks = solved.evidence, solved.used, solved.inertial, solved.checks
    spec, model, cells, solution = evidence.spec, evidence.model, solved.cells, solved.solution
    priors = (solved.systematic, solved.prior, solved.moments)
    paper, centres = _by_paper(solved)
    return Estimate(
        evidence=evidence,
        options=options,
        fitted_planes=solved.planes,
        inertial=inertial,
        com_struck=solved.struck.com,
        scale=solved.scale,
        solved_scale=with_estimated_gravity(solved.scale, solution),
        cells=cells,
        distribution=region_masses(spec, model.own, cells, inertial, np.random.default_rng(options.seed)),
        parts=_labelled_parts(evidence, cells, inertial, solution, options),
        filling=estimate_filling(
            evidence, cells, measured_moments(inertial), np.random.default_rng(options.seed)
        ),
        paper=paper,
        checks=checks,
        predictions=predict_strikes(evidence, checks.left_out),
        agreements=Agreements(
            agreement(
                solved.planes, recorded_in(evidence, used), solved.struck.com, solved.systematic, solved.prior
            ),
            centres,
            estimator_disagreements(used),
        ),
        frame_rates=solved.rates,
        voxels=voxel_map(measured_moments(inertial), cells),
        sensitivity=sensitivity(
            solution,
            solved.prior,
            solved.struck,
            inertial,
            ErrorSource.MASS if solved.fixture is None else ErrorSource.FIXTURE,
        ),
        alternatives=alternatives_alone(
            estimate_alternatives(evidence, used, solved.planes, priors, solution, solved.struck),
            solved.bare,
            solved.fixture,
            inertial,
        ),
        edge_radii=estimated_radii(solution),
        radius_check=solved.radius_check,
        scatter=scatter_range(solved.systematic, solution.factors),
        rest=turns_at_rest(evidence, used),
        surface_error=solved.surface_error,
        fixture=solved.fixture,
        contents=loose_contents(solved, options),
        print_differences=_print_differences(solved),
        flight=solved.flight,
    )


def _by_paper(solved: SolvedStrikes) -> tuple[PaperEstimate | None, CentreDifference | None]:
    """The paper's estimate for the object alone, and its distance from ours; None with too few strikes."""
    if len(solved.used) < MIN_STRIKES:
        return None, None
    paper, planes = paper_estimate(solved.evidence, solved.used, solved.struck_cells, solved.scale)
    alone = paper_alone(paper, solved.struck, solved.bare, solved.evidence.model)
    return alone, centre_difference(paper.com, planes, solved.struck.com, solved.prior)


def _print_differences(solved: SolvedStrikes) -> tuple[PrintDifference, ...]:
    """Pairs of the strikes used that show different print where the plan puts one face before the camera."""
    reports = {motion.strike_id: solved.evidence.tracking.get(motion.strike_id) for motion in solved.used}
    views = {
        name: report.rest_view
        for name, report in reports.items()
        if report is not None and report.rest_view is not None
    }
    model = solved.evidence.model
    return PrintedSurface(model.vertices, model.faces).differences(views) if len(views) > 1 else ()


def _labelled_parts(
    evidence: Evidence,
    cells: Cells,
    inertial: InertialParameters,
    solution: JointSolution,
    options: EstimateOptions,
) -> PartMasses | None:
    """Masses [kg] of the parts that the object file labels; None if it labels none, or labels a filling.

    They are estimated from the measured moments, `inertial`, and the errors of the shape in `solution`, the
    joint solution of all strikes. The parts are closed bodies of the mesh if the labels name bodies,
    otherwise the shell and layers made of `cells`, the pieces that the body is divided into.

    Raises:
        ShapeError: a label names a part that the shape does not have, or two layers overlap.
        EstimationError: there are fewer than two parts.
    """
    spec, labels = evidence.spec, evidence.spec.labels
    if not labels or filling_label(evidence) is not None:
        return None
    if evidence.bodies:
        fixed = {number for body in spec.fixture or [] for number in body.bodies}
        parts = parts_of_bodies(labels, evidence.bodies, spec.shape.file or spec.name, fixed)
    else:
        parts = parts_of_cells(labels, cells, spec.name)
    names, solids = [name for name, _ in parts], [solid for _, solid in parts]
    low, high = evidence.model.own.bounds
    whole = Box((low + high) / 2, high - low)
    boxes = [box_of(solid) if evidence.bodies else whole for solid in solids]
    faces = {plane.id: np.append(-plane.up, plane.level) for plane in resting_planes(evidence.model)}
    errors = shape_errors(solution, solids, boxes, faces)
    return part_masses(measured_moments(inertial), names, solids, np.random.default_rng(options.seed), errors)
