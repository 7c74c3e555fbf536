"""Views of the tips in an import's clips: tag and turning line of each; whether the camera stood still."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from analyze.calibration.mat_pose import read_mat
from analyze.cameras.camera_file import CameraFile
from analyze.errors import TrackingError
from analyze.importing.mat_cameras import SOURCE_IMAGES, MatWatch, SeenMat
from analyze.importing.tip_view import TagView, tag_views
from analyze.importing.windows import Clip, FoundTip, window_around
from analyze.progress import Progress
from analyze.sources.source import Frames, TimedImage
from analyze.tracking.camera_model import camera_from_spec
from analyze.tracking.camera_motion import camera_shift
from analyze.types import CameraModel, ImageFrame, Marker

MOTION_AFTER_ONSET_NS = 600_000_000
"""time after the onset of which images are used to recognise a strike [ns]: the motion shows the edge, and
resolves a tag's pose ambiguity"""
MOTION_FRAMES = 144
"""least number of images after the onset that are used, so that undeclared slow motion shows enough of the
motion"""
WATCH_FRAMES = 24
"""images from one comparison of the background to the next"""


@dataclass(frozen=True)
class SeenTips:
    """Each tip as the camera sees it, and remarks on a camera that did not stand still."""

    tags: tuple[tuple[TagView, ...], ...]
    """for each tip the views of its tags, the best first; empty if no marker is at rest in view"""
    remarks: tuple[str, ...] = ()
    """remarks for the user on a camera that moved during a tip, or between tips, where no mat shows it"""
    mats: tuple[SeenMat | None, ...] = ()
    """for each tip the mat, with the camera's pose; None where none is seen"""


@dataclass
class WatchedImages:
    """Images of one tip that pass by, with the largest shift of the background against the first of them."""

    images: Iterable[TimedImage]
    """the images"""
    mat: MatWatch
    """the mat in them"""
    first: TimedImage | None = None
    """first image; None before it was read"""
    shift_px: float = 0.0
    """largest shift of the background against the first image [px]; 0 if it stayed, or shows too little"""

    def frames(self) -> Iterator[ImageFrame]:
        """Yield the images as numbered frames; every `WATCH_FRAMES`-th and the last are compared."""
        last: TimedImage | None = None
        for number, image in enumerate(self.images):
            self.first, last = self.first or image, image
            if number % WATCH_FRAMES == 0:
                self._compare(image)
                self.mat.look(image)
            yield ImageFrame(image.time_ns, number, image.image)
        if last is not None:
            self._compare(last)
            self.mat.look(last)

    def _compare(self, image: TimedImage) -> None:
        """Compare an image with the first one."""
        if self.first is None or self.first is image:
            return
        shift = camera_shift(self.first.image, image.image)
        self.shift_px = max(self.shift_px, 0.0 if shift is None else shift.pixels)


def see_tips(
    markers: Sequence[Marker],
    camera: CameraFile,
    images: Sequence[Frames],
    clips: Sequence[Clip],
    tips: Sequence[FoundTip],
    progress: Progress,
    ruler_mm: float | None = None,
) -> SeenTips:
    """Pose of each tag at rest in the camera's frame, and the line about which it turns, for each tip.

    Args:
        markers: markers of the object; without one of known pose, and without the camera's pose or a mat,
            nothing is looked at.
        camera: lens of the camera.
        images: images of each source.
        clips: the sources.
        tips: the tips; those without an onset (first motion) have no views.
        progress: called with a text, the number of finished tips and of all.
        ruler_mm: length of the mat's ruler as measured on the print [mm]; None for the nominal one.

    Raises:
        TrackingError: the camera's pose is unknown, and the images show another object, or one of its markers
            twice.
    """
    lens = camera_from_spec(camera.calibration)
    unplaced = not camera.placed and all(marker.T_object_marker is None for marker in markers)
    if unplaced and not _shows_mat(lens, images, clips, tips):
        return SeenTips(((),) * len(tips), (), (None,) * len(tips))
    views: list[tuple[TagView, ...]] = []
    filmed: list[tuple[str, WatchedImages]] = []
    mats: list[SeenMat | None] = []
    for number, tip in enumerate(tips):
        progress("recognising the strikes", number, len(tips))
        if tip.onset is None:
            views.append(())
            whole = WatchedImages(images[tip.clip].frames(), MatWatch(lens, None, ruler_mm))
            if clips[tip.clip].last_ns is not None:
                deque(whole.frames(), maxlen=0)
                filmed.append((tip.name, whole))
            else:
                deque(islice(whole.frames(), SOURCE_IMAGES), maxlen=0)
            mats.append(whole.mat.seen(tip.name))
            continue
        frame_ns = clips[tip.clip].frame_ns
        start_ns, end_ns = window_around(tip.onset, frame_ns)
        until_ns = tip.onset.time_ns + max(MOTION_AFTER_ONSET_NS, round(MOTION_FRAMES * frame_ns))
        watch = MatWatch(lens, tip.onset.time_ns, ruler_mm)
        passing = WatchedImages(images[tip.clip].frames(start_ns, min(until_ns, end_ns)), watch)
        try:
            views.append(tag_views(passing.frames(), tip.onset.time_ns, lens, markers))
        except TrackingError:
            # The strike is refused by name when it is estimated; the others can be used.
            if not camera.placed:
                raise
            views.append(())
        filmed.append((tip.name, passing))
        mats.append(watch.seen(tip.name))
    by_mat = {each.name for each in mats if each is not None and each.pose is not None}
    filmed = [each for each in filmed if each[0] not in by_mat]
    return SeenTips(tuple(views), (*_moved_during(filmed), *_moved_between(filmed)), tuple(mats))


def _shows_mat(
    lens: CameraModel, images: Sequence[Frames], clips: Sequence[Clip], tips: Sequence[FoundTip]
) -> bool:
    """True if a mat is seen in the image with which the first tip's window begins."""
    for tip in tips[:1]:
        window = (None, None) if tip.onset is None else window_around(tip.onset, clips[tip.clip].frame_ns)
        for image in islice(images[tip.clip].frames(*window), 1):
            return read_mat(image.image, lens) is not None
    return False


def _moved_during(filmed: Sequence[tuple[str, WatchedImages]]) -> Iterator[str]:
    """Yield a remark for each tip during which the camera moved."""
    for name, passing in filmed:
        if passing.shift_px:
            yield (
                f"{name}: the camera moved by {passing.shift_px:.1f} px during the strike: put it on a stand "
                "that the strike does not shake, and film this strike again"
            )


def _moved_between(filmed: Sequence[tuple[str, WatchedImages]]) -> Iterator[str]:
    """Yield one remark on the tips before which the camera stood otherwise than before the first one."""
    if not filmed or (first := filmed[0][1].first) is None:
        return
    moved: list[tuple[float, str]] = []
    for name, passing in islice(filmed, 1, None):
        shift = None if passing.first is None else camera_shift(first.image, passing.first.image)
        if shift is not None:
            moved.append((shift.pixels, name))
    if moved:
        names = ", ".join(name for _, name in moved)
        yield (
            f"{names}: the camera stood otherwise than in {filmed[0][0]}, by up to {max(moved)[0]:.1f} px: "
            "one pose is used for all strikes, so that slip and positions are less certain: film all strikes "
            "without touching it, or import these by themselves and estimate the recordings together"
        )
