"""Everything that is known of an import before the recording is written, with remarks for the user."""

from __future__ import annotations

import enum
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from analyze.cameras.camera_file import CameraFile
from analyze.importing.camera_pose import EstimatedCameraPose
from analyze.importing.found_strikes import FoundStrike
from analyze.importing.mat_cameras import MatCameras
from analyze.importing.options import ImportOptions
from analyze.importing.windows import Clip, StrikeWindow
from analyze.reading.annex_b import VideoFormat
from analyze.reading.object_file import ObjectFiles
from analyze.sources.source import Frames, FrameSource
from analyze.sources.video import VideoSource
from schemas.session_manifest import CameraCalibrationSpec
from schemas.strike_plan import StrikePlan

MAX_RATE_RATIO = 1.2
"""ratio of two frame rates above which they differ; the light changes a phone's rate by less"""
MAX_SLOW_MOTION_HZ = 61.0
"""frame rate below which a video may be slow motion [Hz]"""


class Assignment(enum.Enum):
    """Rule by which the sources were assigned to the planned strikes; values are words for the user."""

    OPTION = "as --strike names them"
    NAMES = "by the files' names"
    IMAGES = "by the tag at rest and the edge that the object tips over"
    ORDER = "in the plan's order"


@dataclass(frozen=True)
class PreparedImport:
    """Everything that is known of an import before the recording is written.

    Use it in a `with` statement: leaving it deletes the images that were stored during the search.
    """

    options: ImportOptions
    """options of the import"""
    object: ObjectFiles
    """object specification and shape file"""
    object_text: str
    """content of the object file"""
    plan: StrikePlan
    """strike plan, made for this object; without one, what was found to be struck"""
    plan_text: str
    """content of the plan's file, or the text of what was found to be struck"""
    camera: CameraFile
    """lens and, if the file has it, pose of the camera"""
    sources: tuple[FrameSource, ...]
    """sources of images, in the order given"""
    images: tuple[Frames, ...]
    """images of each source; those stored during the search are not decoded again"""
    clips: tuple[Clip, ...]
    """each source with the onsets of strikes found in it; without any if it was not searched"""
    windows: tuple[StrikeWindow, ...]
    """parts of the sources that show the planned strikes"""
    was_split: bool
    """True if the only source was searched for several strikes"""
    assignment: Assignment
    """how the sources were assigned to the planned strikes"""
    camera_remarks: tuple[str, ...]
    """remarks on a camera that moved during strikes, or between them, and on strikes that nobody planned"""
    rate_hz: float
    """frame rate of the first source as captured [Hz]"""
    calibration: CameraCalibrationSpec
    """lens and pose of the camera as the recording states them"""
    found: tuple[FoundStrike, ...] | None
    """strikes that were found without a plan, in the order of the windows; None if there was a plan"""
    tosses: tuple[FrameSource, ...]
    """sources that show a toss each; `images` ends with them"""
    place: EstimatedCameraPose | None
    """camera pose estimated from the resting object; None if the camera file or a mat states the pose"""
    mat: MatCameras | None
    """camera's pose in each tip by the mat; None if no mat is seen"""
    _open: ExitStack

    @property
    def all_sources(self) -> tuple[FrameSource, ...]:
        """Sources of strikes, and after them those of tosses; at least one."""
        return *self.sources, *self.tosses

    @property
    def storable_videos(self) -> tuple[VideoSource, ...] | None:
        """All sources if each is a video that is stored as coded (H.264, H.265); None otherwise."""
        return storable_videos(self.all_sources)

    def own_pose(self, window: StrikeWindow) -> list[float]:
        """Pose of the camera in W in one strike, 16 numbers row by row; empty without a mat in it."""
        own = None if self.mat is None else self.mat.own[window.tip]
        return [] if own is None else own.ravel().tolist()

    @property
    def are_files(self) -> bool:
        """True if the images of all sources are PNG or JPEG files, which are stored unchanged."""
        return all(source.holds_files for source in self.all_sources)

    @property
    def formats(self) -> str:
        """Words that name the format in which images will be stored, such as "H.264, stored unchanged"."""
        if self.are_files:
            return "PNG or JPEG files unchanged, of the strikes' windows"
        if self.storable_videos is None:
            return "decoded images, of the strikes' windows"
        names = {VideoFormat.H264: "H.264", VideoFormat.H265: "H.265"}
        kinds = {names[video.storable_format] for video in self.storable_videos if video.storable_format}
        return f"{' and '.join(sorted(kinds))}, stored unchanged"

    def remarks(self) -> list[str]:
        """Remarks for the user on lens, frame rates and sources; complete once all sources were read."""
        lens = [f"the lens is that of {self.camera.path}"] if self.camera.of_topic else []
        return [
            *lens,
            *self.camera_remarks,
            *self._unplaced_tags(),
            *self._other_rates(),
            *self._slow_motion(),
            *_merged_remarks(self.all_sources),
        ]

    def _unplaced_tags(self) -> Iterator[str]:
        """Yield a remark if no tag has a place on the object: videos are only checked against each other."""
        markers = self.object.spec.marker
        if not markers and self.sources:
            yield (
                "the object has no tag: strikes are followed by its print, and nothing checks that each "
                "source shows the strike named beside it"
            )
        elif all(marker.T_object_marker is None for marker in markers):
            yield (
                "the object file has no place of a tag (T_object_marker), so that videos are only checked "
                "against each other: `analyze register` finds the places, and names a strike that was placed "
                "otherwise"
            )

    def _slow_motion(self) -> Iterator[str]:
        """Yield a remark if all sources are videos and the first one's rate is low, as of slow motion.

        No remark is made if a slow-motion capture rate is known already.
        """
        if (
            all(isinstance(source, VideoSource) and source.may_be_slow for source in self.all_sources)
            and self.rate_hz < MAX_SLOW_MOTION_HZ
        ):
            yield (
                f"{self.rate_hz:.4g} frames per second are few for a strike: if this is slow motion, give "
                "the capture rate with --capture-fps"
            )

    def _other_rates(self) -> Iterator[str]:
        """Yield remarks on sources whose frame rate differs from the first one's.

        Rates differ if their ratio is `MAX_RATE_RATIO` or more. If the user gave a capture rate, the rates at
        which the videos play are compared, too.
        """
        capture_hz = self.options.source.capture_hz
        videos = [
            source
            for source in self.all_sources
            if isinstance(source, VideoSource) and capture_hz is not None
        ]
        for video in videos[1:]:
            mine, others = video.timing.played_hz, videos[0].timing.played_hz
            if not 1 / MAX_RATE_RATIO < mine / others < MAX_RATE_RATIO:
                yield (
                    f"{video.name}: plays {mine:.4g} frames per second, {videos[0].name} {others:.4g}, but "
                    f"--capture-fps {capture_hz:g} applies to both: import videos of another capture rate by "
                    "themselves"
                )
        for clip in self.clips[1:]:
            first = self.clips[0]
            if (
                clip.frame_ns
                and first.frame_ns
                and not 1 / MAX_RATE_RATIO < clip.frame_ns / first.frame_ns < MAX_RATE_RATIO
            ):
                yield (
                    f"{clip.path.name}: states {1e9 / clip.frame_ns:.4g} frames per second, "
                    f"{first.path.name} {1e9 / first.frame_ns:.4g}: if one of them is slow motion, import it "
                    "by itself with --capture-fps, and estimate both recordings together"
                )

    def __enter__(self) -> PreparedImport:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()


def _merged_remarks(sources: Sequence[FrameSource]) -> Iterator[str]:
    """Yield the sources' remarks, each after the source's name.

    A remark that n sources share is yielded once, after "NAME and n-1 more".
    """
    sources_of: dict[str, list[str]] = {}
    for source in sources:
        for remark in source.remarks:
            sources_of.setdefault(remark.removeprefix(f"{source.name}: "), []).append(source.name)
    for remark, names in sources_of.items():
        yield f"{names[0] if len(names) == 1 else f'{names[0]} and {len(names) - 1} more'}: {remark}"


def storable_videos(sources: Sequence[FrameSource]) -> tuple[VideoSource, ...] | None:
    """All sources if each is a video that is stored as coded (H.264, H.265); None otherwise."""
    videos = tuple(
        source for source in sources if isinstance(source, VideoSource) and source.storable_format is not None
    )
    return videos if len(videos) == len(sources) else None
