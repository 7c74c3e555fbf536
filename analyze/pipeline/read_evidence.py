"""Reading of a recording's strikes: marker tracking and fitted motion of each (the evidence).

The ground truth of virtual recordings (topics under /truth/) is never read here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from analyze.errors import PlanError, TrackingError
from analyze.flight.toss import TossMotion
from analyze.geometry.bodies import bodies_of
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.geometry.station import turned_camera
from analyze.motion.print_motion import analyse_images
from analyze.motion.slow_motion import slow_motion_ratio, slow_motion_text
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.evidence import (
    Evidence,
    ImpactMeasurement,
    RecordingHead,
    StrikeReader,
    StrikeReading,
    StrikeSource,
    StruckObject,
    TossReader,
    usable_rest_views,
)
from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.sections import next_face_angle, rolling_outline, scanned_edge_sd, strike_supports
from analyze.pipeline.toss_marks import toss_marks
from analyze.pipeline.tosses import read_toss
from analyze.planning.corrected import corrected_plan
from analyze.progress import Progress
from analyze.reading.object_file import read_object_files
from analyze.reading.recording import Recording, open_recording
from analyze.tracking.camera_model import camera_of_strike
from analyze.tracking.track import TrackingReport
from analyze.types import Marker, TipMotion
from schemas.object_spec import ObjectSpec, object_sha256
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import RIG_ATTACHMENT, TimeSource
from schemas.software import software_version
from schemas.strike_plan import PlannedStrike
from schemas.strike_result import Verdict

MAX_EDGE_SHIFT = 0.05
"""fraction of the shape's longest extent by which an object file given afterwards may move planned edges"""


def read_head(path: Path) -> RecordingHead:
    """Identity and contents (metadata, strike ids, file names, hashes) of the recording at `path`.

    No images are read.

    Raises:
        RecordingError: the file cannot be read.
    """
    with open_recording(path) as recording:
        return read_open_head(recording)


def read_open_head(recording: Recording) -> RecordingHead:
    """Identity and contents (metadata, strike ids, file names, hashes) of an open recording.

    Raises:
        RecordingError: a file is damaged.
    """
    shape, rig = recording.shape_bytes, recording.attachments.get(RIG_ATTACHMENT)
    return RecordingHead(
        recording.path,
        recording.manifest,
        recording.content_id or "",
        tuple(record.strike_id for record in recording.strikes),
        tuple(record.toss_id for record in recording.tosses),
        "" if shape is None else hashlib.sha256(shape).hexdigest(),
        tuple(part.path.name for part in recording.parts),
        recording.missing_parts,
        recording.recovery_losses,
        None if rig is None else rig.decode(errors="replace"),
        tuple(
            dict.fromkeys(
                f"{each.loss_text()} ({each.change_text()})"
                for each in recording.compactions
                if not each.exact
            )
        ),
    )


def read_evidence(
    head: RecordingHead,
    object_path: Path | None = None,
    progress: Progress | None = None,
    markers_of: Callable[[ObjectSpec], list[Marker]] = placed_markers,
    reader: StrikeReader | None = None,
    toss_reader: TossReader | None = None,
) -> Evidence:
    """Track the markers and fit the motion of every strike of a recording; return these as evidence.

    Args:
        head: identity and contents of the recording.
        object_path: object file to use instead of the recording's; None for the recording's.
        progress: called with (text, done, total) before each strike.
        markers_of: function from the object file's contents to the markers to track: `placed_markers`, or
            `unplaced_markers` to ignore the poses in the file.
        reader: function that reads one strike; None for `read_strike`.
        toss_reader: function that reads one toss; None for `read_toss`.

    Returns:
        Fitted motions and tracking reports, with object, shape and plan.

    Raises:
        RecordingError: the file cannot be read.
        ShapeError: the object's file or shape cannot be used.
        PlanError: the plan is of another object or shape, or lacks a strike that was recorded.
        TrackingError: no marker of any strike can be tracked.
    """
    with open_recording(head.path) as recording:
        struck = struck_object(recording, object_path)
        markers = markers_of(struck.spec)
        readings: list[StrikeReading] = []
        for done, record in enumerate(recording.strikes):
            if progress is not None:
                progress(f"strike {record.strike_id}", done, len(head.strike_ids))
            readings.append((reader or read_strike)(recording, struck, markers, record))
        tosses: list[TossMotion] = []
        views = usable_rest_views(readings) if recording.tosses else {}
        marks = toss_marks(markers, views, struck.model)
        for record in recording.tosses:
            if progress is not None:
                progress(f"toss {record.toss_id}", len(head.strike_ids), len(head.strike_ids))
            tosses.append((toss_reader or read_toss)(recording, struck, marks, record))
        return replace(evidence_from_readings(head, struck, readings), tosses=tuple(tosses))


def struck_object(recording: StrikeSource, object_path: Path | None = None) -> StruckObject:
    """Load object file, shape and plan of a recording, or use the object file and shape given instead.

    Args:
        recording: complete recording, or one still being written.
        object_path: object file to use instead of the recording's; None for the recording's. The plan's
            edges are corrected to the file in use.

    Returns:
        Object file with the markers' masses included, shape and plan; also the closed bodies of the mesh, if
        labels of the object file name any.

    Raises:
        RecordingError: the recording holds no plan.
        ShapeError: the object's file or shape cannot be used.
        PlanError: the plan is of another object, or its edges do not lie on the surface of the shape given.
    """
    spec, shape_bytes = recording.object_spec, recording.shape_bytes
    shape_name = spec.shape.file or str(recording.path)
    _refuse_other_plan(recording)
    if object_path is not None:
        files = read_object_files(object_path)
        spec, shape_bytes, shape_name = files.spec, files.shape_bytes, files.shape_name
    model, plan = load_object_model(spec, shape_bytes, shape_name), recording.plan
    if object_path is not None:
        _refuse_other_shape(object_path, model, recording)
    plan = corrected_plan(plan, recording.object_spec, spec, model)
    own_hash = object_sha256(spec, shape_bytes)
    bodies = (
        tuple(bodies_of(spec, shape_bytes, shape_name))
        if any(label.bodies for label in spec.labels or [])
        else ()
    )
    return StruckObject(with_marker_masses(spec), model, plan, own_hash, bodies, object_path is not None)


def read_strike(
    recording: StrikeSource, struck: StruckObject, markers: list[Marker], record: pb.StrikeRecord
) -> StrikeReading:
    """Track the markers (square tags) and fit the motion of one strike of a recording.

    Args:
        recording: complete recording, or one still being written.
        struck: object, shape and plan.
        markers: markers of the object to track.
        record: the recording's entry of the strike.

    Returns:
        Motion, tracking report and frames lost. If no marker can be tracked, the motion has verdict
        UNREADABLE and no fit, the report is None and `problem` is the error. The motion also has verdict
        UNREADABLE and no fit if a video file states a frame rate at which it cannot be that of a tip, but
        could be at another rate.

    Raises:
        RecordingError: the file is damaged within the strike's time window.
        PlanError: the plan does not hold the strike.
    """
    problem, report = None, None
    try:
        motion, report = _strike(recording, struck, markers, record)
    except TrackingError as error:
        problem = error
        motion = TipMotion(record.strike_id, record.plan_strike_id, Verdict.UNREADABLE, str(error))
    return StrikeReading(record, motion, report, problem, _frames_lost(recording, record))


def evidence_from_readings(
    head: RecordingHead, struck: StruckObject, readings: Sequence[StrikeReading]
) -> Evidence:
    """Evidence (fitted motions with object, shape and plan) of one recording, from its strikes' readings.

    The striker's measured tip speed and height at impact are kept for strikes that have both.

    Args:
        head: the recording's path, manifest and strike ids.
        struck: object, shape and plan.
        readings: motion and tracking report of each strike, in the recording's order.

    Raises:
        TrackingError: no marker of any strike can be tracked.
    """
    if readings and all(reading.problem is not None for reading in readings):
        raise TrackingError(f"{head.path}: {readings[0].problem}")
    records = [reading.record for reading in readings]
    return Evidence(
        (head,),
        struck.spec,
        struck.model,
        struck.plan,
        struck.sha256,
        tuple(reading.motion for reading in readings),
        {reading.record.strike_id: reading.report for reading in readings if reading.report is not None},
        struck.overridden,
        {reading.record.strike_id: reading.frames_lost for reading in readings},
        {
            record.strike_id: ImpactMeasurement(
                record.tip_speed_m_s, record.impact_height_m, record.tip_speed_command_m_s or None
            )
            for record in records
            if record.tip_speed_m_s > 0 and record.impact_height_m > 0
        },
        software_version(),
        bodies=struck.bodies,
        choices={record.strike_id: record.choice_text for record in records if record.choice_text},
        camera_poses={
            record.strike_id: tuple(record.T_world_camera) for record in records if record.T_world_camera
        },
    )


def with_marker_masses(spec: ObjectSpec) -> ObjectSpec:
    """Copy of an object file in which the mass [kg] includes that of the markers (printed tags).

    Their masses are added to a mass that was weighed without them. An object file whose mass includes the
    markers is returned unchanged.
    """
    if spec.mass_includes_markers:
        return spec
    whole = spec.mass_kg + sum(marker.mass_kg for marker in spec.marker)
    return spec.model_copy(update={"mass_kg": whole, "mass_includes_markers": True})


def _frames_lost(recording: StrikeSource, record: pb.StrikeRecord) -> int:
    """Number of frames lost between the first and the last frame of the time window of one strike."""
    metas = recording.frame_meta(start_ns=record.window_start_ns + 1, end_ns=record.window_end_ns)
    return sum(meta.frames_lost_before for meta in metas)


def _refuse_other_plan(recording: StrikeSource) -> None:
    """Raise PlanError unless the recording's plan was made for the recorded object file and shape.

    The plan names them by a hash, which must be equal.
    """
    own = object_sha256(recording.object_spec, recording.shape_bytes)
    if recording.plan.object_sha256 != own:
        raise PlanError(
            f"{recording.path}: its plan is of another object ({recording.plan.object_name},"
            f" {recording.plan.object_sha256[:12]}, the object's is {own[:12]}): plan this object and record"
            " again"
        )


def _refuse_other_shape(object_path: Path, model: ObjectModel, recording: StrikeSource) -> None:
    """Raise PlanError unless the plan's edges lie on the surface of the object file given afterwards.

    `model` is the shape of that file, `object_path` its path. The pivot point of an edge of radius rho should
    lie rho below the surface; it may be off by `MAX_EDGE_SHIFT` of the shape's longest extent.
    """
    tolerance = MAX_EDGE_SHIFT * float(model.extent.max())
    strikes = recording.plan.strikes
    if not strikes:
        return
    off = np.abs(
        model.depth(np.array([strike.pivot.point for strike in strikes]))
        - [strike.pivot.radius_m for strike in strikes]
    )
    worst = int(np.argmax(off))
    if off[worst] > tolerance:
        raise PlanError(
            f"{object_path}: is of another shape than {recording.path}: the edge of strike"
            f" {strikes[worst].id} lies {1000 * off[worst]:.0f} mm off its surface, more than"
            f" {1000 * tolerance:.0f} mm: give a corrected file of the object that was struck"
        )


def _strike(
    recording: StrikeSource, struck: StruckObject, markers: list[Marker], record: pb.StrikeRecord
) -> tuple[TipMotion, TrackingReport]:
    """Fitted motion of one strike, and the report on the tracking of its markers.

    If a video file states a frame rate at which the motion cannot be that of a tip, but could be at another
    rate, the motion has no fit, verdict UNREADABLE and the ratio of true to stated rate.

    Raises:
        PlanError: the plan does not hold the strike.
        TrackingError: markers are in view but cannot be used: one is seen twice, none belongs to the object,
            or images do not fit the calibration. Without any marker in view the verdict is MARKER_LOST.
    """
    planned = next((strike for strike in struck.plan.strikes if strike.id == record.plan_strike_id), None)
    if planned is None:
        raise PlanError(
            f"{recording.path}: strike {record.strike_id} follows plan strike {record.plan_strike_id!r},"
            " which its plan does not hold: record the strikes again with one plan"
        )
    calibration = recording.manifest.cameras[0].calibration
    camera = turned_camera(camera_of_strike(calibration, record.T_world_camera), planned.heading_rad)
    frames = recording.images(start_ns=record.window_start_ns, end_ns=record.window_end_ns)
    task = StrikeTask(
        record.strike_id,
        planned,
        record.contact_time_ns,
        None,
        rolling_outline(struck.model, planned),
        next_face_angle(struck.model, planned),
        None,
        strike_supports(struck.model, planned),
        tuple(struck.plan.strikes),
        scanned_edge_sd(struck.spec, struck.model, planned),
    )
    motion, report = analyse_images(
        frames, camera, markers, (struck.model.vertices, struck.model.faces), task
    )
    manifest = recording.manifest
    if manifest.time_source is not TimeSource.CONTAINER_PTS:
        return motion, report
    rate_ratio = slow_motion_ratio(
        motion,
        report.tracks,
        markers,
        camera,
        task,
        _rough_k(struck.model, recording.object_spec, planned, manifest.g_m_s2),
    )
    if rate_ratio is None:
        return motion, report
    text = slow_motion_text(rate_ratio, manifest.cameras[0].frame_rate_hz)
    changes = {"verdict": Verdict.UNREADABLE, "reason": text, "frame_rate_ratio": rate_ratio}
    return replace(motion, fit=None, alternatives=(), **changes), report


def _rough_k(model: ObjectModel, spec: ObjectSpec, planned: PlannedStrike, gravity: float) -> float:
    """Rough value of the rate constant k = m g R / I_edge [rad/s²] of a strike's motion, before any fit.

    m is the mass of the object file `spec` that the plan was made for, g = `gravity` [m/s²], I_edge the
    moment about the edge as planned, R the distance of the shape's centroid, taken as centre of mass, from
    the pivot axis.
    """
    arm = model.centroid - np.array(planned.pivot.point)
    R = float(np.linalg.norm(np.cross(arm, planned.pivot.direction)))
    return with_marker_masses(spec).mass_kg * gravity * R / planned.i_edge_predicted_kg_m2
