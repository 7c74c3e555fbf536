"""`analyze register`: marker poses on the object, and the table's pose, estimated from recorded strikes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analyze.cameras.rig_file import PLUMB_LINE, read_rig
from analyze.errors import CalibrationError, EstimationError
from analyze.pipeline.evidence import (
    Evidence,
    RecordingHead,
    StrikeReading,
    StrikeSource,
    StruckObject,
)
from analyze.pipeline.merge import (
    by_start_time,
    merge_evidence,
    paths_text,
    refuse_unmergeable,
    resolve_exclusions,
)
from analyze.pipeline.object_markers import unplaced_markers
from analyze.pipeline.read_evidence import read_evidence, read_head, read_strike
from analyze.pipeline.sections import rolling_outline
from analyze.progress import Progress
from analyze.reading.recording import open_recording
from analyze.registration.places import MarkerPlace, TablePlace
from analyze.registration.register import LeftOut, Registration, register
from analyze.registration.round_body import rim_centre
from analyze.registration.table import LAID_BOARD, UNKNOWN_TABLE
from analyze.registration.views import StrikeView, strike_view
from analyze.tracking.camera_model import camera_of_strike
from analyze.types import Array, Marker
from schemas.input_file import read_text
from schemas.object_spec import ObjectSpec, parse_object_spec, read_object_spec
from schemas.output_file import OutputError, write_text
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import OBJECT_ATTACHMENT
from schemas.toml_table import with_entry, with_entry_in_each

ROTATION_DIGITS, POSITION_DIGITS = 9, 6
"""decimals of a written pose: of its rotation, and of its position in metres"""
MIN_WRITTEN_SD = 1e-6
"""least standard deviation that is written [m, rad]"""
CALIBRATION, CAMERA_POSE = "camera.calibration", "T_world_camera"
POSE_TOLERANCE = 1e-6
"""difference of the entries of two poses (rotation matrix; position [m]) up to which they count as equal"""


@dataclass(frozen=True)
class RegisterOptions:
    """Options of `analyze register`: object file, strikes to leave out, and whether to estimate the table."""

    object_path: Path | None = None
    """object file to use instead of the recording's; None for the recording's"""
    exclude: frozenset[str] = frozenset()
    """ids of strikes to leave out"""
    find_table: bool = False
    """True if the table's tilt and height against T_world_camera are unknown and estimated too"""
    rig: Path | None = None
    """rig file to write the estimated T_world_camera into; None if there is none"""


@dataclass(frozen=True)
class RegisterAnswer:
    """Estimated poses of the markers and of the table, and the strikes that they come from."""

    registration: Registration
    """poses of markers and tables, and the fit"""
    evidence: Evidence
    """motions and tracks of all strikes, with object and plan"""
    object_toml: str
    """text of the object file that was used"""
    unused: tuple[LeftOut, ...]
    """strikes that were not used, each with the reason"""
    options: RegisterOptions
    """options with which the poses were estimated"""

    @property
    def given(self) -> dict[int | str, Array]:
        """Marker poses T_object_marker (4, 4) that the object file gives, by marker; translation in m.

        They are for comparison only: the estimate does not use them, but for the direction about the axis of
        a body of revolution. Markers without a pose are missing.
        """
        return _stated_poses(self.evidence.spec)


def register_recordings(
    paths: Sequence[Path], options: RegisterOptions, progress: Progress | None = None
) -> RegisterAnswer:
    """Estimate the poses of the markers on the object, and of the table if asked; writes nothing.

    The result may leave poses undetermined: see `refuse_undetermined`.

    Args:
        paths: recordings (MCAP) of one object.
        options: the user's choices.
        progress: called with (text, done, total).

    Returns:
        Marker poses in the object frame and the table's tilt and height against the recorded T_world_camera,
        with their errors, and the strikes not used.

    Raises:
        RecordingError: a file cannot be read.
        MergeError: the recordings are not of one object, or one is named twice.
        ShapeError: the object's shape cannot be used.
        PlanError: a recording's plan is of another object, or does not hold a strike.
        TrackingError: no marker of any strike can be tracked.
        DocumentError: the object file or rig file has an entry that cannot be used.
        EstimationError: an excluded strike does not exist, no strike shows a marker or can be used, strikes
            contradict each other, two markers come out at one place, or the fit does not converge.
        CalibrationError: the rig file cannot be read, several recordings were given with it, or its
            T_world_camera is not theirs.
    """
    heads = by_start_time([read_head(path) for path in paths])
    if options.rig is not None:
        _refuse_other_place(heads, options.rig)
    if len(heads) > 1:
        refuse_unmergeable(heads, options.object_path is not None)
    exclude = resolve_exclusions(heads, options.exclude)
    evidence = merge_evidence(
        [
            read_evidence(head, options.object_path, progress, unplaced_markers, _read_all_markers)
            for head in heads
        ]
    )
    views, unused = _views(evidence, exclude)
    spec = evidence.spec
    try:
        found = register(
            views,
            {marker.name: marker.size_m for marker in spec.marker},
            {marker.name: marker.thickness_m for marker in spec.marker},
            evidence.model,
            UNKNOWN_TABLE if options.find_table else LAID_BOARD,
            _stated_poses(spec),
        )
    except EstimationError as error:
        raise EstimationError(f"{paths_text(heads)}: {error}") from None
    return RegisterAnswer(
        found, evidence, _object_toml(heads[0], options), (*unused, *found.left_out), options
    )


def refuse_undetermined(answer: RegisterAnswer) -> None:
    """Check that the pose of at least one marker is determined, and the table's if it was asked for.

    Raises:
        EstimationError: no marker's pose is determined, or the table's is asked for and is not; the message
            names the directions left open and the remedy.
    """
    name = paths_text(answer.evidence.recordings)
    found = answer.registration
    if all(place.undetermined for place in found.markers):
        first = found.markers[0]
        raise EstimationError(
            f"{name}: the strikes do not determine where marker {first.marker_id} is "
            f"({'; '.join(first.undetermined)}): {first.remedy}"
        )
    for table in found.tables:
        if answer.options.find_table and table.undetermined:
            raise EstimationError(
                f"{name}: the strikes do not determine the table's {', '.join(table.undetermined)}: add "
                "strikes over other edges of the faces that were struck, and on another resting face"
            )


def write_object(answer: RegisterAnswer, output: Path) -> tuple[int | str, ...]:
    """Write the object file with the determined marker poses and their sds; return the markers' names.

    Markers whose pose is not determined, and all other lines, stay as they are.

    Raises:
        OutputError: the file cannot be written, or its markers are not plain [[marker]] tables.
        DocumentError: the object file with these poses is not valid.
    """
    numbers = {marker.name: number for number, marker in enumerate(answer.evidence.spec.marker)}
    known = [place for place in answer.registration.markers if not place.undetermined]
    entries: dict[str, Callable[[MarkerPlace], str]] = {
        "T_object_marker": lambda place: pose_toml(place.T_object_marker),
        "place_sd_m": lambda place: f"{max(place.place_sd, MIN_WRITTEN_SD):.6f}",
        "turn_sd_rad": lambda place: f"{max(place.turn_sd, MIN_WRITTEN_SD):.6f}",
    }
    text: str | None = answer.object_toml
    for key, written in entries.items():
        rows = {numbers[place.marker_id]: written(place) for place in known}
        text = with_entry_in_each(text, "marker", key, rows)
        if text is None:
            raise OutputError(
                f"{output}: the object file has no plain [[marker]] tables to write into: copy the poses "
                "that --json prints"
            )
    parse_object_spec(text, str(output))
    write_text(output, text)
    return tuple(place.marker_id for place in known)


def write_table(answer: RegisterAnswer, rig: Path) -> None:
    """Write the T_world_camera that puts z = 0 of W on the estimated table into the rig file.

    T_world_camera is the camera's pose in the world frame W. Every other line stays as it is.

    Raises:
        EstimationError: the strikes do not determine the table, or no marker's pose.
        CalibrationError: the file has no plain table to write into.
        OutputError: the file cannot be written.
    """
    refuse_undetermined(answer)
    (found,) = answer.registration.tables
    pose = pose_toml(found.T_world_camera)
    text = with_entry(read_text(rig), CALIBRATION, CAMERA_POSE, pose)
    if text is None:
        raise CalibrationError(
            f"{rig}: has no plain table [{CALIBRATION}] to write into: add by hand {CAMERA_POSE} = {pose}"
        )
    write_text(rig, text)


def level_note(rig: Path) -> str:
    """Text to append to a message: repeat `analyze gravity` for this rig file; "" if it need not be.

    A tilt measured by plumb line depends on T_world_camera, the camera's pose, which was just changed in the
    rig file; a tilt measured otherwise does not.

    Raises:
        CalibrationError, DocumentError: the rig file cannot be used.
    """
    level = read_rig(rig)[0].level
    if level is None or level.read_by != PLUMB_LINE:
        return ""
    return "; its [level] was read with the previous camera pose: repeat analyze gravity"


def _refuse_other_place(heads: Sequence[RecordingHead], rig: Path) -> None:
    """Refuse a rig file whose T_world_camera, the camera's pose, differs from the recording's.

    The table is estimated relative to the recording's T_world_camera.

    Args:
        heads: the recordings; only one is allowed.
        rig: the rig file.

    Raises:
        CalibrationError: the poses differ, the rig file has none or cannot be read, or there are several
            recordings.
        DocumentError: an entry of the rig file has a value that is not allowed.
    """
    _, place = read_rig(rig)
    if len(heads) > 1:
        raise CalibrationError(
            f"{rig}: {paths_text(heads)} have a table each: register one recording by itself to write its "
            "table"
        )
    recorded = heads[0].manifest.cameras[0].calibration.T_world_camera
    if place is None or not np.allclose(place, recorded, rtol=0.0, atol=POSE_TOLERANCE):
        raise CalibrationError(
            f"{rig}: its T_world_camera differs from that of {heads[0].path}, and the camera may have been "
            "moved since: copy by hand what is printed without --write, or record with this file"
        )


def pose_toml(T: Array) -> str:
    """Pose (4, 4), translation in m, as the text of a TOML array of rows, with fixed numbers of decimals.

    The last row is written as 0, 0, 0, 1.
    """

    def row(values: Array) -> str:
        turn = ", ".join(f"{value + 0.0:.{ROTATION_DIGITS}f}" for value in values[:3])
        return f"[{turn}, {values[3] + 0.0:.{POSITION_DIGITS}f}]"

    return "[" + ", ".join([*(row(T[i]) for i in range(3)), "[0, 0, 0, 1]"]) + "]"


def is_implausible(table: TablePlace) -> bool:
    """True if the table, as estimated, is tilted or raised more than a board laid by hand can be wrong.

    The camera's recorded pose was measured with such a board on the table. Each of the two tilts [rad] and
    the height [m] may differ from it by twice the usual error of a laid board plus twice the estimate's own
    standard deviation.
    """
    usual = np.array([LAID_BOARD.tilt_sd, LAID_BOARD.tilt_sd, LAID_BOARD.height_sd])
    return bool(np.any(np.abs(table.offset) > 2 * usual + 2 * table.sd))


def _views(evidence: Evidence, exclude: frozenset[str]) -> tuple[list[StrikeView], list[LeftOut]]:
    """Marker corners of the strikes to estimate from, at rest and tipping; and the strikes not used.

    A strike is used if it is not excluded, the tip balanced over the planned edge, the object was placed as
    planned by the verdict, and a marker is seen at rest.

    Args:
        evidence: motions and tracks of all strikes.
        exclude: ids of strikes to leave out.

    Returns:
        A view (marker corners, planned pose and pivot) per strike used; and id and reason per strike not
        used.
    """
    markers = unplaced_markers(evidence.spec)
    lenses = [head.manifest.cameras[0].calibration for head in evidence.recordings]
    views: list[StrikeView] = []
    unused: list[LeftOut] = []
    for motion in evidence.motions:
        view = None
        if motion.strike_id in exclude:
            reason = "left out on request"
        elif motion.carried_by is not None:
            reason = "balanced over another line than the planned edge, about which its tip began"
        else:
            reason = f"no marker is surely at rest: {motion.verdict.value}: {motion.reason}"
            if (report := evidence.tracking.get(motion.strike_id)) is not None:
                setup = evidence.recorded_in.get(motion.strike_id, 0)
                planned = evidence.planned(motion)
                section = rolling_outline(evidence.model, planned)
                centre = rim_centre(evidence.model, planned)
                camera = camera_of_strike(lenses[setup], evidence.camera_poses.get(motion.strike_id, ()))
                view = strike_view(report.tracks, markers, camera, planned, motion, setup, section, centre)
        if view is None:
            unused.append(LeftOut(motion.strike_id, reason))
        else:
            views.append(view)
    return views, unused


def _read_all_markers(
    recording: StrikeSource, struck: StruckObject, markers: list[Marker], record: pb.StrikeRecord
) -> StrikeReading:
    """Motion and tracks of one strike; over a round rim of all markers in view, not only the planned ones.

    A round rim does not show how the body is turned: what ties markers together is that images show several.

    Args:
        recording: complete recording, or one still being written.
        struck: object, shape and plan.
        markers: markers of the object to track.
        record: the recording's entry of the strike.
    """
    strikes = [
        strike.model_copy(update={"visible_markers": []}) if strike.rolls else strike
        for strike in struck.plan.strikes
    ]
    plan = struck.plan.model_copy(update={"strikes": strikes})
    return read_strike(recording, replace(struck, plan=plan), markers, record)


def _stated_poses(spec: ObjectSpec) -> dict[int | str, Array]:
    """Poses T_object_marker (4, 4) that an object file states, by marker; translation in m."""
    return {
        marker.name: np.array(marker.T_object_marker)
        for marker in spec.marker
        if marker.T_object_marker is not None
    }


def _object_toml(head: RecordingHead, options: RegisterOptions) -> str:
    """Text (TOML) of the object file: the one that the options name, else the recording's.

    Raises:
        DocumentError: the object file that the options name cannot be used.
        CalibrationError: the options name none, and the recording holds none.
    """
    if options.object_path is not None:
        read_object_spec(options.object_path)
        return read_text(options.object_path)
    with open_recording(head.path) as recording:
        attached = recording.attachments.get(OBJECT_ATTACHMENT)
    if attached is None:
        raise CalibrationError(f"{head.path}: holds no {OBJECT_ATTACHMENT}: give it with --object")
    return attached.decode(errors="replace")
