"""Search for free falls in a track: the longest stretches that fit a parabola to within their noise.

The true frame rate is unknown, so that a fall is recognised by its shape alone: a second-degree curve with a
fall of `MIN_FALL_M` (0.2 m) or more. A fall is the length 1/2 a T^2, with a the acceleration and T the
stretch's duration; it does not depend on the unit of time. A hand that moves, carries or swings the tag does
not follow a parabola that far.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analyze.types import Array, IntArray

MIN_FALL_M = 0.2
"""least fall 1/2 a T^2 [m] over a stretch of duration T; below it a hand that reverses its swing looks the
same"""
MIN_FRAMES = 8
"""least length of a stretch [frames]"""
MAX_FRAMES = 2000
"""longest stretch that is tried [frames]; a fall of 1 s at 960 frames a second is half as long"""
LENGTH_RATIO = 1.25
"""ratio of one tried length to the next"""
STARTS_PER_LENGTH = 8
"""number of starts tried within one length"""
MAX_RMS_SIGMAS = 3.0
"""largest rms residual [sd] of a parabola"""
MODEL_ERROR = 5e-4
"""deviation of a fall from a third-degree curve by air and shutter, as a share of the fall"""
MAX_THIRD_DEGREE = 0.15
"""largest ratio of the third-degree term to the second-degree term"""
NEXT_FRAME_SIGMAS = 4.0
"""distance from the curve [sd] within which the next frame still belongs to the fall"""
MAX_MISSING = 4
"""most consecutive frames that may be missing; a longer gap separates two stretches"""
MAX_FALLS = 8
"""most falls that are reported"""


@dataclass(frozen=True)
class FallWindow:
    """Stretch of frames, indices [start, stop) of a track, in which the tag falls freely by `fall` [m]."""

    start: int
    """index of the first frame"""
    stop: int
    """index after the last frame"""
    fall: float
    """distance fallen from rest, 1/2 a T^2, over the stretch's duration T [m]"""


def fall_windows(time_ns: IntArray, positions: Array, sd: Array) -> list[FallWindow]:
    """Stretches of free fall in a track of a tag, in order of time, without overlaps.

    Args:
        time_ns: (n,) times of the frames in which the tag was found [ns].
        positions: (n, 3) positions of the tag [m].
        sd: (3,) standard deviation of a frame's position along each axis [m].

    Returns:
        The stretches, with indices into `time_ns`; empty if there is no fall of 0.2 m or more, or if the
        track has fewer than 8 frames.
    """
    if len(time_ns) < MIN_FRAMES:
        return []
    frame = float(np.median(np.diff(time_ns)))
    number: IntArray = np.asarray(np.round((time_ns - time_ns[0]) / frame), dtype=np.int64)
    scaled = positions / sd
    found: list[FallWindow] = []
    starts = [0, *(np.flatnonzero(np.diff(number) > MAX_MISSING + 1) + 1).tolist(), len(number)]
    for first, last in pairwise(starts):
        # Evenly spaced for the search, with short gaps filled; the result is measured on the frames
        # themselves.
        grid: IntArray = np.arange(int(number[first]), int(number[last - 1]) + 1)
        columns: list[Array] = [np.interp(grid, number[first:last], scaled[first:last, i]) for i in range(3)]
        for found_window in _parabolas(np.column_stack(columns), sd):
            ends = np.array([found_window.start, found_window.stop]) + int(number[first])
            begin, end = np.searchsorted(number, ends).tolist()
            if (window := _extended(number, scaled, sd, begin, end)) is not None:
                found.append(window)
    return sorted(_without_overlaps(found), key=lambda window: window.start)


def _parabolas(scaled: Array, sd: Array) -> list[FallWindow]:
    """Stretches of evenly spaced positions that lie on a parabola, the one with the greatest fall first.

    Args:
        scaled: (n, 3) positions of a tag at equal time steps, each coordinate over its standard deviation.
        sd: (3,) those standard deviations [m].

    Returns:
        At most `MAX_FALLS` (8) stretches that do not overlap: index of the first position and after the last,
        and the fall 1/2 a T^2 [m], with a the acceleration and T the stretch's duration.
    """
    candidates: list[FallWindow] = []
    length = float(MIN_FRAMES)
    while round(length) <= min(len(scaled), MAX_FRAMES):
        frames = round(length)
        basis = np.linalg.qr(np.vander(np.linspace(-1, 1, frames), 4, increasing=True))[0]
        windows = np.lib.stride_tricks.sliding_window_view(scaled, frames, axis=0)[
            :: max(1, frames // STARTS_PER_LENGTH)
        ]
        centred = windows - windows.mean(axis=2, keepdims=True)
        parts = centred @ basis
        left = np.sum(centred**2, axis=(1, 2)) - np.sum(parts**2, axis=(1, 2))
        rms = np.sqrt(np.maximum(left, 0) / (3 * (frames - 4)))
        fall, bent = _fall_of(parts, basis, sd)
        good = (
            (fall >= MIN_FALL_M)
            & (bent <= MAX_THIRD_DEGREE)
            & (rms <= np.maximum(MAX_RMS_SIGMAS, MODEL_ERROR * fall / float(np.min(sd))))
        )
        for place in np.flatnonzero(good).tolist():
            start = place * max(1, frames // STARTS_PER_LENGTH)
            candidates.append(FallWindow(start, start + frames, float(fall[place])))
        length *= LENGTH_RATIO
    return _without_overlaps(candidates)[:MAX_FALLS]


def _fall_of(parts: Array, basis: Array, sd: Array) -> tuple[Array, Array]:
    """Fall [m] in each window (run of frames), and how far the window's curve departs from a parabola.

    Both are (windows,). The fall is 1/2 a T^2, with a the acceleration and T the window's duration. The
    departure is the ratio of the curve's third-degree to its second-degree term.

    Args:
        parts: (windows, 3, 4) coefficients on `basis` of the positions, each axis over its `sd`.
        basis: (frames, 4) orthonormal polynomials of degree 0 to 3.
        sd: (3,) standard deviations of a position along each axis [m].
    """
    in_metres = parts * sd[:, None]
    # Range of each column: for u^2 over -1..1 it is 1 (2/3 to -1/3), which is a quarter of a fall of 1/2 a
    # T^2.
    second = np.linalg.norm(in_metres[..., 2], axis=1) * float(np.ptp(basis[:, 2]))
    third = np.linalg.norm(in_metres[..., 3], axis=1) * float(np.ptp(basis[:, 3]))
    return 4 * second, third / np.maximum(second, 1e-12)


def _extended(number: IntArray, scaled: Array, sd: Array, start: int, stop: int) -> FallWindow | None:
    """Extend a stretch of a fall frame by frame while the next frame lies on its curve.

    The curve is a polynomial of third degree. The two end frames of the extended stretch are left out: a hand
    or the ground may still have touched the tag there.

    Args:
        number: (n,) number of each frame on an even grid of frames.
        scaled: (n, 3) positions of the tag over their standard deviations.
        sd: (3,) those standard deviations [m].
        start: index of the stretch's first frame.
        stop: index after its last frame.

    Returns:
        The extended stretch [start, stop) of frames, with the distance fallen [m]; None if fewer than 8
        frames or a fall of less than 0.2 m remain.
    """
    noise = max(1.0, _Curve(number[start:stop], scaled[start:stop]).rms)
    while stop < len(number) and _continues(number, scaled, sd, (start, stop), stop, noise):
        stop += 1
    while start > 0 and _continues(number, scaled, sd, (start, stop), start - 1, noise):
        start -= 1
    start, stop = start + 1, stop - 1
    if stop - start < MIN_FRAMES:
        return None
    fall = _Curve(number[start:stop], scaled[start:stop]).fall(sd)
    return FallWindow(start, stop, fall) if fall >= MIN_FALL_M else None


class _Curve:
    """Polynomial of third degree, fitted to scaled positions (n, 3) at frame numbers (n,).

    Positions are scaled by their standard deviations; `rms` is the root mean square residual in that unit.
    """

    def __init__(self, number: IntArray, scaled: Array) -> None:
        """Fit a polynomial of third degree in the frame number to each coordinate of a tag's positions.

        Args:
            number: (n,) numbers of the frames.
            scaled: (n, 3) positions, divided by their standard deviations.
        """
        self._middle, self._half = (number[0] + number[-1]) / 2, max((number[-1] - number[0]) / 2, 1)
        design = np.vander((number - self._middle) / self._half, 4, increasing=True)
        self._inverse = np.linalg.inv(design.T @ design)
        self._parts = self._inverse @ design.T @ scaled
        left = scaled - design @ self._parts
        self.rms = float(np.sqrt(np.sum(left**2) / max(3 * (len(number) - 4), 1)))

    def fall(self, sd: Array) -> float:
        """Distance fallen from rest [m] over the stretch's duration T: 1/2 a T^2, with a the acceleration.

        The acceleration is that of the polynomial fitted to the tag's positions.

        Args:
            sd: (3,) standard deviations by which the positions were scaled [m].
        """
        return 4 * float(np.linalg.norm(self._parts[2] * sd))

    def off(self, frame: int, position: Array) -> Array:
        """Distance (3,) of a tag's position from the fitted curve along x, y and z, in standard deviations.

        The curve is the cubic fitted to the tag's positions in a stretch of frames; the standard deviation is
        that of position and curve together. The distance is not negative.

        Args:
            frame: number of the position's frame, missing frames counted.
            position: (3,) the position, each component divided by its standard deviation.
        """
        at = ((frame - self._middle) / self._half) ** np.arange(4)
        return np.abs(position - at @ self._parts) / np.sqrt(1 + at @ self._inverse @ at)


def _continues(
    number: IntArray, scaled: Array, sd: Array, window: tuple[int, int], frame: int, noise: float
) -> bool:
    """True if a frame belongs to a stretch of a tag's fall: its position continues the stretch's curve.

    The curve is the cubic fitted to the stretch's positions. At most 4 frames may be missing in between.

    Args:
        number: (n,) number of each frame on an even grid of frames, missing ones counted.
        scaled: (n, 3) positions of the tag over their standard deviations.
        sd: (3,) those standard deviations [m].
        window: the stretch, indices [start, stop).
        frame: index of the frame, before or after the stretch.
        noise: rms distance of the stretch's positions from the curve, in standard deviations.
    """
    start, stop = window
    if abs(int(number[frame] - number[start if frame < start else stop - 1])) > MAX_MISSING + 1:
        return False
    curve = _Curve(number[start:stop], scaled[start:stop])
    return bool(
        np.all(
            curve.off(int(number[frame]), scaled[frame])
            <= NEXT_FRAME_SIGMAS * noise + MODEL_ERROR * curve.fall(sd) / sd
        )
    )


def _without_overlaps(windows: list[FallWindow]) -> list[FallWindow]:
    """Windows (stretches of free fall) without those that overlap a kept one of greater fall.

    They are in the order of distance fallen, the greatest first.
    """
    taken: list[FallWindow] = []
    for window in sorted(windows, key=lambda each: (each.fall, each.start, each.stop), reverse=True):
        if all(window.stop <= other.start or window.start >= other.stop for other in taken):
            taken.append(window)
    return taken
