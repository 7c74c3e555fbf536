"""Tracker of a tossed object by its own print, in views that strikes showed at rest.

Features (SIFT; Lowe 2004) find the object in an image, a fit of grey values follows it from frame to frame.
Each view of the print that a frame shows is fitted by itself and counts as a tag: its square's corners go
into the fit of the flight, as those of tags do.
"""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.least_squares.robust import NORMAL_MAD
from analyze.tracking.camera_model import distort, project_ideal, project_jacobian
from analyze.tracking.pose import solve_pose
from analyze.tracking.print_features import detect_features, match_features, pose_by_matches
from analyze.tracking.print_template import IdealImages
from analyze.tracking.printed_view_fit import LEAST_SEEN, Motion, ViewFit
from analyze.tracking.turns import rotation_matrix, rotation_vector
from analyze.types import MarkerTrack

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from analyze.tracking.printed_view import PrintedView
    from analyze.tracking.printed_view_fit import ViewPose
    from analyze.types import Array, CameraModel, ImageFrame, Marker

CORNER_BIAS_PX, BIAS_PER_UNLIKE_PX = 0.06, 1.3
"""1 sigma of a corner's error beyond that by noise [px]: of a view that looks as at rest, and per lack of
likeness (1 - correlation): print seen aslant, blurred by its motion, or smeared at rest"""
MIN_LIKENESS = 0.62
"""correlation of a view's grey values with those at rest below which a fit does not count"""
MAX_CORNER_SD_PX = 0.5
"""1 sigma of a corner by noise above which a fit does not count [px]"""
MAX_TURN_RAD = np.radians(10.0)
"""turn of the object against the predicted one above which a fit in flight is a wrong one"""
MIN_SEARCH_LIKENESS = 0.8
"""correlation below which a pose by features does not count"""
MAX_VIEWS = 3
"""largest number of views that are fitted in one frame"""
CORNER_STEPS = 3
"""Gauss-Newton steps of a frame's pose by the corners of several views"""
NEAR_FRAMES = 4
"""number of frames before or after a frame from which its pose is predicted"""
PREDICTED_S = 0.035
"""time after which a pose no longer predicts the next [s]"""
COMPARED_EVERY_PX, CHANGE_GREY, CHANGE_SIGMAS, CHANGED_SHARE = 4, 8.0, 6.0, 5e-4
"""distance of the pixels that are compared [px]; change of one above which it counts [grey], and over the
robust scale of all; share of pixels that change above which something moves"""
SEARCH_EVERY = 3
"""number of frames without the object from one search to the next: frames between are followed backwards"""
MAX_SEARCHED_VIEWS = 3
"""largest number of views by whose features the object is searched"""


@dataclass(frozen=True)
class _Sighting:
    """Pose of the object in the camera frame at one frame, and the views by which it was found."""

    time_ns: int
    R: Array
    p: Array
    views: tuple[tuple[int, ViewPose], ...]
    corrected: bool = False
    """True if the frames before were followed by a mirrored pose"""

    @property
    def likeness(self) -> float:
        """Likeness of the view that looks most like the image."""
        return max(pose.likeness for _, pose in self.views)


class PrintFlight:
    """Tracker of a tossed object by views of its print.

    Args:
        camera: camera that takes the images.
        views: views of the print.
    """

    def __init__(self, camera: CameraModel, views: Sequence[PrintedView]) -> None:
        """Prepare the fits."""
        self._camera, self._images = camera, IdealImages(camera)
        self._fits = [ViewFit(view, camera) for view in views]

    @property
    def markers(self) -> list[Marker]:
        """Squares that stand for the views, as markers with their places in O."""
        return [fit.view.marker for fit in self._fits]

    def tracks(self, images: Iterable[ImageFrame]) -> list[MarkerTrack]:
        """Tracks of the views' squares through the frames of a toss, as those of tags.

        Frames are followed forwards, with a search where the object is lost, then backwards. Frames in which
        nothing moves are left out.
        """
        frames = _frames_in_motion(images)
        seen: dict[int, _Sighting] = {}
        missed = 0
        for number, frame in enumerate(frames):
            found = self._follow(frame, _nearest(seen, number, -1))
            if found is None and missed % SEARCH_EVERY == 0:
                found = self._search(frame)
            missed = missed + 1 if found is None else 0
            if found is not None:
                _add(seen, number, found, -1)
        for number in range(len(frames) - 1, -1, -1):
            if number not in seen:
                found = self._follow(frames[number], _nearest(seen, number, 1))
                if found is not None:
                    _add(seen, number, found, 1)
        if self._camera.line_time_s:
            seen = self._without_skew(frames, seen)
        return self._tracks([seen[number] for number in sorted(seen)], len(frames))

    def _without_skew(self, frames: Sequence[ImageFrame], seen: dict[int, _Sighting]) -> dict[int, _Sighting]:
        """Sightings fitted again with the motion by their neighbours, for a rolling shutter's skew."""
        fitted: dict[int, _Sighting] = {}
        for number, each in seen.items():
            around = [seen[n] for n in (number - 1, number + 1) if n in seen]
            if around and (motion := _motion(around[0], around[-1] if len(around) > 1 else each)) is not None:
                again = self._fit_frame(frames[number], (each.R, each.p), motion)
                if again is not None:
                    fitted[number] = again
        return fitted

    def _tracks(self, seen: Sequence[_Sighting], total: int) -> list[MarkerTrack]:
        """Tracks by the views in all frames."""
        by_view: dict[int, list[tuple[_Sighting, ViewPose]]] = {}
        for each in seen:
            for number, pose in each.views:
                by_view.setdefault(number, []).append((each, pose))
        tracks: list[MarkerTrack] = []
        for number, found in sorted(by_view.items()):
            view = self._fits[number].view
            place = view.T_object_view
            tracks.append(
                MarkerTrack(
                    view.name,
                    np.array([each.time_ns for each, _ in found], dtype=np.int64),
                    distort(self._camera, np.array([pose.corners for _, pose in found])),
                    np.array([_corner_sd(pose) for _, pose in found]),
                    np.array([each.R @ place[:3, :3] for each, _ in found]),
                    np.array([each.R @ place[:3, 3] + each.p for each, _ in found]),
                    total,
                )
            )
        return tracks

    def _follow(self, frame: ImageFrame, near: Sequence[_Sighting]) -> _Sighting | None:
        """Object in a frame, predicted by the nearest frames where it was found; None if it is not there.

        Args:
            frame: the frame.
            near: the object in frames before or after it, the nearest first.
        """
        if not near or abs(frame.time_ns - near[0].time_ns) > 1e9 * PREDICTED_S:
            return None
        last, motion = near[0], _motion(*near[1::-1])
        if motion is None:
            return self._fit_frame(frame, (last.R, last.p))
        ahead = 1e-9 * (frame.time_ns - last.time_ns)
        predicted = rotation_matrix(ahead * motion.spin) @ last.R
        found = self._fit_frame(frame, (predicted, last.p + ahead * motion.velocity), motion)
        if found is None:
            return None
        if len(found.views) == 1:
            # A flat view's mirrored pose may have been followed; then the right one shows more views.
            ((number, pose),) = found.views
            mirrored = self._mirrored_pose(self._fits[number], pose)
            other = None if mirrored is None else self._fit_frame(frame, mirrored)
            if other is not None and len(other.views) > 1:
                return replace(other, corrected=True)
        turned = float(np.linalg.norm(rotation_vector(found.R @ predicted.T)))
        return found if turned < MAX_TURN_RAD else None

    def _fit_frame(
        self, frame: ImageFrame, pose: tuple[Array, Array], motion: Motion | None = None
    ) -> _Sighting | None:
        """Object in a frame near a pose; None if no view fits there."""
        counted = [(int(fit.visible(*pose).sum()), number) for number, fit in enumerate(self._fits)]
        found: list[tuple[int, ViewPose]] = []
        for count, number in sorted(counted, reverse=True)[:MAX_VIEWS]:
            if count < LEAST_SEEN:
                break
            fit = self._fits[number]
            fitted = fit.fit(self._images, frame.image, pose, motion)
            if fitted is not None and _is_usable(fitted) and self._near_image(fitted):
                if not found:
                    pose = fitted.R, fitted.p
                found.append((number, fitted))
        if not found:
            return None
        best = max(found, key=lambda each: each[1].seen * each[1].likeness)[1]
        return _Sighting(frame.time_ns, *self._by_corners(found, best), tuple(found))

    def _near_image(self, pose: ViewPose) -> bool:
        """True if the square's corners are not so far outside the image that the lens is not known there."""
        size = np.array([self._camera.width, self._camera.height])
        return bool(np.all((pose.corners > -0.25 * size) & (pose.corners < 1.25 * size)))

    def _by_corners(self, found: Sequence[tuple[int, ViewPose]], best: ViewPose) -> tuple[Array, Array]:
        """Pose of the object by the corners of all views together, from that by the best one."""
        if len(found) < 2:
            return best.R, best.p
        points = np.concatenate([self._fits[number].corners for number, _ in found])
        pixels = np.concatenate([pose.corners for _, pose in found])
        weight = np.repeat([1.0 / _corner_sd(pose) for _, pose in found], 8)
        turn, place = best.R, best.p
        for _ in range(CORNER_STEPS):
            arms = points @ turn.T
            into = project_jacobian(self._camera, arms + place)
            by = np.concatenate([np.cross(arms[:, None, :], into), into], axis=2).reshape(-1, 6)
            off = (pixels - project_ideal(self._camera, arms + place)).ravel()
            if not np.all(np.isfinite(by)) or not np.all(np.isfinite(off)):
                return best.R, best.p
            step = np.asarray(np.linalg.lstsq(by * weight[:, None], off * weight, rcond=None)[0], dtype=float)
            turn, place = rotation_matrix(step[:3]) @ turn, place + step[3:]
        return turn, place

    def _search(self, frame: ImageFrame) -> _Sighting | None:
        """Object in a frame, by its features; None if no view has enough."""
        pixels, descriptors = detect_features(self._images.ideal(frame.image).astype(np.uint8))
        found = [match_features(fit.view.descriptors, descriptors) for fit in self._fits]
        for number in sorted(range(len(found)), key=lambda number: -len(found[number][0]))[
            :MAX_SEARCHED_VIEWS
        ]:
            fit, (known, shown) = self._fits[number], found[number]
            pose = pose_by_matches(fit.view.features[known], pixels[shown], self._camera.K)
            fitted = None if pose is None else fit.fit(self._images, frame.image, pose)
            if fitted is None or not _is_usable(fitted):
                continue
            poses = [(fitted.R, fitted.p), self._mirrored_pose(fit, fitted)]
            sightings = [self._fit_frame(frame, pose) for pose in poses if pose is not None]
            best = max((each for each in sightings if each is not None), key=_support, default=None)
            if best is not None and best.likeness > MIN_SEARCH_LIKENESS:
                return best
        return None

    def _mirrored_pose(self, fit: ViewFit, pose: ViewPose) -> tuple[Array, Array] | None:
        """Other pose in which a view's square looks the same, as flat print then hardly differs."""
        place = fit.view.T_object_view
        pair = solve_pose(pose.corners, fit.view.size, self._camera.K)
        if pair is None:
            return None
        turns = [turn @ place[:3, :3].T for turn in pair.R_camera_marker]
        apart = [float(np.trace(turn @ pose.R.T)) for turn in turns]
        other = int(np.argmin(apart))
        return turns[other], pair.p_camera_marker[other] - turns[other] @ place[:3, 3]


def _nearest(seen: dict[int, _Sighting], number: int, step: int) -> list[_Sighting]:
    """Sightings in the frames before (step -1) or after (1) a frame, the nearest first."""
    return [seen[n] for n in range(number + step, number + step * (NEAR_FRAMES + 1), step) if n in seen]


def _add(seen: dict[int, _Sighting], number: int, found: _Sighting, step: int) -> None:
    """Add a sighting; if it shows that a mirrored pose was followed, drop the sightings by that one view."""
    seen[number] = found
    if found.corrected:
        wrong = number + step
        while wrong in seen and len(seen[wrong].views) == 1:
            del seen[wrong]
            wrong += step


def _motion(*sightings: _Sighting) -> Motion | None:
    """Velocity from one sighting to another; None for a single one, or two of one time."""
    if len(sightings) < 2 or sightings[0].time_ns == sightings[1].time_ns:
        return None
    before, last = sightings
    seconds = 1e-9 * (last.time_ns - before.time_ns)
    return Motion(rotation_vector(last.R @ before.R.T) / seconds, (last.p - before.p) / seconds)


def _frames_in_motion(images: Iterable[ImageFrame]) -> list[ImageFrame]:
    """Frames that differ from the one before or the next."""
    kept: list[ImageFrame] = []
    last, was = None, False
    for frame in images:
        if last is not None:
            moved = _differ(last.image, frame.image)
            if moved or was:
                kept.append(last)
            was = moved
        last = frame
    if last is not None and was:
        kept.append(last)
    return kept


def _differ(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    """True if two images differ by more than noise."""
    every = slice(None, None, COMPARED_EVERY_PX)
    apart = cv2.absdiff(one[every, every], other[every, every])
    limit = max(CHANGE_GREY, CHANGE_SIGMAS * NORMAL_MAD * float(np.median(apart)))
    return int(np.count_nonzero(apart > limit)) > CHANGED_SHARE * apart.size


def _support(seen: _Sighting) -> float:
    """Sum of the likeness of all views that fit."""
    return sum(pose.likeness for _, pose in seen.views)


def _is_usable(pose: ViewPose) -> bool:
    """True if a view looks like the image, and determines its corners."""
    return pose.likeness > MIN_LIKENESS and pose.corner_sd < MAX_CORNER_SD_PX


def _corner_sd(pose: ViewPose) -> float:
    """1 sigma of a corner's coordinate [px]."""
    unlike = BIAS_PER_UNLIKE_PX * (1.0 - pose.likeness)
    return float(np.sqrt(pose.corner_sd**2 + CORNER_BIAS_PX**2 + unlike**2))
