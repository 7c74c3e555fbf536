"""Finds onsets of strikes in a clip (source of images): a resting marker that begins to tip.

A marker at rest is searched for once; from then on each image's region around it is compared with its
appearance at rest, which takes little time. When the region changes, the marker is searched for again
until it is found at rest (a finger passed in front of it), at rest a little aside (it was pushed), turned
about a point no farther away than an edge of the object (a strike), or gone (the object was taken away).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.tracking.marker import detect, families_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from analyze.sources.source import TimedImage
    from analyze.types import Array

SLOW_MOTION_INTERVAL_NS = 1e9 / 61
"""interval between images [ns] above which a clip may be slow motion, which plays at most 60 a second"""
SLOW_MOTION_CAPTURE_NS = 1e9 / 240
"""longest capture interval of slow motion [ns]; for such clips the times below are multiplied by the interval
between images over this one"""
SEARCH_INTERVAL_NS, WATCH_INTERVAL_NS = 50_000_000, 20_000_000
"""interval between two searches for a marker, and for a marker that has begun to move [ns]"""
SEARCHES_AT_REST = 3
"""consecutive searches that must find a marker in one place for it to be at rest"""
MAX_REST_SHIFT = 0.03
"""largest shift of a resting marker's corners, relative to its side"""
MIN_CHANGE = 0.05
"""1 - correlation of a region with itself at rest above which it has changed; brightness has no effect"""
TIPPING_ANGLE = math.radians(5.0)
"""rotation in the image above which a marker tips [rad]"""
CUT_ANGLE = math.radians(45.0)
"""rotation between two images above which the recording was interrupted or cut [rad]"""
MOVED_FRACTION = 0.3
"""shift, relative to the marker's side, above which it has moved"""
MAX_PIVOT_DISTANCE = 6.0
"""largest distance from a marker to its pivot, in sides of the marker; beyond it the object is carried"""
MARKER_LOST_NS = 1_500_000_000
"""time after which a marker that is not seen at rest is given up [ns]"""
MAX_UNSEEN_NS = 100_000_000
"""longest time without an image before a strike [ns]; after a longer one the object may lie elsewhere"""
PAUSE_AFTER_STRIKE_NS = 1_000_000_000
"""time after a strike, while the object falls, without a search [ns]"""
SEARCH_IMAGE_PX = 900
"""largest side of the images that markers are searched in [px]; larger images are thinned"""
REGION_PX = 40
"""least number of pixels along the longer side of a large region that is thinned to be compared [px]"""


@dataclass(frozen=True)
class Onset:
    """Onset of a strike in a clip: the moment at which a marker at rest begins to tip with the object.

    It lies between two times [ns] on the source's clock: the marker last seen at rest, and first seen moved.
    """

    rest_ns: int
    """time on the source's clock from which a marker was seen at rest [ns]"""
    time_ns: int
    """last time on the source's clock at which the marker was seen at rest [ns]"""
    moved_ns: int
    """time on the source's clock of the first image in which the marker had moved [ns]"""
    markers: tuple[int | str, ...]
    """names of the markers that were seen at rest"""


@dataclass
class _Rest:
    """Markers at rest in a clip, and the appearance of the image region around the largest of them."""

    since_ns: int
    """time from which they were seen at rest [ns]"""
    quiet_ns: int
    """last time at which they were seen at rest [ns]"""
    corners: dict[int | str, Array]
    """corners (4, 2) of each marker [px], by its name"""
    region: tuple[slice, slice]
    """rows and columns of the image that are compared"""
    appearance: Array
    """(n,) grey values of the region, normalised to mean 0 and norm 1"""


class OnsetFinder:
    """Finder of strike onsets in a clip (source of images).

    Call `add` with all images of the clip in the order of their times.

    Args:
        markers: names of the object's markers.
        frame_ns: interval between two images [ns]; 0 if unknown. Above `SLOW_MOTION_INTERVAL_NS` the clip may
            be undeclared slow motion: all waits are then longer, so that slow movement is not mistaken for
            rest.
        directions: directions in which strikes turn a marker in the image, True for clockwise. A marker that
            turns the other way shows that the object is set up again.
    """

    def __init__(
        self,
        markers: Iterable[int | str],
        frame_ns: float = 0.0,
        directions: frozenset[bool] = frozenset((True, False)),
    ) -> None:
        self._directions = directions
        self._time_scale = frame_ns / SLOW_MOTION_CAPTURE_NS if frame_ns > SLOW_MOTION_INTERVAL_NS else 1.0
        self._known = frozenset(markers)
        self._families = families_of(self._known)
        self._seen: list[tuple[int, dict[int | str, Array]]] = []
        self._rest: _Rest | None = None
        self._moving = False
        self._moved_ns = 0
        self._next_ns = 0
        self.ever_seen = False
        """True if any of the markers was seen"""
        self.ever_rested = False
        """True if any of the markers was at rest"""
        self.turned_back = False
        """True if a marker at rest turned the other way than in strikes"""

    def add(self, frame: TimedImage) -> Onset | None:
        """Examine the clip's next image.

        Returns:
            Onset of a strike that this image shows to have begun; None otherwise.
        """
        if self._rest is None:
            if frame.time_ns >= self._next_ns:
                self._next_ns = frame.time_ns + self._wait(SEARCH_INTERVAL_NS)
                self._try_settle(frame, self._find(frame.image))
            return None
        if not self._moving:
            if 1.0 - _appearance(frame.image, self._rest.region) @ self._rest.appearance < MIN_CHANGE:
                self._rest.quiet_ns = frame.time_ns
                return None
            self._moving, self._moved_ns, self._next_ns = True, frame.time_ns, frame.time_ns
        return self._watch(frame, self._rest) if frame.time_ns >= self._next_ns else None

    def _try_settle(self, frame: TimedImage, found: dict[int | str, Array]) -> None:
        """Take markers as resting once `SEARCHES_AT_REST` consecutive searches found them in one place.

        Args:
            frame: image that was searched last.
            found: corners (4, 2) of the markers found in it [px], by name.
        """
        self._seen = [*self._seen[1 - SEARCHES_AT_REST :], (frame.time_ns, found)]
        if len(self._seen) < SEARCHES_AT_REST:
            return
        latest = self._seen[-1][1]
        still = {
            name
            for name in latest
            if all(
                name in seen and _shift(seen[name], latest[name]) < MAX_REST_SHIFT for _, seen in self._seen
            )
        }
        if not still:
            return
        corners = {name: latest[name] for name in still}
        region = _marker_region(corners, frame.image.shape)
        self._rest = _Rest(self._seen[0][0], frame.time_ns, corners, region, _appearance(frame.image, region))
        self._moving, self._seen, self.ever_rested = False, [], True

    def _watch(self, frame: TimedImage, rest: _Rest) -> Onset | None:
        """Search an image for the markers that rested, after the image region around them has changed.

        Args:
            frame: the image.
            rest: the markers as they rested; updated if they rest still.

        Returns:
            Onset of the strike if a marker has tipped as in a strike: begin and end of its rest and first
            image in which it had moved [ns, source's clock], and names of the markers. None otherwise.
        """
        self._next_ns = frame.time_ns + self._wait(WATCH_INTERVAL_NS)
        found = self._find(frame.image)
        for name in rest.corners.keys() & found.keys():
            turn, shift, pivot_distance = _motion(rest.corners[name], found[name])
            if abs(turn) > TIPPING_ANGLE:
                is_tip = pivot_distance < MAX_PIVOT_DISTANCE and not (
                    self._moved_ns - rest.quiet_ns > self._wait(MAX_UNSEEN_NS)
                    or (abs(turn) > CUT_ANGLE and frame.time_ns == self._moved_ns)
                )
                is_strike = is_tip and (turn > 0) in self._directions
                self.turned_back = self.turned_back or (is_tip and not is_strike)
                self._forget(frame.time_ns + (self._wait(PAUSE_AFTER_STRIKE_NS) if is_strike else 0))
                markers = tuple(sorted(rest.corners, key=str))
                return Onset(rest.since_ns, rest.quiet_ns, self._moved_ns, markers) if is_strike else None
            if shift < MAX_REST_SHIFT:
                rest.quiet_ns, rest.appearance = frame.time_ns, _appearance(frame.image, rest.region)
                self._moving, self._seen = False, []
                return None
            if shift > MOVED_FRACTION and pivot_distance > MAX_PIVOT_DISTANCE:
                self._forget(frame.time_ns)
                return None
        if frame.time_ns - rest.quiet_ns > self._wait(MARKER_LOST_NS):
            self._forget(frame.time_ns)
        elif not self._seen or frame.time_ns - self._seen[-1][0] >= self._wait(SEARCH_INTERVAL_NS):
            # A marker that was pushed a little may come to rest again: the strike then begins from there.
            self._try_settle(frame, found)
        return None

    def _wait(self, usual_ns: int) -> int:
        """Interval or time limit of the search for strikes [ns], on the clip's clock.

        It is `usual_ns`, or a multiple of that if the clip may be in slow motion.

        Args:
            usual_ns: the interval or limit at normal speed [ns].
        """
        return round(usual_ns * self._time_scale)

    def _forget(self, next_ns: int) -> None:
        """Drop the resting markers; from the time `next_ns` [ns] on, markers are searched for again."""
        self._rest, self._moving, self._seen, self._next_ns = None, False, [], next_ns

    def _find(self, image: NDArray[np.uint8]) -> dict[int | str, Array]:
        """Detect the object's markers in an image; return their corners (4, 2) [px] by marker name.

        Empty if none is seen.
        """
        coarser = max(1, math.ceil(max(image.shape) / SEARCH_IMAGE_PX))
        seen = detect(image[::coarser, ::coarser], self._families)
        found = {
            sighting.marker_id: sighting.corners_px * coarser
            for sighting in seen
            if sighting.marker_id in self._known
        }
        self.ever_seen = self.ever_seen or bool(found)
        return found


def _side(corners: Array) -> float:
    """Mean length of a marker's four sides in an image [px], from its corners (4, 2) [px]."""
    return float(np.mean(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)))


def _shift(before: Array, now: Array) -> float:
    """Largest shift of a marker's corners between two images, as a multiple of the marker's side.

    Args:
        before: corners (4, 2) in the first image [px], whose side counts.
        now: corners (4, 2) in the second image [px].
    """
    return float(np.max(np.linalg.norm(now - before, axis=1))) / _side(before)


def _motion(before: Array, now: Array) -> tuple[float, float, float]:
    """Rotation, shift and turning point of a marker between two images.

    Args:
        before: corners (4, 2) of the marker in the first image [px].
        now: corners (4, 2) of the marker in the second image [px].

    Returns:
        Rotation in the image, positive clockwise [rad]; largest shift of a corner; distance from the
        marker's middle to the point about which it turned. Both lengths are multiples of the marker's side.
    """
    middle_before, middle = before.mean(axis=0), now.mean(axis=0)
    a, b = before - middle_before, now - middle
    turn = math.atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b)))
    way = float(np.linalg.norm(middle - middle_before)) / _side(before)
    return turn, _shift(before, now), way / max(2 * abs(math.sin(turn / 2)), 1e-9)


def _marker_region(corners: dict[int | str, Array], shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Image region around the largest marker: rows and columns, as slices.

    In a large region the slices have a step, so that 40 to 79 rows or columns of its longer side remain.

    Args:
        corners: corners (4, 2) of each marker [px], by its name.
        shape: height and width of the image [px].
    """
    largest = max(corners.values(), key=_side)
    margin = 0.2 * _side(largest)
    low = np.maximum(np.floor(largest.min(axis=0) - margin), 0).astype(int)
    high = np.minimum(np.ceil(largest.max(axis=0) + margin), [shape[1], shape[0]]).astype(int)
    step = max(1, int(max(high - low)) // REGION_PX)
    return slice(int(low[1]), int(high[1]), step), slice(int(low[0]), int(high[0]), step)


def _appearance(image: NDArray[np.uint8], place: tuple[slice, slice]) -> Array:
    """Grey values (n,) of an image region, shifted to mean 0 and scaled to norm 1 (0 if uniform).

    Args:
        image: (height, width) grey values.
        place: rows and columns of the region.
    """
    values = image[place].astype(np.float64).ravel()
    values -= values.mean()
    return values / max(float(np.linalg.norm(values)), 1e-9)
