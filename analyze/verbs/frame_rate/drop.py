"""`analyze frame-rate`: the true frame rate of a camera from a video of a tag in free fall."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analyze.cameras.camera_file import read_camera
from analyze.errors import CalibrationError, RecordingForeign
from analyze.motion.fall_window import MIN_FALL_M, fall_windows
from analyze.motion.free_fall import Fall, FallSetup, settled_fall
from analyze.motion.true_time import TrueTime, true_time
from analyze.pipeline.read_evidence import read_head
from analyze.progress import Progress, no_progress
from analyze.reading.recording import open_recording
from analyze.sources.open_source import SourceOptions, open_source
from analyze.sources.source import FrameSource
from analyze.tracking.camera_model import camera_from_spec
from analyze.tracking.marker import detect, marker_of_other_family
from analyze.tracking.pose import position_covariance
from analyze.tracking.track import MarkerFollower
from analyze.types import CameraModel, ImageFrame, Marker, MarkerTrack
from schemas.session_manifest import TimeSource
from schemas.tags import USUAL_FAMILY, family_and_id
from schemas.wording import counted

RECORDING_SUFFIX = ".mcap"
SEARCH_EVERY_FRAMES = 5
"""frames between two searches until the first tag is seen"""
RESCAN_EVERY_FRAMES = 4
"""frames between two searches while the tag is out of sight: it falls through the view in a few dozen"""
SHARED_CORNER_SD_PX = 0.05
"""standard deviation of a corner beside its noise [px], from lens, codec and blur"""
WORLDWIDE_G = (9.81, 0.02)
"""g [m/s^2] and its standard deviation, between equator and poles"""
STATED_G_SD = 0.002
"""standard deviation of g given with --g [m/s^2]"""


@dataclass(frozen=True)
class DropOptions:
    """Options of `analyze frame-rate`: the video, the falling tag and the camera."""

    source: Path
    """video, folder of images or recording"""
    size: float
    """edge of the tag's black square [m]"""
    size_sd: float
    """standard deviation of that edge [m]"""
    mass: float
    """mass of the falling body [kg]"""
    camera: Path | None = None
    """camera file; None for the recording's own camera"""
    marker: str | None = None
    """id of the tag; None for the first that is seen"""
    capture_hz: float | None = None
    """frame rate that the camera states [Hz]; None for the video's time stamps"""
    gravity: float | None = None
    """local g [m/s^2]; None for the recording's, else the worldwide mean"""
    global_shutter: bool = False
    """True if the camera reads all rows at once; else the line time (from one row's reading to the next) is
    that of the camera file, or unknown"""


@dataclass(frozen=True)
class DropAnswer:
    """True frame rate of a camera, measured from one or more free falls of a tag.

    It is given as the ratio of true to stated time, with its sd.
    """

    options: DropOptions
    """options with which it was measured"""
    marker_id: int | str
    """id of the tag"""
    frames: int
    """frames of the video"""
    seen: int
    """frames in which the tag was found"""
    falls: tuple[Fall, ...]
    """falls that agree with the longest one; at least one"""
    time: TrueTime
    """ratio of true to stated time from all falls, with its standard deviation"""
    setup: FallSetup
    """tag, gravity, falling mass and camera that were assumed"""
    stated_hz: float
    """frame rate by the video's time stamps [Hz]"""

    @property
    def true_hz(self) -> float:
        """Measured frame rate [Hz]: that of the time stamps, divided by the ratio of true to stated time."""
        return self.stated_hz / self.time.time_ratio

    @property
    def true_sd_hz(self) -> float:
        """Standard deviation [Hz] of the measured frame rate `true_hz`."""
        return self.true_hz * self.time.sd / self.time.time_ratio


@dataclass(frozen=True)
class _Footage:
    """An open video or recording of the falling tag, and what is known about its camera."""

    name: str
    """path or name, for messages"""
    frames: Callable[[], Iterator[ImageFrame]]
    """function that starts reading from the first frame"""
    count: int | None
    """number of frames; None if unknown"""
    camera: CameraModel
    """lens of the camera that took it"""
    time_sd: float
    """standard deviation of a frame's time [s]"""
    gravity: tuple[float, float]
    """g and its standard deviation [m/s^2]"""
    rig: bool
    """True if a rig's camera recorded it, whose line time is known (and may be 0)"""


def measure_drop(options: DropOptions, progress: Progress = no_progress) -> DropAnswer:
    """Measure the true frame rate of a camera from the free falls of a tag in a video or recording.

    Args:
        options: the video, and what is known about tag, body, camera and gravity.
        progress: called with a text, the number of frames read and of all.

    Returns:
        Frame rate with its uncertainty, and the falls that it was measured from.

    Raises:
        CalibrationError: no camera is given, the camera file cannot be used, `options` name a tag that does
            not exist, a capture rate is given for a recording, no tag is seen, or it does not fall.
        DocumentError: an entry of the camera file has a value that is not allowed.
        EstimationError: a fall has no acceleration.
        ImportRefused, RecordingError: the video or recording cannot be read.
        TrackingError: a tag is in view twice, only other tags are in view, or the images are not of the
            camera's size.
    """
    if options.source.suffix == RECORDING_SUFFIX and options.source.is_file():
        try:
            head = read_head(options.source)
        except RecordingForeign:
            pass
        else:
            manifest = head.manifest
            if options.capture_hz is not None:
                raise CalibrationError(
                    f"{options.source}: --capture-fps is for videos: a recording's frames have times of "
                    "their own: leave it out"
                )
            with open_recording(options.source) as recording:
                camera = (
                    camera_from_spec(manifest.cameras[0].calibration)
                    if options.camera is None
                    else _camera(options)
                )
                footage = _Footage(
                    str(options.source),
                    recording.images,
                    None,
                    camera,
                    1e-9 * manifest.time_source_sd_ns,
                    (manifest.g_m_s2, manifest.g_sd_m_s2),
                    manifest.time_source is not TimeSource.CONTAINER_PTS,
                )
                return _measure(footage, options, progress)
    source = open_source(options.source, SourceOptions(capture_hz=options.capture_hz))
    footage = _Footage(
        source.name,
        lambda: _frames(source),
        source.frame_count,
        _camera(options),
        1e-9 * source.time_sd_ns,
        WORLDWIDE_G,
        False,
    )
    return _measure(footage, options, progress)


def _camera(options: DropOptions) -> CameraModel:
    """Lens of the camera, from the camera file that the options name.

    Raises:
        CalibrationError: the options name no camera file, or the file cannot be used.
    """
    if options.camera is None:
        raise CalibrationError(
            f"{options.source}: its lens is unknown: give --camera CAMERA (a file of analyze calibrate -o, "
            "OpenCV or ROS)"
        )
    return camera_from_spec(read_camera(options.camera).calibration)


def _frames(source: FrameSource) -> Iterator[ImageFrame]:
    for number, frame in enumerate(source.frames()):
        yield ImageFrame(frame.time_ns, number, frame.image.copy())


def _measure(footage: _Footage, options: DropOptions, progress: Progress = no_progress) -> DropAnswer:
    marker_id = _first_tag(footage) if options.marker is None else _marker_id(options.marker)
    track, frames = _follow(footage, Marker(marker_id, options.size, None), progress)
    seen = 0 if track is None else len(track.time_ns)
    setup = _fall_setup(footage, options)
    found: list[Fall] = []
    if track is not None:
        corner_sd = np.hypot(track.corner_sd_px, SHARED_CORNER_SD_PX)
        covariance = position_covariance(
            track.R_camera_marker, track.p_camera_marker, corner_sd, options.size, footage.camera.K
        )
        sd = np.sqrt(np.median(np.einsum("nii->ni", covariance), axis=0))
        windows = fall_windows(track.time_ns, track.p_camera_marker, sd)
        found = [
            fall for window in windows if (fall := settled_fall(track, covariance, window, setup)) is not None
        ]
    if not found:
        raise CalibrationError(
            f"{footage.name}: marker {marker_id} is seen in {seen} of {counted(frames, 'frame')}, but no "
            f"free fall of {MIN_FALL_M:g} m: hold it still in view, let go without a push, and let it fall "
            "0.3 m or more before the camera; more light and a shorter exposure if it blurs"
        )
    falls = _consistent(found)
    stated = float(np.median([fall.frame_s for fall in falls]))
    return DropAnswer(
        options,
        marker_id,
        frames,
        seen,
        tuple(falls),
        true_time(falls, setup),
        setup,
        1 / stated,
    )


def _fall_setup(footage: _Footage, options: DropOptions) -> FallSetup:
    """Known quantities of a falling tag, as the fit of the fall assumes them.

    They are the tag's edge [m] and gravity [m/s^2], each with its sd; the mass of the falling body [kg]; the
    shutter's line time [s], the number of image rows, and the sd of a frame's time [s].

    The line time is the delay from one image row to the next: 0 with --global-shutter, else that of the
    camera file or recording. A stated 0 counts only for images that a rig's camera recorded; for others it
    means unknown (None).
    """
    gravity, gravity_sd = footage.gravity if options.gravity is None else (options.gravity, STATED_G_SD)
    stated = footage.camera.line_time_s
    known = footage.rig or options.global_shutter or stated != 0
    return FallSetup(
        size=options.size,
        size_sd=options.size_sd,
        gravity=gravity,
        gravity_sd=gravity_sd,
        mass=options.mass,
        line_time=(0.0 if options.global_shutter else stated) if known else None,
        rows=footage.camera.height,
        time_sd=footage.time_sd,
    )


def _consistent(falls: list[Fall]) -> list[Fall]:
    """Falls whose ratio of true to stated time agrees with that of the longest fall, in the given order.

    A fall's ratio is its duration by gravity over that by the time stamps. Ratios agree if they differ by at
    most four standard deviations of the difference; a hand's swing that resembles a fall does not. The
    longest fall itself is always returned.
    """
    best = max(falls, key=lambda fall: fall.dropped)
    return [
        fall
        for fall in falls
        if abs(fall.time_ratio - best.time_ratio)
        <= 4 * float(np.hypot(fall.noise_sd + fall.shared_sd, best.noise_sd + best.shared_sd))
    ]


def _marker_id(name: str) -> int | str:
    """Id of the tag named with --marker: a number for family 36h11, otherwise the name, such as "25h9-0".

    Raises:
        CalibrationError: there is no such tag.
    """
    try:
        family_and_id(found := int(name) if name.isdecimal() else name)
    except ValueError as error:
        raise CalibrationError(f"--marker {name}: {error}") from None
    return found


def _first_tag(footage: _Footage) -> int | str:
    """Id of the largest tag of family 36h11 in the first image that shows one, of the images searched.

    The first image is searched, and those whose number is a multiple of `SEARCH_EVERY_FRAMES` (5).

    Raises:
        CalibrationError: there are no images, or none of those searched shows such a tag.
    """
    looked_at, first = 0, None
    for frame in footage.frames():
        first = frame.image if first is None else first
        if frame.sequence % SEARCH_EVERY_FRAMES == 0 or looked_at == 0:
            looked_at += 1
            if seen := detect(frame.image):
                return seen[0].marker_id
    if first is None:
        raise CalibrationError(f"{footage.name}: contains no images: record the tag while it falls")
    other = marker_of_other_family(first, (USUAL_FAMILY,))
    hint = f"; one of family {other} is: name it with --marker" if other is not None else ""
    raise CalibrationError(
        f"{footage.name}: no tag is seen in {counted(looked_at, 'image')}{hint}: print one (analyze "
        "print-tags) and record it in focus"
    )


def _follow(footage: _Footage, marker: Marker, progress: Progress) -> tuple[MarkerTrack | None, int]:
    """Follow the tag through all frames; return its track (pose in each frame) and the number of frames.

    The track is None if the tag is never seen. Its poses are in the camera frame.

    Raises:
        TrackingError: the tag is in view twice, only other tags are in view, or the images are not of the
            camera's size.
    """
    # The fit models the rolling shutter itself, since the stated seconds may not be true seconds.
    follower = MarkerFollower(
        replace(footage.camera, line_time_s=0.0), [marker], rescan_every=RESCAN_EVERY_FRAMES
    )
    for frame in footage.frames():
        if follower.frames_total % 10 == 0:
            progress("following the tag", follower.frames_total, footage.count or follower.frames_total + 1)
        follower.add(frame)
    report = follower.report()
    return next(iter(report.tracks), None), report.frames_total
