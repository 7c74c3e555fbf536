"""Correction of a rolling shutter: corners of markers at one common time per frame.

A rolling shutter reads row y of an image `line_time` (y - middle) later than its middle row, so that each
corner of a moving marker is seen at another time: at 30 us a line a corner at the top of an 80 px tag is seen
2.4 ms earlier than one at the bottom, in which it moves by pixels. All corners of a frame are corrected to
one time, that of the row at the middle of the markers in view, which needs the smallest corrections. The
motion of a corner is a cubic through four neighbouring frames, each at its own time.

An impact changes the path of a corner abruptly, and a cubic across it is wrong. Of the four-frame stretches
that include a frame, the one with the smallest cubic term is taken, with a preference for those with the
frame in their middle (as essentially non-oscillatory schemes choose theirs: Harten, Engquist, Osher and
Chakravarthy 1987; the preference: Shu 1990).

While a marker turns, its edges appear bowed: the straight lines fitted to them meet off its corners by two
thirds of the bow. The bow follows from the motion of the two corners of an edge, and is subtracted.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.errors import TrackingError
from analyze.tracking.edges import END_MARGIN_PX

if TYPE_CHECKING:
    from collections.abc import Iterable

    from analyze.tracking.marker_path import MarkerPath
    from analyze.types import Array, CameraModel, IntArray

CUBIC_FRAMES = 4
"""number of frames of one cubic"""
_STARTS_AND_COSTS = ((-1, 1.0), (-2, 1.0), (0, 2.0), (-3, 2.0))
"""starts of a stretch relative to its frame, and the factor on its cubic term that expresses the
preference"""
_NOISE_SIGMAS = 3.0
"""size of a cubic term, in corner sds, below which it is noise"""
_NEXT = np.array([1, 2, 3, 0])
"""index of the corner that follows each corner"""
_BOW_PASSES = 2
"""number of passes: the bow shifts the corners, which in turn determine the bow"""
_MAX_READ_OUT_SHARE = 1.05
"""largest ratio of an image's read-out time to the time between two frames"""


def delays_by_frame(camera: CameraModel, paths: Iterable[MarkerPath]) -> dict[int, float]:
    """Delay [s] of the middle row of the markers in view against the image's middle row, by frame time.

    Keys are log times [ns] of the frames. Empty for a global shutter.

    Args:
        camera: camera that took the frames.
        paths: corners of all markers in the frames in which they were found.

    Raises:
        TrackingError: by the line time, the read-out of an image takes longer than the time between frames.
    """
    if not camera.line_time_s:
        return {}
    rows: dict[int, list[float]] = {}
    for path in paths:
        for time_ns, corners in zip(path.time_ns, path.corners_raw, strict=True):
            rows.setdefault(time_ns, []).append(float(corners[:, 1].mean()))
    reading_s = abs(camera.line_time_s) * camera.height
    apart_s = 1e-9 * float(np.median(np.diff(sorted(rows)))) if len(rows) > 1 else reading_s
    if reading_s > _MAX_READ_OUT_SHARE * apart_s:
        raise TrackingError(
            f"by line_time_s the read-out of an image takes {1000 * reading_s:.1f} ms,"
            f" but images are {1000 * apart_s:.1f} ms apart: correct line_time_s, or the frame rate"
        )
    return {time_ns: row_delay_s(camera, float(np.mean(found))) for time_ns, found in rows.items()}


def row_delay_s(camera: CameraModel, row: Any) -> Any:
    """Delay [s] of the read-out of an image row after the middle row's, which defines a frame's time.

    Args:
        camera: camera that took the image.
        row: row [px], or an array of rows; the result has its shape.
    """
    return camera.line_time_s * (row - 0.5 * (camera.height - 1))


def corners_at_one_time(frame_s: Array, ideal: Array, late_s: Array, common_s: Array, sd: float) -> Array:
    """Corners (n, 4, 2) of one marker [ideal px], corrected to the common times `frame_s` + `common_s`.

    Ideal pixels are free of lens distortion. A copy of `ideal` if there is only one frame.

    Args:
        frame_s: (n,) times of the frames' middle rows [s], ascending.
        ideal: (n, 4, 2) corners as fitted to the images [ideal px].
        late_s: (n, 4) delay of the row of each corner against its frame's time [s].
        common_s: (n,) delay of the common time against each frame's time [s].
        sd: standard deviation of a corner in one frame [px], one for all frames.
    """
    if len(frame_s) < 2:
        return ideal.copy()
    seen_s = frame_s[:, None] + late_s
    middle_s = 0.5 * (seen_s + seen_s[:, _NEXT])
    corners = ideal
    for _ in range(_BOW_PASSES):
        path = _CornerPaths(seen_s, corners, sd)
        along = path.evaluate(middle_s), path.evaluate(0.5 * (seen_s + seen_s[:, [3, 0, 1, 2]]))[:, _NEXT]
        bow = 0.5 * (along[0] + along[1]) - 0.5 * (corners + corners[:, _NEXT])
        corners = ideal - _corner_shift(corners, bow)
    return _CornerPaths(seen_s, corners, sd).evaluate(
        np.broadcast_to((frame_s + common_s)[:, None], seen_s.shape)
    )


class _CornerPaths:
    """Paths of a marker's corners around each frame: Newton's cubics through four neighbouring frames.

    Fewer frames give a polynomial of lower degree.
    """

    def __init__(self, seen_s: Array, corners: Array, sd: float) -> None:
        """Fit a cubic in time to the path of each of a marker's four corners, around each of n frames.

        Args:
            seen_s: (n, 4) times at which the corners were seen [s].
            corners: (n, 4, 2) corners [px].
            sd: noise of the corners [px].
        """
        n = len(seen_s)
        width = min(CUBIC_FRAMES, n)
        every = np.arange(n - width + 1)[:, None] + np.arange(width)
        start = _starts(_divided_differences(seen_s[every], corners[every])[:, -1], seen_s, n, sd)
        index = start[:, None] + np.arange(width)
        self._nodes = seen_s[index]
        self._terms = _divided_differences(self._nodes, corners[index])

    def evaluate(self, time_s: Array) -> Array:
        """Positions (n, 4, 2) [ideal px] of a marker's four corners at times `time_s` (n, 4) [s].

        Every corner has its own n times, with the same zero as those given to the constructor. Row i is
        computed from the cubics in time, one per corner, that were fitted around frame i of n. Ideal pixels
        are free of lens distortion.
        """
        place = self._terms[:, -1].copy()
        for i in range(self._terms.shape[1] - 2, -1, -1):
            place = self._terms[:, i] + (time_s - self._nodes[:, i])[..., None] * place
        return place


def _divided_differences(nodes: Array, values: Array) -> Array:
    """Divided differences (m, w, 4, 2) of corners (m, w, 4, 2) [px] at times (m, w, 4) [s].

    They are the coefficients of Newton's polynomial through w frames, for m stretches of frames: entry i of
    the second axis is the difference of order i of the first i + 1 values [px/s^i].

    Args:
        nodes: the times.
        values: the corners, x and y in the last axis.
    """
    terms = values.copy()
    width = nodes.shape[1]
    for order in range(1, width):
        apart = (nodes[:, order:] - nodes[:, :-order])[..., None]
        terms[:, order:] = (terms[:, order:] - terms[:, order - 1 : -1]) / apart
    return terms


def _starts(cubic: Array, seen_s: Array, n: int, sd: float) -> IntArray:
    """Index (n,) of the first frame of the four-frame stretch chosen for each of n frames.

    Chosen is the stretch that includes the frame and has the least cubic term, which counts double unless the
    frame is one of the two in its middle. A cubic term is compared by its size over one frame interval; sizes
    below 3 sd are noise and count as 3 sd.

    Args:
        cubic: (m, 4, 2) cubic term of each stretch [px/s^3]; stretch i begins at frame i.
        seen_s: (n, 4) times of the corners [s].
        n: number of frames.
        sd: standard deviation of a corner in one frame [px].
    """
    last = len(cubic) - 1
    if last == 0:
        return np.zeros(n, dtype=np.int64)
    step = float(np.median(np.diff(seen_s[:, 0])))
    size = np.maximum(np.abs(cubic).max(axis=(1, 2)) * step ** (CUBIC_FRAMES - 1), _NOISE_SIGMAS * sd)
    starts = np.arange(n)[:, None] + np.array([first for first, _ in _STARTS_AND_COSTS])
    inside = (starts >= 0) & (starts <= last)
    cost = np.where(
        inside, size[np.clip(starts, 0, last)] * np.array([weight for _, weight in _STARTS_AND_COSTS]), np.inf
    )
    return starts[np.arange(n), np.argmin(cost, axis=1)]


def _corner_shift(corners: Array, bow: Array) -> Array:
    """Shift (n, 4, 2) [px] from the true corners to the intersections of lines fitted to bowed edges.

    Args:
        corners: (n, 4, 2) corners, in order round the square [ideal px, without lens distortion].
        bow: (n, 4, 2) bow [px] in the middle of the edge that begins at each corner; along an edge, t from -1
            to 1, it is (1 - t^2) times that.
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
