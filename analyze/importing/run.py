"""`analyze import`: what other cameras filmed is looked through, told strike by strike, and written as a recording of ours."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analyze.cameras.camera_file import CameraFile, camera_of, read_camera
from analyze.errors import ImportRefused, OutputError
from analyze.importing.onsets import Onset, OnsetFinder
from analyze.importing.place import CameraPlace, CameraView, placed_by, view_of
from analyze.importing.spool import Spool
from analyze.importing.windows import Film, StrikeWindow, around, one_each, split
from analyze.pipeline.evidence import placed_markers
from analyze.reading.annex_b import VideoFormat
from analyze.reading.object_file import ObjectFiles, object_files
from analyze.sources.open_source import SourceOptions, open_source
from analyze.sources.source import Frames, FrameSource
from analyze.sources.video import VideoSource
from analyze.tracking.camera_model import camera_from_spec
from analyze.types import ImageFrame
from schemas.document import read_text
from schemas.session_manifest import CameraCalibrationSpec
from schemas.strike_plan import StrikePlan, parse_strike_plan

_SAME_RATE = 1.2
"""times another: a phone's rate changes with the light by less"""
_PLAYED_HZ = 61.0
"""below which a film may be slow motion"""
_TOLD_EVERY = 50
"""frames between two looks of the progress bar"""
_INTO_MOTION_NS = 600_000_000
"""of a strike, that places the camera: a tag that turns tells its two possible poses apart"""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class ImportOptions:
    """What is to be imported."""

    sources: tuple[Path, ...]
    object_path: Path
    plan_path: Path
    camera_path: Path | None
    """None: the sources' own files say it"""
    strikes: tuple[str, ...] = ()
    """ids of the plan's strikes, in the order of the sources, or of the strikes in the only one"""
    whole: bool = False
    """each source is a strike's window as it is: nothing is looked for"""
    source: SourceOptions = field(default_factory=SourceOptions)
    rate_sd_hz: float | None = None
    """1 sigma of the frame rate, where it was measured"""
    aside: Path | None = None
    """folder of the recording, with room for the strikes' images until they are written; None: they are decoded again for it"""


@dataclass(frozen=True)
class Import:
    """All that is known before anything is written. Use it in a `with` statement."""

    options: ImportOptions
    object: ObjectFiles
    object_text: str
    plan: StrikePlan
    plan_text: str
    camera: CameraFile
    sources: tuple[FrameSource, ...]
    images: tuple[Frames, ...]
    """of each source, those of its strikes without decoding again where they were put aside"""
    films: tuple[Film, ...]
    windows: tuple[StrikeWindow, ...]
    was_split: bool
    """one source for all strikes, told apart by what is seen"""
    rate_hz: float
    calibration: CameraCalibrationSpec
    place: CameraPlace | None
    """how well the camera is placed, where the resting object did it"""
    _open: ExitStack

    @property
    def kept(self) -> tuple[VideoSource, ...] | None:
        """The sources where all are videos that are kept as they are; None where one is not."""
        return _kept(self.sources)

    @property
    def are_files(self) -> bool:
        """Whether all sources hold PNG or JPEG files, which are kept as they are."""
        return _are_files(self.sources)

    @property
    def formats(self) -> str:
        """How the images are stored, for people."""
        if self.are_files:
            return "PNG or JPEG files as they are, of the strikes' windows"
        if self.kept is None:
            return "images as they are decoded, of the strikes' windows"
        names = {VideoFormat.H264: "H.264", VideoFormat.H265: "H.265"}
        return " and ".join(sorted({names[video.keeps] for video in self.kept if video.keeps is not None})) + ", kept as it is"

    def remarks(self) -> list[str]:
        """What is to be said of the sources, as far as they were read."""
        lens = [f"the lens is as {self.camera.path} says it"] if self.camera.of_topic else []
        return [*lens, *self._other_rates(), *self._slow_motion(), *_alike(self.sources)]

    def _slow_motion(self) -> Iterator[str]:
        """Of films that may play slower than they were filmed, and nobody says so."""
        if all(isinstance(source, VideoSource) and source.pace.slowed == 1 for source in self.sources) and self.rate_hz < _PLAYED_HZ:
            yield (
                f"{self.rate_hz:.4g} frames per second are few for a strike: if this is slow motion, say with --capture-fps how many a "
                "second were captured"
            )

    def _other_rates(self) -> Iterator[str]:
        """Of films that were looked through: those whose frames come, or are played, at another rate than the first one's."""
        said_hz = self.options.source.capture_hz
        videos = [source for source in self.sources if isinstance(source, VideoSource) and said_hz is not None]
        for video in videos[1:]:
            mine, others = video.pace.played_hz, videos[0].pace.played_hz
            if not 1 / _SAME_RATE < mine / others < _SAME_RATE:
                yield (
                    f"{video.name}: plays {mine:.4g} frames per second, {videos[0].name} {others:.4g}, and --capture-fps {said_hz:g} is of "
                    "both: import by itself what was not captured so"
                )
        first = self.films[0]
        for film in self.films[1:]:
            if film.frame_ns and first.frame_ns and not 1 / _SAME_RATE < film.frame_ns / first.frame_ns < _SAME_RATE:
                yield (
                    f"{film.path.name}: states {1e9 / film.frame_ns:.4g} frames per second, {first.path.name} {1e9 / first.frame_ns:.4g}: "
                    "if one of them is slow motion import it by itself with --capture-fps, and estimate both recordings together"
                )

    def __enter__(self) -> Import:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()


def prepare(options: ImportOptions, progress: Progress = lambda _text, _done, _total: None) -> Import:
    """Look through the sources and tell which of their images are which strike.

    Raises:
        ImportRefused: a source cannot be read or is of another camera, or which strike is which cannot be told.
        OutputError: the disk has no room for what will surely be written.
        ShapeError, DocumentError, CalibrationError: the object's, the plan's or the camera's file cannot be used.
        TrackingError: the images show another object.
    """
    files, object_text = object_files(options.object_path), read_text(options.object_path)
    plan_text = read_text(options.plan_path)
    plan = parse_strike_plan(plan_text, str(options.plan_path))
    if plan.object_sha256 != files.sha256:
        raise ImportRefused(f"{options.plan_path}: was made for another object than {files.spec.name!r}: make it anew with `analyze plan`")
    given = None if options.camera_path is None else read_camera(options.camera_path)
    planned = [strike.id for strike in plan.strikes]
    with ExitStack() as stack:
        sources = tuple(stack.enter_context(open_source(path, options.source)) for path in options.sources)
        camera = given or camera_of(sources)
        for source in sources:
            _refuse_other_camera(source, camera)
        _refuse_full(options.aside, _kept(sources) or ())
        splits = len(sources) == 1 and not options.whole and len(options.strikes) != 1 and len(planned) > 1
        spools = _spools(options, sources, stack)
        images: tuple[Frames, ...] = tuple(spool or source for spool, source in zip(spools, sources, strict=True))
        if options.whole:
            films = tuple(Film(path) for path in options.sources)
        else:
            ways = frozenset(math.cos(strike.heading_rad) > 0 for strike in plan.strikes)
            look = _Look([marker.name for marker in files.spec.marker], splits, ways, progress)
            films = tuple(look.through(*each) for each in zip(options.sources, sources, spools, strict=True))
        windows = split(films[0], planned, options.strikes) if splits else one_each(films, planned, options.strikes)
        if not windows:
            raise ImportRefused("nothing is left to be imported: every source is left out")
        if not camera.placed and not options.whole and all(window.onset is None for window in windows):
            film = films[windows[0].film]
            raise ImportRefused(f"{film.path}: no strike is seen in it: {film.why_none}")
        place = None if camera.placed else _place(files, plan, camera, images, windows, progress)
        calibration = camera.calibration
        if place is not None:
            calibration = calibration.model_copy(update={"T_world_camera": place.T_world_camera.tolist()})
        return Import(
            options,
            files,
            object_text,
            plan,
            plan_text,
            camera,
            sources,
            images,
            films,
            windows,
            splits,
            sources[0].rate_hz,
            calibration,
            place,
            stack.pop_all(),
        )


def _alike(sources: Sequence[FrameSource]) -> Iterator[str]:
    """What is to be said of each; of several alike once."""
    said: dict[str, list[str]] = {}
    for source in sources:
        for remark in source.remarks:
            said.setdefault(remark.removeprefix(f"{source.name}: "), []).append(source.name)
    for remark, names in said.items():
        yield f"{names[0] if len(names) == 1 else f'{names[0]} and {len(names) - 1} more'}: {remark}"


def _refuse_full(folder: Path | None, kept: Sequence[VideoSource]) -> None:
    """Films that are kept as they are need as much room as they have: said before they are looked through."""
    needed = sum(video.path.stat().st_size for video in kept)
    if folder is not None and (free := shutil.disk_usage(folder).free) < needed:
        raise OutputError(f"{folder}: has {free / 1e6:.0f} MB free, the recording needs {needed / 1e6:.0f} MB: choose another place")


def _refuse_other_camera(source: FrameSource, camera: CameraFile) -> None:
    spec = camera.calibration
    if (source.width, source.height) != (spec.width, spec.height):
        said = f"{source.name}: has {source.width} x {source.height} px, {camera.path} is of {spec.width} x {spec.height}"
        if (source.width, source.height) == (spec.height, spec.width):
            raise ImportRefused(
                f"{said}: one of them was turned when it was edited or shared: import and calibrate with the films as the camera took "
                "them, which stay as the sensor has them however it was held"
            )
        raise ImportRefused(f"{said}: calibrate with a film of the mode that the strikes were filmed in, not with photos")


def _kept(sources: Sequence[FrameSource]) -> tuple[VideoSource, ...] | None:
    videos = tuple(source for source in sources if isinstance(source, VideoSource) and source.keeps is not None)
    return videos if len(videos) == len(sources) else None


def _are_files(sources: Sequence[FrameSource]) -> bool:
    return all(source.holds_files for source in sources)


def _spools(options: ImportOptions, sources: Sequence[FrameSource], stack: ExitStack) -> list[Spool | None]:
    """One for each source whose images would be decoded once to find the strikes, and once to be written."""
    if options.aside is None or options.whole or _kept(sources) is not None or _are_files(sources):
        return [None for _ in sources]
    return [stack.enter_context(Spool(source, options.aside)) if source.is_coded else None for source in sources]


class _Look(NamedTuple):
    """How sources are looked through."""

    markers: Sequence[int | str]
    every_strike: bool
    """of a source; else its first alone"""
    ways: frozenset[bool]
    """in which the plan's strikes tip, as the camera sees them: clockwise, or not"""
    progress: Progress

    def through(self, path: Path, source: FrameSource, spool: Spool | None) -> Film:
        """Where its strikes are; their images are put aside."""
        frame_ns = 1e9 / source.rate_hz
        finder = OnsetFinder(self.markers, frame_ns, self.ways)
        onsets, times = list[Onset](), list[int]()
        for number, frame in enumerate(source.frames()):
            if number % _TOLD_EVERY == 0:
                self.progress(f"looking through {source.name}", number, source.frame_count or number)
            times.append(frame.time_ns)
            if spool is not None:
                spool.add(frame)
            if (onset := finder.add(frame)) is not None:
                if spool is not None and (self.every_strike or not onsets):
                    spool.keep(*around(onset, frame_ns))
                onsets.append(onset)
        if not finder.ever_seen:
            names = ", ".join(str(name) for name in self.markers) or "none"
            raise ImportRefused(f"{path}: no tag of the object ({names}) is seen in it: film nearer, sharper or with more light")
        if isinstance(source, VideoSource):
            source.heed_paces(np.array(times, np.int64))
        return Film(path, tuple(onsets), times[-1] if times else None, frame_ns, finder.ever_rested)


def _place(
    files: ObjectFiles,
    plan: StrikePlan,
    camera: CameraFile,
    images: Sequence[Frames],
    windows: Sequence[StrikeWindow],
    progress: Progress,
) -> CameraPlace:
    lens, markers = camera_from_spec(camera.calibration), placed_markers(files.spec)
    views: list[CameraView] = []
    for number, window in enumerate(windows):
        progress("placing the camera", number, len(windows))
        if window.onset is None:
            continue
        planned = next(strike for strike in plan.strikes if strike.id == window.plan_strike_id)
        frames = _numbered(images[window.film], window.start_ns, window.onset.time_ns + _INTO_MOTION_NS)
        view = view_of(frames, window.onset.time_ns, lens, markers, planned, window.strike_id)
        if view is not None:
            views.append(view)
    return placed_by(views)


def _numbered(images: Frames, start_ns: int | None, end_ns: int) -> Iterator[ImageFrame]:
    for number, frame in enumerate(images.frames(start_ns, end_ns)):
        yield ImageFrame(frame.time_ns, number, frame.image)
