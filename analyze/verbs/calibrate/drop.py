"""`analyze calibrate --drop`: the tag filmed in free fall says how fast the frames came, or one line says why it does not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analyze.cameras.camera_file import read_camera
from analyze.errors import CalibrationError, RecordingForeign
from analyze.motion.fall_window import LEAST_FALL, fall_windows
from analyze.motion.free_fall import Fall, Film, TrueTime, settled_fall, true_time
from analyze.pipeline.evidence import read_head
from analyze.reading.recording import open_recording
from analyze.sources.open_source import SourceOptions, open_source
from analyze.sources.source import FrameSource
from analyze.tracking.camera_model import camera_from_spec
from analyze.tracking.marker import detect, of_another_family
from analyze.tracking.pose import position_covariance
from analyze.tracking.track import MarkerFollower
from analyze.types import CameraModel, ImageFrame, Marker, MarkerTrack
from schemas.session_manifest import TimeSource
from schemas.tags import USUAL_FAMILY

RECORDING = ".mcap"
LOOKED_AT_EVERY = 5
"""frames, until the first tag is seen"""
RESCAN_EVERY = 4
"""frames, while the tag is out of sight: it falls through the view in a few dozen"""
SHARED_PX = 0.05
"""1 sigma of a corner beside its noise, from lens, codec and blur"""
ANYWHERE = (9.81, 0.02)
"""g [m/s^2] and 1 sigma, between equator and poles"""
STATED_G_SD = 0.002

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class DropOptions:
    """What the user asks for."""

    source: Path
    """a video, a folder of images, a recording"""
    size: float
    """m, of the tag's black square"""
    size_sd: float
    mass: float
    """kg, of what falls"""
    camera: Path | None = None
    """None: the recording's own"""
    marker: str | None = None
    """None: the first that is seen"""
    capture_hz: float | None = None
    gravity: float | None = None
    """None: the recording's, else anywhere's"""
    global_shutter: bool = False
    """all rows are read at once; else only a rig's camera and one whose line time is stated are known"""


@dataclass(frozen=True)
class DropAnswer:
    """What the falls tell."""

    options: DropOptions
    marker_id: int | str
    frames: int
    """of the film"""
    seen: int
    """with the tag"""
    falls: tuple[Fall, ...]
    time: TrueTime
    film: Film
    stated_hz: float
    """frames a second by the film's times"""

    @property
    def true_hz(self) -> float:
        """Frames a second, measured."""
        return self.stated_hz / self.time.slower

    @property
    def true_sd_hz(self) -> float:
        """1 sigma of it."""
        return self.true_hz * self.time.sd / self.time.slower


@dataclass(frozen=True)
class Filmed:
    """A film opened: what gives its images, and what is known of it."""

    name: str
    frames: Callable[[], Iterator[ImageFrame]]
    """anew each time"""
    count: int | None
    camera: CameraModel
    time_sd: float
    """s"""
    gravity: tuple[float, float]
    rig: bool
    """of a rig's camera, whose line time is known, 0 too"""


def measure_drop(options: DropOptions, progress: Progress = lambda _text, _done, _total: None) -> DropAnswer:
    """Follow the tag, find where it falls, and how long a second truly is.

    Raises:
        CalibrationError: no camera is given, no tag is seen, or none falls.
        ImportRefused, RecordingError: the film cannot be read.
        TrackingError: a tag is in view twice, or the images are not of the camera's size.
    """
    if options.source.suffix == RECORDING and options.source.is_file():
        try:
            head = read_head(options.source)
        except RecordingForeign:
            pass
        else:
            manifest = head.manifest
            if options.capture_hz is not None:
                raise CalibrationError(
                    f"{options.source}: --capture-fps is of videos: a recording's frames have times of their own: leave it out"
                )
            with open_recording(options.source) as recording:
                camera = camera_from_spec(manifest.cameras[0].calibration) if options.camera is None else _camera(options)
                filmed = Filmed(
                    str(options.source),
                    recording.images,
                    None,
                    camera,
                    1e-9 * manifest.time_source_sd_ns,
                    (manifest.g_m_s2, manifest.g_sd_m_s2),
                    manifest.time_source is not TimeSource.CONTAINER_PTS,
                )
                return drop_of(filmed, options, progress)
    with open_source(options.source, SourceOptions(capture_hz=options.capture_hz)) as source:
        filmed = Filmed(
            source.name, lambda: _numbered(source), source.frame_count, _camera(options), 1e-9 * source.time_sd_ns, ANYWHERE, False
        )
        return drop_of(filmed, options, progress)


def _camera(options: DropOptions) -> CameraModel:
    if options.camera is None:
        raise CalibrationError(
            f"{options.source}: does not say which lens filmed it: give --camera CAMERA (analyze calibrate -o, OpenCV, ROS)"
        )
    return camera_from_spec(read_camera(options.camera).calibration)


def _numbered(source: FrameSource) -> Iterator[ImageFrame]:
    for number, frame in enumerate(source.frames()):
        yield ImageFrame(frame.time_ns, number, frame.image.copy())


def drop_of(filmed: Filmed, options: DropOptions, progress: Progress = lambda _text, _done, _total: None) -> DropAnswer:
    """The same, of a film that is open."""
    marker_id = _first_tag(filmed) if options.marker is None else _id_of(options.marker)
    track, frames = _followed(filmed, Marker(marker_id, options.size, None), progress)
    film = _film(filmed, options)
    found: list[Fall] = []
    if len(track.time_ns):
        corner_sd = np.hypot(track.corner_sd_px, SHARED_PX)
        covariance = position_covariance(track.R_camera_marker, track.p_camera_marker, corner_sd, options.size, filmed.camera.K)
        sd = np.sqrt(np.median(np.einsum("nii->ni", covariance), axis=0))
        windows = fall_windows(track.time_ns, track.p_camera_marker, sd)
        found = [fall for window in windows if (fall := settled_fall(track, covariance, window, film)) is not None]
    if not found:
        raise CalibrationError(
            f"{filmed.name}: marker {marker_id} is seen in {len(track.time_ns)} of {frames} frames, but no free fall of {LEAST_FALL:g} m: "
            "hold it still in view, let go without a push, and let it fall 0.3 m or more before the camera; more light and a shorter "
            "exposure if it blurs"
        )
    falls = _alike(found)
    stated = float(np.median([fall.frame_s for fall in falls]))
    return DropAnswer(options, marker_id, frames, len(track.time_ns), tuple(falls), true_time(falls, film), film, 1 / stated)


def _film(filmed: Filmed, options: DropOptions) -> Film:
    gravity, gravity_sd = filmed.gravity if options.gravity is None else (options.gravity, STATED_G_SD)
    stated = filmed.camera.line_time_s
    known = filmed.rig or options.global_shutter or stated != 0
    return Film(
        size=options.size,
        size_sd=options.size_sd,
        gravity=gravity,
        gravity_sd=gravity_sd,
        mass=options.mass,
        line_time=(0.0 if options.global_shutter else stated) if known else None,
        rows=filmed.camera.height,
        time_sd=filmed.time_sd,
    )


def _alike(falls: list[Fall]) -> list[Fall]:
    """The longest fall, and those that mean the same time within what they are known to; a hand's swing that looks like a fall does not."""
    best = max(falls, key=lambda fall: fall.dropped)
    return [
        fall
        for fall in falls
        if abs(fall.slower - best.slower) <= 4 * float(np.hypot(fall.noise_sd + fall.shared_sd, best.noise_sd + best.shared_sd))
    ]


def _id_of(name: str) -> int | str:
    return int(name) if name.isdecimal() else name


def _first_tag(filmed: Filmed) -> int | str:
    """The largest tag of the first frame that shows one."""
    looked_at, first = 0, None
    for frame in filmed.frames():
        first = frame.image if first is None else first
        if frame.sequence % LOOKED_AT_EVERY == 0 or looked_at == 0:
            looked_at += 1
            if seen := detect(frame.image):
                return seen[0].marker_id
    if first is None:
        raise CalibrationError(f"{filmed.name}: holds no images: film the tag while it falls")
    other = of_another_family(first, (USUAL_FAMILY,))
    hint = f"; what looks like {other} is: name it with --marker" if other is not None else ""
    raise CalibrationError(
        f"{filmed.name}: no tag is seen in {looked_at} images{hint}: print one (analyze print-tags), and film it in focus"
    )


def _followed(filmed: Filmed, marker: Marker, progress: Progress) -> tuple[MarkerTrack, int]:
    # Rows that are read late are the fit's matter: it knows that the film's seconds may not be seconds.
    follower = MarkerFollower(replace(filmed.camera, line_time_s=0.0), [marker], rescan_every=RESCAN_EVERY)
    for frame in filmed.frames():
        if follower.frames_total % 10 == 0:
            progress("following the tag", follower.frames_total, filmed.count or follower.frames_total + 1)
        follower.add(frame)
    report = follower.report()
    if report.tracks:
        return report.tracks[0], report.frames_total
    nothing = np.zeros(0)
    empty = MarkerTrack(
        marker.id, nothing.astype(np.int64), np.zeros((0, 4, 2)), nothing, np.zeros((0, 3, 3)), np.zeros((0, 3)), report.frames_total
    )
    return empty, report.frames_total
