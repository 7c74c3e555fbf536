"""From a recording to everything Percuss says about the object. The only place where the stages meet I/O. Never reads /truth/."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from analyze.errors import EstimationError, PlanError, TrackingError
from analyze.estimation.cells import Cells, cells_from_voxels, wall_thickness
from analyze.estimation.centre_of_mass import ComPrior, SystematicErrors, centre_of_mass
from analyze.estimation.equiplane import equiplane, equiplane_from_fit
from analyze.estimation.inertia import Scale, inertia_prior, inertial_parameters
from analyze.estimation.paper import PaperCentre, PaperRegions, paper_centre_of_mass, paper_regions
from analyze.estimation.regions import mass_distribution
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.geometry.voxels import voxelise
from analyze.motion.strike import StrikeTask, analyse_strike
from analyze.object_files import object_files
from analyze.recording import Recording, open_recording
from analyze.results.document import build_result, result_json
from analyze.results.summary import render_summary
from analyze.results.warnings import result_warnings
from analyze.too_few import too_few
from analyze.tracking.camera_model import camera_from_spec
from analyze.tracking.track import TrackingReport, track_markers
from analyze.types import CentreOfMass, EquiPlane, InertialParameters, Marker, MassDistribution, TipMotion
from schemas.documents import (
    ObjectSpec,
    PlannedStrike,
    Result,
    ResultInputs,
    SessionManifest,
    StrikePlan,
    Verdict,
    object_sha256,
    sha256_text,
)
from schemas.proto import percuss_pb2 as pb
from schemas.software import software_version

__all__ = ["Estimate", "EstimateOptions", "Evidence", "estimate_evidence", "estimate_recording", "render_summary"]

CELLS = 4000
LEAST_STRIKES = 3
USABLE = (Verdict.GOOD, Verdict.ROCKED_BACK)
"""a strike that rocked back is data as well, if its motion could be fitted"""
OVERRIDE_TOLERANCE = 0.05
"""of the longest edge, by which an object file given afterwards may move the edges that were planned"""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class EstimateOptions:
    """What the user may change."""

    object_path: Path | None = None
    """use this object file instead of the recording's"""
    exclude: frozenset[str] = frozenset()
    """ids of strikes to leave out"""
    estimator: str = "pivot_fit"
    """whose phi and k are used: pivot_fit or sign_change"""
    seed: int = 0


@dataclass(frozen=True)
class Evidence:
    """What the strikes showed, before anything is estimated from it."""

    manifest: SessionManifest
    spec: ObjectSpec
    model: ObjectModel
    plan: StrikePlan
    content_id: str
    object_sha256: str
    motions: tuple[TipMotion, ...]
    """in the order of the recording"""
    tracking: Mapping[str, TrackingReport] = field(default_factory=dict)
    """by strike id"""
    object_path_used: bool = False
    frames_lost: Mapping[str, int] = field(default_factory=dict)
    """in each strike's window, by strike id"""
    software: str = "percuss"
    """the program that read the recording"""
    files: tuple[str, ...] = ()
    """names of the recording's files"""
    missing_files: tuple[int, ...] = ()
    """numbers of its files that were not there"""

    def planned(self, motion: TipMotion) -> PlannedStrike:
        """The plan's entry for a strike."""
        return next(strike for strike in self.plan.strikes if strike.id == motion.plan_strike_id)


@dataclass(frozen=True)
class Estimate:
    """Everything about one recording: the Result document and what stands behind it."""

    result: Result
    evidence: Evidence
    planes: tuple[EquiPlane, ...]
    """of the strikes used, in the order of the recording"""
    com: CentreOfMass
    com_paper: PaperCentre
    inertial: InertialParameters
    cells: Cells
    distribution: MassDistribution
    distribution_paper: PaperRegions | None
    scale: Scale

    def json(self) -> str:
        """The Result as one line: the same bytes for the same recording."""
        return result_json(self.result)


def estimate_recording(path: Path, options: EstimateOptions | None = None, progress: Progress | None = None) -> Estimate:
    """Everything from one recording.

    Args:
        path: the recording (MCAP).
        options: what the user changes.
        progress: called with (text, done, total) after each strike.

    Raises:
        RecordingError: the file cannot be read.
        ShapeError: the object's shape cannot be used.
        PlanError: the plan is of another object.
        EstimationError: too few good strikes.
    """
    options = options or EstimateOptions()
    evidence = read_evidence(path, options, progress)
    try:
        return estimate_evidence(evidence, options)
    except EstimationError as error:
        raise EstimationError(f"{path}: {error}") from None


def read_evidence(path: Path, options: EstimateOptions, progress: Progress | None = None) -> Evidence:
    """Track the markers and fit the motion of every strike. Errors as `estimate_recording`."""
    with open_recording(path) as recording:
        spec, shape_bytes, shape_name = recording.object_spec, recording.shape_bytes, recording.object_spec.shape.file or str(path)
        _refuse_other_plan(recording)
        if options.object_path is not None:
            files = object_files(options.object_path)
            spec, shape_bytes, shape_name = files.spec, files.shape_bytes, files.shape_name
        model = load_object_model(spec, shape_bytes, shape_name)
        if options.object_path is not None:
            _refuse_other_shape(options.object_path, model, recording)
        own_hash = object_sha256(spec, shape_bytes)
        spec = as_struck(spec)
        names = [record.strike_id for record in recording.strikes]
        unknown = sorted(options.exclude - set(names))
        if unknown:
            raise EstimationError(f"{path}: no strike {unknown[0]!r} to exclude: its strikes are {', '.join(names) or 'none'}")
        motions: list[TipMotion] = []
        tracking: dict[str, TrackingReport] = {}
        problems: list[TrackingError] = []
        for done, record in enumerate(recording.strikes):
            if progress is not None:
                progress(f"strike {record.strike_id}", done, len(names))
            try:
                motion, report = _strike(recording, spec, record)
                tracking[record.strike_id] = report
            except TrackingError as error:
                problems.append(error)
                motion = TipMotion(record.strike_id, record.plan_strike_id, Verdict.UNREADABLE, str(error), None, None, None, (), None)
            motions.append(motion)
        if problems and len(problems) == len(motions):
            raise TrackingError(f"{path}: {problems[0]}")
        if progress is not None:
            progress("estimating", len(names), len(names))
        return Evidence(
            recording.manifest,
            spec,
            model,
            recording.plan,
            recording.content_id or "",
            own_hash,
            tuple(motions),
            tracking,
            options.object_path is not None,
            {record.strike_id: _frames_lost(recording, record) for record in recording.strikes},
            software_version(),
            tuple(part.path.name for part in recording.parts),
            recording.missing_parts,
        )


def as_struck(spec: ObjectSpec) -> ObjectSpec:
    """The body that tips: with its markers, whose masses are added where `mass_kg` was weighed without them."""
    if spec.mass_includes_markers:
        return spec
    whole = spec.mass_kg + sum(marker.mass_kg for marker in spec.marker)
    return spec.model_copy(update={"mass_kg": whole, "mass_includes_markers": True})


def _frames_lost(recording: Recording, record: pb.StrikeRecord) -> int:
    """Frames missing between the first and the last of the strike's window."""
    metas = recording.frame_meta(start_ns=record.window_start_ns + 1, end_ns=record.window_end_ns)
    return sum(meta.frames_lost_before for meta in metas)


def _refuse_other_plan(recording: Recording) -> None:
    own = object_sha256(recording.object_spec, recording.shape_bytes)
    if recording.plan.object_sha256 != own:
        raise PlanError(
            f"{recording.path}: its plan is of another object ({recording.plan.object_name}, {recording.plan.object_sha256[:12]},"
            f" the object's is {own[:12]}): plan this object and record again"
        )


def _refuse_other_shape(object_path: Path, model: ObjectModel, recording: Recording) -> None:
    """A corrected object file keeps the body where it was: the plan's edges still lie on it."""
    tolerance = OVERRIDE_TOLERANCE * float(model.extent.max())
    strikes = recording.plan.strikes
    off = np.abs(model.depth(np.array([strike.pivot.point for strike in strikes])) - [strike.pivot.radius_m for strike in strikes])
    worst = int(np.argmax(off))
    if off[worst] > tolerance:
        raise PlanError(
            f"{object_path}: is of another shape than {recording.path}: the edge of strike {strikes[worst].id} lies "
            f"{1000 * off[worst]:.0f} mm off its surface: give a corrected file of the object that was struck"
        )


def _strike(recording: Recording, spec: ObjectSpec, record: pb.StrikeRecord) -> tuple[TipMotion, TrackingReport]:
    planned = next((strike for strike in recording.plan.strikes if strike.id == record.plan_strike_id), None)
    if planned is None:
        raise PlanError(
            f"{recording.path}: strike {record.strike_id} follows plan strike {record.plan_strike_id!r}, which its plan does not hold"
        )
    camera = camera_from_spec(recording.manifest.cameras[0].calibration)
    markers = [
        Marker(marker.id, marker.size_m, None if marker.T_object_marker is None else np.array(marker.T_object_marker))
        for marker in spec.marker
    ]
    frames = recording.images(start_ns=record.window_start_ns, end_ns=record.window_end_ns)
    report = track_markers(frames, camera, markers, planned.visible_markers)
    task = StrikeTask(record.strike_id, planned, record.contact_time_ns, report.images_end_ns)
    return analyse_strike(report.tracks, markers, camera, task), report


def estimate_evidence(evidence: Evidence, options: EstimateOptions | None = None) -> Estimate:
    """Centre of mass, moments and regions from fitted motions; pure.

    Raises:
        EstimationError: fewer than three strikes can be used.
    """
    options = options or EstimateOptions()
    manifest, spec, model = evidence.manifest, evidence.spec, evidence.model
    used = [motion for motion in evidence.motions if _usable(motion, options)]
    if len(used) < LEAST_STRIKES:
        usable = [motion.strike_id for motion in evidence.motions if _usable(motion, EstimateOptions())]
        raise EstimationError(too_few(LEAST_STRIKES, evidence.motions, usable, options.exclude, evidence.plan))
    planes = tuple(_plane(evidence.planned(motion), motion, options) for motion in used)
    systematic = SystematicErrors(
        gravity_tilt_sd=manifest.gravity_tilt_sd_rad, scale_sd=spec.shape.scale_sd, edge_radius_sd=spec.edge_radius_sd_m
    )
    com = centre_of_mass(planes, systematic, ComPrior.from_bounds(model.bounds[0], model.bounds[1]))
    scale = Scale(spec.mass_kg, spec.mass_sd_kg, manifest.g_m_s2, manifest.g_sd_m_s2)
    cells = cells_from_voxels(voxelise(model, (model.volume / CELLS) ** (1 / 3), wall_thickness(spec, model)))
    inertial = inertial_parameters(planes, com, scale, inertia_prior(spec.mass_kg, com.position, cells))
    distribution = mass_distribution(inertial, cells, np.random.default_rng(options.seed))
    # The sign change needs a passage over the balance; strikes that rocked back serve only where there are no others.
    over = [motion for motion in used if motion.verdict is Verdict.GOOD]
    by_sign_change = tuple(_paper_plane(evidence.planned(motion), motion) for motion in (over if len(over) >= LEAST_STRIKES else used))
    com_paper = paper_centre_of_mass(by_sign_change, cells)
    one_per_axis = {plane.axis_id: plane for plane in planes}
    moments = {axis.axis_id: axis.i_edge for axis in inertial.axes}
    regions_paper = paper_regions(list(one_per_axis.values()), com, moments, spec.mass_kg, cells)
    result = build_result(
        inputs=_inputs(evidence, options),
        motions=evidence.motions,
        planned=[evidence.planned(motion) for motion in evidence.motions],
        excluded=options.exclude,
        planes=planes,
        inertial=inertial,
        scale=scale,
        distribution=distribution,
        com_paper=com_paper,
        distribution_paper=regions_paper,
        warnings=result_warnings(evidence, options, planes, inertial, distribution, com_paper),
    )
    return Estimate(result, evidence, planes, com, com_paper, inertial, cells, distribution, regions_paper, scale)


def _usable(motion: TipMotion, options: EstimateOptions) -> bool:
    return motion.fit is not None and motion.verdict in USABLE and motion.strike_id not in options.exclude


def _plane(planned: PlannedStrike, motion: TipMotion, options: EstimateOptions) -> EquiPlane:
    if motion.fit is not None and motion.fit.estimator == options.estimator:
        return equiplane(motion.strike_id, planned, motion)
    chosen = next((fit for fit in motion.alternatives if fit.estimator == options.estimator), None)
    return equiplane(motion.strike_id, planned, motion) if chosen is None else equiplane_from_fit(motion.strike_id, planned, chosen)


def _paper_plane(planned: PlannedStrike, motion: TipMotion) -> EquiPlane:
    """By the paper's sign change of the acceleration, where it was found."""
    found = next((fit for fit in motion.alternatives if fit.estimator == "sign_change"), None)
    return equiplane(motion.strike_id, planned, motion) if found is None else equiplane_from_fit(motion.strike_id, planned, found)


def _inputs(evidence: Evidence, options: EstimateOptions) -> ResultInputs:
    settings = f"{sorted(options.exclude)} {options.estimator} {options.seed}"
    return ResultInputs(
        recording_id=evidence.manifest.recording_id,
        content_id=evidence.content_id,
        object_sha256=evidence.object_sha256,
        plan_sha256=evidence.manifest.plan_sha256,
        configuration_sha256=sha256_text(settings),
        software=evidence.software,
    )
