"""Where in a film an object that stood still is struck: its marker rests, then turns about a point near it.

A marker that rests is looked for once; from then on every image is compared with it where it lies, which costs next to nothing. When
that place changes, the marker is looked for again until it is seen to lie still (a finger passed in front of it), to lie still a little
aside (it was pushed, and rests anew), to have turned about a point as near as an object's edge (a strike), or to be gone (the object
was taken away).
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

_STATED_NS = 1e9 / 61
"""between two images of a film that may be slow motion: as such it states 60 a second or fewer"""
_CAPTURED_NS = 1e9 / 240
"""of which it then is, at least; by as much longer are the waits below"""
_SEARCH_NS = 50_000_000
_WATCH_NS = 20_000_000
"""between two searches for a marker, and for one that has begun to move"""
_STILL_LOOKS = 3
"""searches in a row that find a marker in one place: it rests"""
_STILL = 0.03
"""of its side, by which a resting marker's corners may seem to move"""
_CHANGED = 0.05
"""1 - correlation of a place with itself at rest, from which on something happens there; brightness does not enter"""
_TURNED = math.radians(5.0)
"""from which on it tips"""
_LEAPT = math.radians(45.0)
"""by which nothing turns between two images: the film was stopped, or put together of several"""
_SHIFTED = 0.3
"""of its side, from which on it no longer lies where it lay"""
_REACH = 6.0
"""sides between a marker and the point about which it turns, at most: beyond it the object is carried"""
_GONE_NS = 1_500_000_000
"""after which a marker that is not seen is not waited for"""
_UNSEEN_NS = 100_000_000
"""without an image, in which whatever began is no strike that anybody saw begin: the object was put down anew between two previews"""
_AFTER_NS = 1_000_000_000
"""after a strike nothing else is looked for: the object falls"""
_SMALL_PX = 900
"""longer side of the images in which markers are looked for"""
_CROP_PX = 40
"""side of the place that is compared"""


@dataclass(frozen=True)
class Onset:
    """A strike as the film shows it."""

    rest_ns: int
    """since when the marker was seen at rest, on the source's clock"""
    time_ns: int
    """last moment at which it was seen at rest"""
    moved_ns: int
    """first moment at which it was not"""
    markers: tuple[int | str, ...]
    """that were seen at rest"""


@dataclass
class _Rest:
    """Markers that lie still, and what their places look like."""

    since_ns: int
    quiet_ns: int
    corners: dict[int | str, Array]
    place: tuple[slice, slice]
    look: Array


class OnsetFinder:
    """Feed the images of a film in the order of their times.

    Args:
        markers: names of those that the object carries.
        frame_ns: between two images. Where it is long the film may be slow motion that nobody has spoken of: all waits are longer then,
            so that what moves slowly is not taken for what rests.
        ways: in which strikes turn a marker in the image: clockwise, or not; an object that is set up again turns the other way.
    """

    def __init__(self, markers: Iterable[int | str], frame_ns: float = 0.0, ways: frozenset[bool] = frozenset((True, False))) -> None:
        self._ways = ways
        self._slower = frame_ns / _CAPTURED_NS if frame_ns > _STATED_NS else 1.0
        self._known = frozenset(markers)
        self._families = families_of(self._known)
        self._seen: list[tuple[int, dict[int | str, Array]]] = []
        self._rest: _Rest | None = None
        self._moving = False
        self._moved_ns = 0
        self._next_ns = 0
        self.ever_seen = False
        """any of the markers, at any time"""
        self.ever_rested = False
        """any of the markers lay still, at any time"""

    def add(self, frame: TimedImage) -> Onset | None:
        """The strike that has just begun; None where none has."""
        if self._rest is None:
            if frame.time_ns >= self._next_ns:
                self._search(frame)
            return None
        if not self._moving:
            if _unlike(_look(frame.image, self._rest.place), self._rest.look) < _CHANGED:
                self._rest.quiet_ns = frame.time_ns
                return None
            self._moving, self._moved_ns, self._next_ns = True, frame.time_ns, frame.time_ns
        return self._watch(frame, self._rest) if frame.time_ns >= self._next_ns else None

    def _search(self, frame: TimedImage) -> None:
        self._next_ns = frame.time_ns + self._wait(_SEARCH_NS)
        self._settles(frame, self._find(frame.image))

    def _settles(self, frame: TimedImage, found: dict[int | str, Array]) -> None:
        """Take what was found for a rest, once some searches in a row have it in one place."""
        self._seen = [*self._seen[1 - _STILL_LOOKS :], (frame.time_ns, found)]
        if len(self._seen) < _STILL_LOOKS:
            return
        latest = self._seen[-1][1]
        still = {name for name in latest if all(name in seen and _shift(seen[name], latest[name]) < _STILL for _, seen in self._seen)}
        if not still:
            return
        corners = {name: latest[name] for name in still}
        place = _place(corners, frame.image.shape)
        self._rest = _Rest(self._seen[0][0], frame.time_ns, corners, place, _look(frame.image, place))
        self._moving, self._seen, self.ever_rested = False, [], True

    def _watch(self, frame: TimedImage, rest: _Rest) -> Onset | None:
        self._next_ns = frame.time_ns + self._wait(_WATCH_NS)
        found = self._find(frame.image)
        for name in rest.corners.keys() & found.keys():
            turn, shift, reach = _motion(rest.corners[name], found[name])
            if abs(turn) > _TURNED and (
                self._moved_ns - rest.quiet_ns > self._wait(_UNSEEN_NS)
                or (abs(turn) > _LEAPT and frame.time_ns == self._moved_ns)
                or (turn > 0) not in self._ways
            ):
                self._forget(frame.time_ns)
                return None
            if abs(turn) > _TURNED:
                self._forget(frame.time_ns + (self._wait(_AFTER_NS) if reach < _REACH else 0))
                return Onset(rest.since_ns, rest.quiet_ns, self._moved_ns, tuple(sorted(rest.corners, key=str))) if reach < _REACH else None
            if shift < _STILL:
                rest.quiet_ns, rest.look, self._moving, self._seen = frame.time_ns, _look(frame.image, rest.place), False, []
                return None
            if shift > _SHIFTED and reach > _REACH:
                self._forget(frame.time_ns)
                return None
        if frame.time_ns - rest.quiet_ns > self._wait(_GONE_NS):
            self._forget(frame.time_ns)
        elif not self._seen or frame.time_ns - self._seen[-1][0] >= self._wait(_SEARCH_NS):
            # Pushed a little, it rests anew: the strike begins from there.
            self._settles(frame, found)
        return None

    def _wait(self, usual_ns: int) -> int:
        return round(usual_ns * self._slower)

    def _forget(self, next_ns: int) -> None:
        self._rest, self._moving, self._seen, self._next_ns = None, False, [], next_ns

    def _find(self, image: NDArray[np.uint8]) -> dict[int | str, Array]:
        coarser = max(1, math.ceil(max(image.shape) / _SMALL_PX))
        seen = detect(image[::coarser, ::coarser], self._families)
        found = {sighting.marker_id: sighting.corners_px * coarser for sighting in seen if sighting.marker_id in self._known}
        self.ever_seen = self.ever_seen or bool(found)
        return found


def _side(corners: Array) -> float:
    return float(np.mean(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)))


def _shift(before: Array, now: Array) -> float:
    """Largest move of a corner, in sides."""
    return float(np.max(np.linalg.norm(now - before, axis=1))) / _side(before)


def _motion(before: Array, now: Array) -> tuple[float, float, float]:
    """Turn in the image [rad], largest move of a corner, and distance to the point about which it turned, both in sides."""
    middle_before, middle = before.mean(axis=0), now.mean(axis=0)
    a, b = before - middle_before, now - middle
    turn = math.atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b)))
    way = float(np.linalg.norm(middle - middle_before)) / _side(before)
    return turn, _shift(before, now), way / max(2 * abs(math.sin(turn / 2)), 1e-9)


def _place(corners: dict[int | str, Array], shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Rows and columns around the largest marker, thinned to a few pixels."""
    largest = max(corners.values(), key=_side)
    margin = 0.2 * _side(largest)
    low = np.maximum(np.floor(largest.min(axis=0) - margin), 0).astype(int)
    high = np.minimum(np.ceil(largest.max(axis=0) + margin), [shape[1], shape[0]]).astype(int)
    step = max(1, int(max(high - low)) // _CROP_PX)
    return slice(int(low[1]), int(high[1]), step), slice(int(low[0]), int(high[0]), step)


def _look(image: NDArray[np.uint8], place: tuple[slice, slice]) -> Array:
    """What is there, without its brightness and contrast."""
    values = image[place].astype(np.float64).ravel()
    values -= values.mean()
    return values / max(float(np.linalg.norm(values)), 1e-9)


def _unlike(one: Array, other: Array) -> float:
    return 1.0 - float(one @ other)
