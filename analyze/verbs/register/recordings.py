"""`analyze register`: recordings of strikes become the places of the object's markers, or one line that says what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analyze.cameras.calibrate import read_rig
from analyze.errors import CalibrationError, EstimationError, OutputError
from analyze.output_file import write_text
from analyze.pipeline.evidence import Evidence, Progress, RecordingHead, read_evidence, read_head, unplaced_markers
from analyze.pipeline.merge import in_order, join, paths_text, refuse_apart, strikes_to_leave_out
from analyze.pipeline.sections import section_of
from analyze.reading.recording import open_recording
from analyze.registration.register import LeftOut, Registration, TablePlace, register
from analyze.registration.table import LAID_BOARD, UNKNOWN_TABLE
from analyze.registration.views import StrikeView, strike_view
from analyze.tracking.camera_model import camera_from_spec
from analyze.types import Array
from analyze.verbs.gravity.images import READ_BY as PLUMB_LINE
from schemas.object_spec import parse_object_spec, read_object_spec
from schemas.session_manifest import OBJECT_ATTACHMENT
from schemas.toml_table import with_entry, with_entry_in_each

_ROTATION_DIGITS, _PLACE_DIGITS = 9, 6
CALIBRATION, CAMERA_POSE = "camera.calibration", "T_world_camera"
_SAME_POSE = 1e-6
"""of its entries: rad, m"""


@dataclass(frozen=True)
class RegisterOptions:
    """What the user asks for."""

    object_path: Path | None = None
    """use this object file instead of the recording's"""
    exclude: frozenset[str] = frozenset()
    """ids of strikes to leave out"""
    find_table: bool = False
    """the recorded T_world_camera says nothing of the table's tilt and height: find them too"""
    rig: Path | None = None
    """rig file that the T_world_camera found shall be written into"""


@dataclass(frozen=True)
class RegisterAnswer:
    """What was found, and from what."""

    registration: Registration
    evidence: Evidence
    object_toml: str
    """text of the object file that was used"""
    unused: tuple[LeftOut, ...]
    """strikes that show nothing of it, and those left out"""
    options: RegisterOptions

    @property
    def given(self) -> dict[int | str, Array]:
        """T_object_marker as the object file has it; nothing was made of it."""
        return {marker.name: np.array(marker.T_object_marker) for marker in self.evidence.spec.marker if marker.T_object_marker is not None}


def register_recordings(paths: Sequence[Path], options: RegisterOptions, progress: Progress | None = None) -> RegisterAnswer:
    """Find where the markers are.

    Args:
        paths: recordings (MCAP) of one object.
        options: what the user asks for.
        progress: called with (text, done, total).

    Raises:
        RecordingError: a file cannot be read.
        JoinError: the recordings are not of one object, or one is named twice.
        ShapeError: the object's shape cannot be used.
        EstimationError: strikes contradict each other, or determine no marker's place.
        CalibrationError: what will be found cannot be written into the rig file.
    """
    heads = in_order([read_head(path) for path in paths])
    if options.rig is not None:
        _refuse_other_place(heads, options.rig)
    if len(heads) > 1:
        refuse_apart(heads, options.object_path is not None)
    exclude = strikes_to_leave_out(heads, options.exclude)
    evidence = join([read_evidence(head, options.object_path, progress, unplaced_markers) for head in heads])
    views, unused = _views(evidence, exclude)
    spec = evidence.spec
    try:
        found = register(
            views,
            {marker.name: marker.size_m for marker in spec.marker},
            {marker.name: marker.thickness_m for marker in spec.marker},
            evidence.model,
            UNKNOWN_TABLE if options.find_table else LAID_BOARD,
        )
    except EstimationError as error:
        raise EstimationError(f"{paths_text(heads)}: {error}") from None
    return RegisterAnswer(found, evidence, _object_toml(heads[0], options), (*unused, *found.left_out), options)


def refuse_undetermined(answer: RegisterAnswer) -> None:
    """Raise EstimationError where no marker's place is determined, or the table's was asked for and is not."""
    name = paths_text(answer.evidence.recordings)
    found = answer.registration
    if all(place.undetermined for place in found.markers):
        first = found.markers[0]
        raise EstimationError(
            f"{name}: the strikes do not determine where marker {first.marker_id} is ({'; '.join(first.undetermined)}): {first.remedy}"
        )
    for table in found.tables:
        if answer.options.find_table and table.undetermined:
            raise EstimationError(
                f"{name}: the strikes do not determine the table's {', '.join(table.undetermined)}: add strikes over other edges of the "
                "faces that were struck, and on another resting face"
            )


def write_object(answer: RegisterAnswer, output: Path) -> tuple[int | str, ...]:
    """Write the object file with the places found; every other line stays as it is. Returns the markers written.

    Raises:
        OutputError: the file cannot be written, or its markers are not written as [[marker]].
    """
    numbers = {marker.name: number for number, marker in enumerate(answer.evidence.spec.marker)}
    known = [place for place in answer.registration.markers if not place.undetermined]
    rows = {numbers[place.marker_id]: pose_toml(place.T_object_marker) for place in known}
    text = with_entry_in_each(answer.object_toml, "marker", "T_object_marker", rows)
    if text is None:
        raise OutputError(f"{output}: the object file has no plain [[marker]] tables to write in: take the poses that --json prints")
    parse_object_spec(text, str(output))
    write_text(output, text)
    return tuple(place.marker_id for place in known)


def write_table(answer: RegisterAnswer, rig: Path) -> None:
    """Put T_world_camera, in the W whose z = 0 is the table as found, into the rig file; every other line stays as it is.

    Raises:
        EstimationError: the strikes do not determine the table.
        CalibrationError: the file has no plain table to write in.
        OutputError: the file cannot be written.
    """
    refuse_undetermined(answer)
    (found,) = answer.registration.tables
    pose = pose_toml(found.T_world_camera)
    text = with_entry(rig.read_text(encoding="utf-8"), CALIBRATION, CAMERA_POSE, pose)
    if text is None:
        raise CalibrationError(f"{rig}: has no plain table [{CALIBRATION}] to write in: put there by hand {CAMERA_POSE} = {pose}")
    write_text(rig, text)


def level_note(rig: Path) -> str:
    """What of the rig file no longer holds when its T_world_camera is another; empty: all does."""
    level = read_rig(rig)[0].level
    if level is None or level.read_by != PLUMB_LINE:
        return ""
    return "; [level] in it was read by the camera as it was taken to stand: analyze gravity reads it anew"


def _refuse_other_place(heads: Sequence[RecordingHead], rig: Path) -> None:
    """What is found is how the table lies against the T_world_camera of the recording: the rig file must have the same."""
    _, place = read_rig(rig)
    if len(heads) > 1:
        raise CalibrationError(f"{rig}: {paths_text(heads)} have a table each: write that of one recording by itself")
    recorded = heads[0].manifest.cameras[0].calibration.T_world_camera
    if place is None or not np.allclose(place, recorded, rtol=0.0, atol=_SAME_POSE):
        raise CalibrationError(
            f"{rig}: its T_world_camera is not the one that {heads[0].path} was recorded with, and the camera may have been moved since: "
            "write by hand what is printed without --write, or record with this file"
        )


def pose_toml(T: Array) -> str:
    """A pose as TOML."""

    def row(values: Array) -> str:
        turn = ", ".join(f"{value + 0.0:.{_ROTATION_DIGITS}f}" for value in values[:3])
        return f"[{turn}, {values[3] + 0.0:.{_PLACE_DIGITS}f}]"

    return "[" + ", ".join([*(row(T[i]) for i in range(3)), "[0, 0, 0, 1]"]) + "]"


def doubted(table: TablePlace) -> bool:
    """The table lies elsewhere than a board laid by hand would be off."""
    usual = np.array([LAID_BOARD.tilt_sd, LAID_BOARD.tilt_sd, LAID_BOARD.height_sd])
    return bool(np.any(np.abs(table.offset) > 2 * usual + 2 * table.sd))


def _views(evidence: Evidence, exclude: frozenset[str]) -> tuple[list[StrikeView], list[LeftOut]]:
    markers = unplaced_markers(evidence.spec)
    cameras = [camera_from_spec(head.manifest.cameras[0].calibration) for head in evidence.recordings]
    views: list[StrikeView] = []
    unused: list[LeftOut] = []
    for motion in evidence.motions:
        if motion.strike_id in exclude:
            unused.append(LeftOut(motion.strike_id, "left out on request"))
            continue
        planned = evidence.planned(motion)
        if planned.heading_rad:
            unused.append(LeftOut(motion.strike_id, "turned on the table: the table's tilt is felt the other way"))
            continue
        report = evidence.tracking.get(motion.strike_id)
        setup = evidence.recorded_in.get(motion.strike_id, 0)
        section = section_of(evidence.model, planned)
        view = None if report is None else strike_view(report.tracks, markers, cameras[setup], planned, motion, setup, section)
        if view is None:
            unused.append(LeftOut(motion.strike_id, f"shows no marker surely at rest: {motion.verdict.value}: {motion.reason}"))
        else:
            views.append(view)
    return views, unused


def _object_toml(head: RecordingHead, options: RegisterOptions) -> str:
    if options.object_path is not None:
        read_object_spec(options.object_path)
        return options.object_path.read_text(encoding="utf-8")
    with open_recording(head.path) as recording:
        return recording.attachments[OBJECT_ATTACHMENT].decode()
