"""Corners as they were at one time, from images whose rows were read one after the other.

A rolling shutter reads row y of an image `line_time` (y - middle) later than its middle row, so that each corner of a moving marker is
seen at a time of its own: at 30 us a line one at the top of an 80 px tag 2.4 ms before one at the bottom, in which it moves by pixels.
All corners of a frame are brought to one time, that of the row at the middle of the markers in view: there the least has to be moved.
How a corner moved is told by itself in the frames around: a cubic through four of them, each at its own time.

A blow turns the course of a corner sharply, and a cubic across it is wrong. Of the four-frame stretches that hold a frame that one is
taken whose cubic term is smallest, those with the frame in their middle being preferred (as essentially non-oscillatory schemes choose
theirs: Harten, Engquist, Osher and Chakravarthy 1987; the preference: Shu 1990).

While a marker turns, its edges are seen bowed: what is fitted to them are straight lines, which meet off its corners by two thirds of the
bow. The bow follows from how the two corners of an edge moved, and is taken off.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.tracking.edges import END_MARGIN_PX

if TYPE_CHECKING:
    from analyze.types import Array, IntArray

STRETCH = 4
"""frames that a cubic goes through"""
_PREFERRED = ((-1, 1.0), (-2, 1.0), (0, 2.0), (-3, 2.0))
"""where a stretch may begin, from its frame, and what its cubic term counts"""
_NOISE = 3.0
"""corner sds; a cubic term below that is none"""
_NEXT = np.array([1, 2, 3, 0])
_TIMES = 2
"""the bow tells where the corners were, and they its size"""


def at_one_time(frame_s: Array, ideal: Array, late_s: Array, common_s: Array, sd: float) -> Array:
    """Corners (n, 4, 2) where they were at `frame_s` + `common_s`, in ideal px.

    Args:
        frame_s: (n,) s, rising: times of the frames' middle rows.
        ideal: (n, 4, 2) ideal px, corners as fitted to the images.
        late_s: (n, 4) s, how much later than its frame's time the row of each corner was read.
        common_s: (n,) s, the same for the time that is wanted.
        sd: px, of a corner in one frame.
    """
    if len(frame_s) < 2:
        return ideal.copy()
    seen_s = frame_s[:, None] + late_s
    middle_s = 0.5 * (seen_s + seen_s[:, _NEXT])
    corners = ideal
    for _ in range(_TIMES):
        course = _Courses(seen_s, corners, sd)
        along = course.at(middle_s), course.at(0.5 * (seen_s + seen_s[:, [3, 0, 1, 2]]))[:, _NEXT]
        bow = 0.5 * (along[0] + along[1]) - 0.5 * (corners + corners[:, _NEXT])
        corners = ideal - _off_corners(corners, bow)
    return _Courses(seen_s, corners, sd).at(np.broadcast_to((frame_s + common_s)[:, None], seen_s.shape))


class _Courses:
    """How each corner moves around each of its frames: Newton's cubics through the frames of a stretch."""

    def __init__(self, seen_s: Array, corners: Array, sd: float) -> None:
        n = len(seen_s)
        width = min(STRETCH, n)
        every = np.arange(n - width + 1)[:, None] + np.arange(width)
        start = _starts(_divided(seen_s[every], corners[every])[:, -1], seen_s, n, sd)
        index = start[:, None] + np.arange(width)
        self._nodes = seen_s[index]
        self._terms = _divided(self._nodes, corners[index])

    def at(self, time_s: Array) -> Array:
        """(n, 4, 2) px at `time_s` (n, 4)."""
        place = self._terms[:, -1].copy()
        for i in range(self._terms.shape[1] - 2, -1, -1):
            place = self._terms[:, i] + (time_s - self._nodes[:, i])[..., None] * place
        return place


def _divided(nodes: Array, values: Array) -> Array:
    """Divided differences (m, w, 4, 2) of values (m, w, 4, 2) at nodes (m, w, 4)."""
    terms = values.copy()
    width = nodes.shape[1]
    for order in range(1, width):
        apart = (nodes[:, order:] - nodes[:, :-order])[..., None]
        terms[:, order:] = (terms[:, order:] - terms[:, order - 1 : -1]) / apart
    return terms


def _starts(cubic: Array, seen_s: Array, n: int, sd: float) -> IntArray:
    """First frame (n,) of the stretch that is taken for each frame; cubic (m, 4, 2) is the highest term of each stretch, px/s^3."""
    last = len(cubic) - 1
    if last == 0:
        return np.zeros(n, dtype=np.int64)
    step = float(np.median(np.diff(seen_s[:, 0])))
    size = np.maximum(np.abs(cubic).max(axis=(1, 2)) * step ** (STRETCH - 1), _NOISE * sd)
    starts = np.arange(n)[:, None] + np.array([first for first, _ in _PREFERRED])
    inside = (starts >= 0) & (starts <= last)
    cost = np.where(inside, size[np.clip(starts, 0, last)] * np.array([weight for _, weight in _PREFERRED]), np.inf)
    return starts[np.arange(n), np.argmin(cost, axis=1)]


def _off_corners(corners: Array, bow: Array) -> Array:
    """How far (n, 4, 2) px the straight lines fitted to bowed edges meet off the corners.

    Args:
        corners: (n, 4, 2) px.
        bow: (n, 4, 2) px, of the middle of the edge that begins at each corner. Along an edge, t from -1 to 1, it is (1 - t^2) of that.
    """
    along = corners[:, _NEXT] - corners
    length = np.linalg.norm(along, axis=-1)
    normal = along[..., ::-1] * np.array([1.0, -1.0]) / length[..., None]
    # The ends of an edge are left out of its fit, as in edges.py.
    fitted = 1.0 - np.minimum(END_MARGIN_PX, length.min(axis=1, keepdims=True) / 8.0) / (0.5 * length)
    offset = np.sum(normal * bow, axis=-1) * (1.0 - fitted**2 / 3.0)
    before = np.array([3, 0, 1, 2])
    matrix = np.stack([normal[:, before], normal], axis=-2)
    return np.linalg.solve(matrix, np.stack([offset[:, before], offset], axis=-1)[..., None])[..., 0]
