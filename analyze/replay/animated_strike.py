"""Strike of a recording prepared for an animation: images, the lines drawn over each, and the fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from analyze.geometry.station import turned_camera
from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.read_evidence import read_strike, struck_object
from analyze.pipeline.sections import rolling_outline
from analyze.replay import overlay, views
from analyze.replay.viewer import ReplayError
from analyze.tracking.camera_model import camera_of_strike
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from analyze.geometry.object_model import ObjectModel
    from analyze.motion.support_function import SupportFunction
    from analyze.pipeline.evidence import StrikeReading, StruckObject
    from analyze.progress import Progress
    from analyze.reading.recording import Recording
    from analyze.types import (
        Array,
        CameraModel,
        ImageFrame,
        IntArray,
        Marker,
        MarkerTrack,
        MotionFit,
        TipAngle,
        TipMotion,
    )
    from schemas.proto import percuss_pb2 as pb
    from schemas.strike_plan import PlannedStrike

BEFORE_S, AFTER_S = 0.08, 0.06
"""time [s] shown before the contact, and after the last fitted frame"""
MAX_FRAMES = 120
"""largest number of images of an animation"""
_BEYOND_TOP = 1.06
"""length of the line through the centre of mass, as a multiple of the object's extent along it"""


@dataclass(frozen=True)
class FrameLines:
    """Lines over one image, in its raw pixels: tags, the object's outline, pivot axis, line to the balance.

    A pixel's centre has integer coordinates. The line to the balance goes from the contact through the height
    at which the centre of mass lies; it is upright at balance.
    """

    tags: tuple[Array, ...]
    """closed outlines (5, 2) of the tags found in this image"""
    outline: tuple[Array, ...]
    """lines (m, 2) of the object at the angle of the fit"""
    pivot: Array
    """(m, 2) the pivot axis"""
    balance: Array
    """(2, 2) the line through the centre of mass, contact first; NaN behind the camera"""
    plumb: Array
    """(2, 2) a vertical line of the same length over the contact"""
    fitted: bool
    """True if the image is in the fit's window; else the outline is at the measured angle"""


@dataclass(frozen=True)
class AnimatedStrike:
    """One strike as an animation shows it: n images with their lines, and the measured motion."""

    object_name: str
    """name of the object"""
    motion: TipMotion
    """motion of the strike, with its verdict"""
    angle: TipAngle
    """measured tipping angle"""
    fit: MotionFit
    """fit of the motion"""
    fitted: views.FittedCurves
    """curve of the fit"""
    contact_ns: int
    """log time of the contact [ns]"""
    images: tuple[ImageFrame, ...]
    """images, by time, thinned to at most `MAX_FRAMES`"""
    time_ns: IntArray
    """(n,) log times [ns] of the tags' motion in the images"""
    lines: tuple[FrameLines, ...]
    """lines over each image"""


def read_animated_strike(
    recording: Recording, strike_id: str | None, object_path: Path | None, progress: Progress
) -> AnimatedStrike:
    """Read a strike of a recording, measure its motion, and place the lines over its images.

    Args:
        recording: open recording.
        strike_id: id of the strike; None for the first one that tipped the object over, by its measured
            motion. Strikes judged good while recording are tried before the others.
        object_path: object file that replaces the recording's; None for the recording's.
        progress: called with (name of the step, units of work done, units in all).

    Raises:
        ReplayError: the recording has no such strike, or the strike's motion has no fit.
        RecordingError: the file is damaged there.
        ShapeError, PlanError: the object file, its shape or the plan cannot be used.
    """
    records = _candidates(recording, strike_id)
    struck = struck_object(recording, object_path)
    markers = placed_markers(struck.spec)
    unfitted = ""
    for done, record in enumerate(records):
        progress(f"strike {record.strike_id}", done, len(records))
        reading = read_strike(recording, struck, markers, record)
        motion = reading.motion
        if motion.angle is not None and motion.fit is not None:
            curve = views.fitted_curves(motion.angle, motion.fit)
            if curve is not None and (strike_id is not None or motion.verdict is Verdict.GOOD):
                return _animated(recording, struck, markers, reading, curve)
        unfitted = unfitted or f"{record.strike_id}: {motion.reason}"
        recording.release_memory()
    which = "strike" if strike_id is not None else "good tip"
    raise ReplayError(
        f"{recording.path}: has no motion of a {which} to animate ({unfitted}): name another strike with "
        "--page"
    )


def _candidates(recording: Recording, strike_id: str | None) -> list[pb.StrikeRecord]:
    """Strikes to try, in this order: the one asked for, or all, those judged good while recording first.

    Raises:
        ReplayError: there is none.
    """
    records = list(recording.strikes)
    if not records:
        raise ReplayError(
            f"{recording.path}: has no strike to animate: its strikes may not have been recorded"
        )
    if strike_id is None:
        return sorted(records, key=lambda each: each.verdict_code != Verdict.GOOD.value)
    named = [record for record in records if record.strike_id == strike_id]
    if not named:
        known = ", ".join(record.strike_id for record in records)
        raise ReplayError(
            f"{recording.path}: has no strike {strike_id!r} to animate: choose one of {known} with --page"
        )
    return named


def _animated(
    recording: Recording,
    struck: StruckObject,
    markers: list[Marker],
    reading: StrikeReading,
    fitted: views.FittedCurves,
) -> AnimatedStrike:
    motion, record = reading.motion, reading.record
    angle, fit = motion.angle, motion.fit
    if angle is None or fit is None:
        raise ValueError("a strike with a fitted curve has an angle and a fit")
    contact_ns = record.contact_time_ns or views.contact_from_motion(motion) or int(fitted.time_ns[0])
    start_ns = max(contact_ns - round(BEFORE_S * 1e9), int(angle.time_ns[0]))
    end_ns = min(int(fitted.time_ns[-1]) + round(AFTER_S * 1e9), int(angle.time_ns[-1]))
    count = int(np.count_nonzero((angle.time_ns >= start_ns) & (angle.time_ns <= end_ns)))
    frames = recording.images(start_ns=start_ns, end_ns=end_ns)
    images = tuple(islice(frames, 0, None, max(1, -(-count // MAX_FRAMES))))
    tracks = () if reading.report is None else reading.report.tracks
    planned = next((each for each in struck.plan.strikes if each.id == motion.plan_strike_id), None)
    if planned is None or not images:
        raise ReplayError(
            f"{recording.path}: strike {motion.strike_id} cannot be animated without its plan and images: "
            "name another strike with --page"
        )
    time_ns = np.array([image.time_ns for image in images]) + _late_ns(tracks, images)
    calibration = recording.manifest.cameras[0].calibration
    camera = turned_camera(camera_of_strike(calibration, record.T_world_camera), planned.heading_rad)
    camera = overlay.camera_of_report(reading.report, camera)
    rest = overlay.pose_at_rest(planned, tracks, markers, camera, contact_ns)
    inside = (time_ns >= fitted.time_ns[0]) & (time_ns <= fitted.time_ns[-1])
    theta = np.where(
        inside,
        np.interp(time_ns, fitted.time_ns, fitted.theta),
        np.interp(time_ns, angle.time_ns, angle.theta),
    )
    shown = views.angle_at(angle, time_ns, theta)
    lines = _lines(struck.model, camera, planned, rest, shown, fit.phi)
    drawn = tuple(
        replace(each, tags=_tags(tracks, image.time_ns), fitted=bool(fits))
        for each, image, fits in zip(lines, images, inside, strict=True)
    )
    name = struck.spec.name
    return AnimatedStrike(name, motion, angle, fit, fitted, contact_ns, images, time_ns, drawn)


def _late_ns(tracks: Sequence[MarkerTrack], images: Sequence[ImageFrame]) -> IntArray:
    """Delay (n,) [ns] of the tags after each image's own time by a rolling shutter; 0 if it is global."""
    late = next(((each.frame_ns, each.late_ns) for each in tracks if each.late_ns is not None), None)
    if late is None:
        return np.zeros(len(images), dtype=np.int64)
    return np.interp([image.time_ns for image in images], *late).astype(np.int64)


def _tags(tracks: Sequence[MarkerTrack], image_ns: int) -> tuple[Array, ...]:
    found = [track.corners_px[track.frame_ns == image_ns] for track in tracks]
    return tuple(np.vstack([each[0], each[0][:1]]) for each in found if len(each))


def _lines(
    model: ObjectModel,
    camera: CameraModel,
    planned: PlannedStrike,
    rest: tuple[Array, Array],
    shown: TipAngle,
    phi: float,
) -> list[FrameLines]:
    """Lines over the image of each frame: outline, pivot axis, line to the balance, vertical; no tags.

    All are marked as `fitted`; the caller corrects that.

    Args:
        model: exterior of the object.
        camera: camera with its pose in W, the world frame of the strike: y along the pivot axis, z up.
        planned: planned strike.
        rest: pose of the object at rest, R_world_object and p_world_object.
        shown: tipping angle in the frames.
        phi: balance angle [rad].
    """
    flank = rolling_outline(model, planned)
    R, p = views.object_poses(planned, shown, flank, rest)
    outlines = overlay.wireframe(model, camera, R, p)
    contact, top = _balance_line(model, planned, flank, rest, shown, phi)
    side = -1.0 if camera.T_world_camera[1, 3] < (R[0] @ contact + p[0])[1] else 1.0
    # The line lies in the object's side that faces the camera.
    along = model.hull_vertices @ R[0].T @ np.array([0.0, side, 0.0])
    depth = float(along.max()) - float((R[0] @ contact)[1] * side)
    shift = R[0].T @ np.array([0.0, side * depth, 0.0])
    ends = np.stack([contact + shift, top + shift]) @ np.swapaxes(R, 1, 2) + p[:, None]
    upright = np.stack([ends[:, 0], ends[:, 0] + [0.0, 0.0, float(np.linalg.norm(top - contact))]], axis=1)
    half = 0.5 * float(np.ptp(model.vertices @ np.array(planned.pivot.direction)))
    pivots = R @ np.array(planned.pivot.point) + p
    balance, plumb = overlay.project_to_pixels(camera, ends), overlay.project_to_pixels(camera, upright)
    return [
        FrameLines(
            (), tuple(outlines[i]), overlay.axis_line(camera, pivots[i], half), balance[i], plumb[i], True
        )
        for i in range(len(R))
    ]


def _balance_line(
    model: ObjectModel,
    planned: PlannedStrike,
    flank: SupportFunction | None,
    rest: tuple[Array, Array],
    shown: TipAngle,
    phi: float,
) -> tuple[Array, Array]:
    """Line fixed to the object, upright over the contact at balance, hence through the centre of mass.

    Args:
        model: exterior of the object.
        planned: planned strike.
        flank: curved flank on which the object rolls; None if it tips about an edge.
        rest: pose of the object at rest.
        shown: tipping angle in the frames, whose slip at balance is taken.
        phi: balance angle [rad].

    Returns:
        Ends (3,) and (3,) of the line in the object frame O [m]: the contact, and a point above the object.
    """
    nearest = [int(np.argmin(np.abs(shown.theta - phi)))]
    balanced = views.angle_at(shown, shown.time_ns[nearest], np.array([phi]))
    R, p = (each[0] for each in views.object_poses(planned, balanced, flank, rest))
    contact = R @ np.array(planned.pivot.point) + p
    if flank is not None:
        contact[0] += float(flank.evaluate(np.array(phi))[1])
    contact[2] = 0.0
    top = contact.copy()
    top[2] = _BEYOND_TOP * float((model.hull_vertices @ R.T + p)[:, 2].max())
    return (contact - p) @ R, (top - p) @ R
