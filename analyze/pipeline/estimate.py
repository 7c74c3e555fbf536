"""From recordings to everything Percuss says about the object: what their strikes showed (evidence.py), joined, estimated, written down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analyze.errors import EstimationError
from analyze.estimation.agreement import agreement, centres_apart, estimators_apart
from analyze.estimation.cells import Cells, cells_from_voxels, wall_thickness
from analyze.estimation.checks import check
from analyze.estimation.equiplane import equiplane, equiplane_from_fit
from analyze.estimation.inertia import parameters_of, shape_prior
from analyze.estimation.joint import Moments, solve_joint
from analyze.estimation.labelled_parts import parts_of_bodies, parts_of_cells
from analyze.estimation.markers import can_subtract, without_markers
from analyze.estimation.paper import PaperCentre, PaperRegions, paper_axis_inertia, paper_centre_of_mass, paper_regions
from analyze.estimation.part_masses import PartMasses, measured_moments, part_masses
from analyze.estimation.sensitivity import Sensitivity, sensitivity
from analyze.estimation.stated import ComPrior, Scale, SystematicErrors, TiltPrior
from analyze.estimation.voxel_map import VoxelMap, voxel_map
from analyze.geometry.voxels import voxelise
from analyze.pipeline.evidence import Evidence, Progress, RecordingHead, read_evidence, read_head
from analyze.pipeline.filling import filling_document, filling_label, filling_of, filling_warnings
from analyze.pipeline.frame_rate import borne_out, felt, frame_times, stated_scale
from analyze.pipeline.merge import in_order, join, levels_of, paths_text, refuse_apart, strikes_to_leave_out
from analyze.pipeline.prediction import ForetoldStrike, foretold_strikes
from analyze.pipeline.shells import regions_of
from analyze.pipeline.too_few import too_few
from analyze.report.summary import render_summary
from analyze.result.agreements import Agreements
from analyze.result.assessment import assessment
from analyze.result.document import build_result, result_json
from analyze.result.tilt import table_tilts
from analyze.result.warnings import result_warnings
from analyze.types import Array, CentreOfMass, EquiPlane, InertialParameters, MassDistribution, MotionFit, TipMotion
from schemas.document import sha256_text
from schemas.result import JoinedRecording, Result, ResultInputs, Verdict
from schemas.session_manifest import SessionManifest
from schemas.strike_plan import PlannedStrike

__all__ = ["Estimate", "EstimateOptions", "estimate_evidence", "estimate_recording", "estimate_recordings", "render_summary"]

CELLS = 4000
LEAST_STRIKES = 3
USABLE = (Verdict.GOOD, Verdict.ROCKED_BACK)
"""a strike that rocked back is data as well, if its motion could be fitted"""


@dataclass(frozen=True)
class EstimateOptions:
    """What the user may change."""

    object_path: Path | None = None
    """use this object file instead of the recording's"""
    exclude: frozenset[str] = frozenset()
    """ids of strikes to leave out"""
    estimator: str | None = None
    """whose phi and k are used: pivot_fit, rolling_fit, moment_balance, sign_change; None: of each strike the one that suits its motion"""
    seed: int = 0


@dataclass(frozen=True)
class Estimate:
    """Everything about one object: the Result document and what stands behind it."""

    result: Result
    evidence: Evidence
    planes: tuple[EquiPlane, ...]
    """of the strikes used, in the order of the recordings; upright in gravity as the table was found to slope"""
    com: CentreOfMass
    com_paper: PaperCentre
    inertial: InertialParameters
    cells: Cells
    distribution: MassDistribution
    distribution_paper: PaperRegions | None
    scale: Scale
    voxels: VoxelMap
    foretold: tuple[ForetoldStrike, ...]
    """as `planes`"""
    sensitivity: Sensitivity
    com_struck: CentreOfMass
    """of the body that tipped, with its markers"""

    def json(self) -> str:
        """The Result as one line: the same bytes for the same recordings."""
        return result_json(self.result)


def estimate_recording(path: Path, options: EstimateOptions | None = None, progress: Progress | None = None) -> Estimate:
    """Everything from one recording; see `estimate_recordings`."""
    return estimate_recordings([path], options, progress)


def estimate_recordings(paths: Sequence[Path], options: EstimateOptions | None = None, progress: Progress | None = None) -> Estimate:
    """Everything from one recording, or from several of one object, whatever their order.

    Args:
        paths: the recordings (MCAP).
        options: what the user changes.
        progress: called with (text, done, total) before each strike.

    Raises:
        RecordingError: a file cannot be read.
        JoinError: the recordings are not of one object, or one is named twice.
        ShapeError: the object's shape cannot be used.
        PlanError: a plan is of another object.
        EstimationError: too few good strikes.
    """
    options = options or EstimateOptions()
    heads = in_order([read_head(path) for path in paths])
    if len(heads) > 1:
        refuse_apart(heads, options.object_path is not None)
    options = replace(options, exclude=strikes_to_leave_out(heads, options.exclude))
    total, done = sum(len(head.strike_ids) for head in heads), 0
    read: list[Evidence] = []
    for head in heads:
        read.append(read_evidence(head, options.object_path, _counted_on(progress, done, total)))
        done += len(head.strike_ids)
    if progress is not None:
        progress("estimating", total, total)
    try:
        return estimate_evidence(join(read), options)
    except EstimationError as error:
        raise EstimationError(f"{paths_text(heads)}: {error}") from None


def _counted_on(progress: Progress | None, before: int, total: int) -> Progress | None:
    if progress is None:
        return None
    return lambda text, done, _: progress(text, before + done, total)


def estimate_evidence(evidence: Evidence, options: EstimateOptions | None = None) -> Estimate:
    """Centre of mass, moments and regions from fitted motions; pure.

    Raises:
        EstimationError: fewer than three strikes can be used.
    """
    options = options or EstimateOptions()
    spec, model = evidence.spec, evidence.model
    used = [motion for motion in evidence.motions if _usable(motion, options)]
    if len(used) < LEAST_STRIKES:
        usable = [motion.strike_id for motion in evidence.motions if _usable(motion, EstimateOptions())]
        raise EstimationError(too_few(LEAST_STRIKES, evidence.motions, usable, options.exclude, evidence.plan))
    planes = equiplanes(evidence, used, options.estimator)
    systematic, prior = systematic_errors(evidence), ComPrior.from_bounds(model.bounds[0], model.bounds[1])
    scale = stated_scale(evidence)
    cells = cells_from_voxels(voxelise(model, (model.volume / CELLS) ** (1 / 3), wall_thickness(spec, model)))
    times = frame_times(evidence, planes, systematic, prior, Moments(scale, shape_prior(cells)), cells)
    planes, scale = borne_out(evidence, planes, scale, times)
    moments = Moments(scale, shape_prior(cells))
    solution = solve_joint(planes, systematic, prior, moments)
    whole = parameters_of(solution, prior, scale)
    checks = check(planes, systematic, prior, moments, solution, (model.hull_vertices, model.hull_planes))
    foretold = foretold_strikes(evidence, checks.left_out)
    recordings_agree = agreement(planes, [evidence.recorded_in.get(plane.strike_id, 0) for plane in planes], whole.com, systematic, prior)
    inertial = without_markers(whole, spec.marker) if can_subtract(spec.marker) else whole
    com = inertial.com
    distribution = regions_of(spec, model, cells, inertial, np.random.default_rng(options.seed))
    # The sign change needs a passage over the balance; strikes that rocked back serve only where there are no others.
    over = [motion for motion in used if motion.verdict is Verdict.GOOD]
    followed = over if len(over) >= LEAST_STRIKES else used
    by_sign_change = tuple(_paper_plane(evidence.planned(motion), motion) for motion in followed)
    com_paper = paper_centre_of_mass(by_sign_change, cells)
    regions_paper = _paper_regions(by_sign_change, followed, com_paper.position, scale, cells)
    agreed = Agreements(recordings_agree, centres_apart(com_paper, by_sign_change, whole.com, prior), estimators_apart(used))
    com_paper = replace(com_paper, position=com_paper.position + com.position - whole.com.position)
    parts = _parts(evidence, cells, inertial, options)
    label = filling_label(evidence)
    filled = filling_of(evidence, cells, measured_moments(inertial), np.random.default_rng(options.seed))
    filling = None if filled is None or label is None else filling_document(label.name, filled)
    voxels = voxel_map(measured_moments(inertial), cells)
    result = build_result(
        inputs=_inputs(evidence, options),
        motions=evidence.motions,
        planned=[evidence.planned(motion) for motion in evidence.motions],
        excluded=options.exclude,
        planes=planes,
        inertial=inertial,
        scale=felt(scale, solution),
        distribution=distribution,
        com_paper=com_paper,
        distribution_paper=regions_paper,
        warnings=[
            *result_warnings(evidence, options, planes, inertial, distribution, agreed, parts, checks, foretold, times),
            *filling_warnings(filling),
        ],
        table_tilt=table_tilts(inertial.com, evidence),
        verdict=assessment(inertial, distribution, checks, foretold, agreed.estimators, times),
        parts=parts,
        foretold=foretold,
        filling=filling,
        frame_times=times or None,
    )
    moves = sensitivity(solution, systematic, prior, whole, inertial)
    return Estimate(
        result,
        evidence,
        com.planes,
        com,
        com_paper,
        inertial,
        cells,
        distribution,
        regions_paper,
        scale,
        voxels,
        foretold,
        moves,
        whole.com,
    )


def _parts(evidence: Evidence, cells: Cells, inertial: InertialParameters, options: EstimateOptions) -> PartMasses | None:
    """Masses of the parts that the object file labels; None where it labels none."""
    spec, labels = evidence.spec, evidence.spec.labels
    if not labels or filling_label(evidence) is not None:
        return None
    if evidence.bodies:
        parts = parts_of_bodies(labels, evidence.bodies, spec.shape.file or spec.name)
    else:
        parts = parts_of_cells(labels, cells, spec.name)
    names, solids = [name for name, _ in parts], [solid for _, solid in parts]
    return part_masses(measured_moments(inertial), names, solids, np.random.default_rng(options.seed))


def _usable(motion: TipMotion, options: EstimateOptions) -> bool:
    return motion.fit is not None and motion.verdict in USABLE and motion.strike_id not in options.exclude


def equiplanes(evidence: Evidence, motions: Sequence[TipMotion], estimator: str | None = None) -> tuple[EquiPlane, ...]:
    """Equi-planes of fitted motions; k, which goes with g, as it would be where the first recording was made."""
    levels = levels_of(evidence.recordings)
    found: list[EquiPlane] = []
    for motion in motions:
        plane = _plane(evidence.planned(motion), motion, estimator)
        index = evidence.recorded_in.get(motion.strike_id, 0)
        faster = evidence.manifest.g_m_s2 / evidence.recordings[index].manifest.g_m_s2
        k = None if plane.k is None else plane.k * faster
        sd_k = None if plane.sd_k is None else plane.sd_k * faster
        found.append(replace(plane, k=k, sd_k=sd_k, cov_phi_k=plane.cov_phi_k * faster, level=levels[index]))
    return tuple(found)


def systematic_errors(evidence: Evidence) -> SystematicErrors:
    """What the strikes share: of several recordings the object's errors, and gravity's tilt where they stand on one levelling."""
    tilts = {level: each.manifest for level, each in zip(levels_of(evidence.recordings), evidence.recordings, strict=True)}
    return SystematicErrors(
        gravity_tilt_sd=tilts[0].gravity_tilt_sd_rad,
        scale_sd=evidence.spec.shape.scale_sd,
        edge_radius_sd=evidence.spec.edge_radius_sd_m,
        other_tilt_sds=tuple(tilts[level].gravity_tilt_sd_rad for level in range(1, len(tilts))),
        readings=tuple(_level_read(tilts[level]) for level in range(len(tilts))),
    )


def _level_read(manifest: SessionManifest) -> TiltPrior | None:
    read = manifest.level
    if read is None:
        return None
    sideways = manifest.gravity_tilt_sd_rad if read.towards_y_sd_rad is None else read.towards_y_sd_rad
    return TiltPrior((read.towards_x_rad, read.towards_y_rad), (read.towards_x_sd_rad, sideways))


def _plane(planned: PlannedStrike, motion: TipMotion, estimator: str | None) -> EquiPlane:
    if estimator is None or (motion.fit is not None and motion.fit.estimator == estimator):
        return equiplane(motion.strike_id, planned, motion)
    chosen = next((fit for fit in motion.alternatives if fit.estimator == estimator), None)
    return equiplane(motion.strike_id, planned, motion) if chosen is None else equiplane_from_fit(motion.strike_id, planned, chosen)


def _paper_plane(planned: PlannedStrike, motion: TipMotion) -> EquiPlane:
    """By the paper's sign change of the acceleration, where it was found."""
    found = _sign_change(motion)
    return equiplane(motion.strike_id, planned, motion) if found is None else equiplane_from_fit(motion.strike_id, planned, found)


def _sign_change(motion: TipMotion) -> MotionFit | None:
    return next((fit for fit in motion.alternatives if fit.estimator == "sign_change"), None)


def _paper_regions(
    planes: Sequence[EquiPlane], motions: Sequence[TipMotion], com: Array, scale: Scale, cells: Cells
) -> PaperRegions | None:
    """By the paper's own angles, centre of mass and moments about the edges (means of its strikes), of the body with its markers."""
    moments: dict[str, list[float]] = {}
    for plane, motion in zip(planes, motions, strict=True):
        fit = _sign_change(motion) or motion.fit
        found = None if fit is None else paper_axis_inertia(plane, motion, fit, com, scale.mass * scale.gravity)
        if found is not None:
            moments.setdefault(plane.axis_id, []).append(found.i_edge)
    one_per_axis = {plane.axis_id: plane for plane in planes}
    about_edges = {axis_id: float(np.mean(each)) for axis_id, each in moments.items()}
    return paper_regions(list(one_per_axis.values()), com, about_edges, scale.mass, cells)


def _inputs(evidence: Evidence, options: EstimateOptions) -> ResultInputs:
    settings = f"{sorted(options.exclude)} {options.estimator} {options.seed}"
    recordings = evidence.recordings
    one = recordings[0]
    plans = sorted({each.manifest.plan_sha256 for each in recordings})
    return ResultInputs(
        recording_id=" + ".join(each.manifest.recording_id for each in recordings),
        content_id=one.content_id if len(recordings) == 1 else sha256_text("\n".join(sorted(each.content_id for each in recordings))),
        object_sha256=evidence.object_sha256,
        plan_sha256=plans[0] if len(plans) == 1 else sha256_text("\n".join(plans)),
        configuration_sha256=sha256_text(settings),
        software=evidence.software,
        recordings=None if len(recordings) == 1 else [_joined_recording(i + 1, each) for i, each in enumerate(recordings)],
    )


def _joined_recording(number: int, head: RecordingHead) -> JoinedRecording:
    manifest = head.manifest
    return JoinedRecording(
        number=number,
        recording_id=manifest.recording_id,
        content_id=head.content_id,
        created=manifest.created,
        plan_sha256=manifest.plan_sha256,
    )
