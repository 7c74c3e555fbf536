"""Where in a track something falls freely: the longest stretches that a parabola follows to within their noise.

How fast the frames truly came is what shall be found out, so that a fall is known by its shape alone: along a second-degree curve it leaves
the straight line by `LEAST_FALL` or more, lengths being true whatever the times. A hand that moves, carries or swings the tag follows no
parabola that far.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analyze.types import Array, IntArray

LEAST_FALL = 0.2
"""m, 1/2 a T^2 of the stretch, T its duration; over less a hand that turns back at the end of its swing looks the same"""
LEAST_FRAMES = 8
LONGEST = 2000
"""frames; a fall of a second at 960 a second is half of it"""
LONGER = 1.25
"""from one length that is tried to the next"""
PLACES = 8
"""per length, at which it is tried"""
CLOSE = 3.0
"""sd, of the residuals' rms"""
ROUGH = 5e-4
"""of the fall, what air and the shutter may bend it by beyond the third degree"""
BENT = 0.15
"""of the second degree's, the most that the third may have"""
HELD_TO = 4.0
"""sd, within which the next frame still belongs to the fall"""
MOST_MISSING = 4
"""frames in a row; a longer gap parts two stretches"""
MOST_FALLS = 8


@dataclass(frozen=True)
class FallWindow:
    """A stretch of a track."""

    start: int
    stop: int
    """indices of its frames, the second excluded"""
    fall: float
    """m, 1/2 a T^2"""


def fall_windows(time_ns: IntArray, positions: Array, sd: Array) -> list[FallWindow]:
    """Stretches of free fall, by time; none overlap.

    Args:
        time_ns: (n,) of the frames in which the tag was found.
        positions: (n, 3) m.
        sd: (3,) m, 1 sigma of a frame's position along each axis.
    """
    if len(time_ns) < LEAST_FRAMES:
        return []
    frame = float(np.median(np.diff(time_ns)))
    number: IntArray = np.asarray(np.round((time_ns - time_ns[0]) / frame), dtype=np.int64)
    scaled = positions / sd
    found: list[FallWindow] = []
    starts = [0, *(np.flatnonzero(np.diff(number) > MOST_MISSING + 1) + 1).tolist(), len(number)]
    for first, last in pairwise(starts):
        # Evenly spaced for the search, with short gaps filled; what is found is measured on the frames themselves.
        grid: IntArray = np.arange(int(number[first]), int(number[last - 1]) + 1)
        columns: list[Array] = [np.interp(grid, number[first:last], scaled[first:last, i]) for i in range(3)]
        for start, stop in _parabolas(np.column_stack(columns), sd):
            places: list[int] = np.searchsorted(number, np.array([start, stop]) + int(number[first])).tolist()
            begin, end = places
            if (window := _extended(number, scaled, sd, begin, end)) is not None:
                found.append(window)
    return sorted(_apart(found), key=lambda window: window.start)


def _parabolas(scaled: Array, sd: Array) -> list[tuple[int, int]]:
    """Stretches of evenly spaced positions (n, 3) that a parabola follows, those that fall farthest first, none overlapping."""
    candidates: list[tuple[float, int, int]] = []
    length = float(LEAST_FRAMES)
    while round(length) <= min(len(scaled), LONGEST):
        frames = round(length)
        basis = np.linalg.qr(np.vander(np.linspace(-1, 1, frames), 4, increasing=True))[0]
        windows = np.lib.stride_tricks.sliding_window_view(scaled, frames, axis=0)[
            :: max(1, frames // PLACES)
        ]
        centred = windows - windows.mean(axis=2, keepdims=True)
        parts = centred @ basis
        left = np.sum(centred**2, axis=(1, 2)) - np.sum(parts**2, axis=(1, 2))
        rms = np.sqrt(np.maximum(left, 0) / (3 * (frames - 4)))
        fall, bent = _fall_of(parts, basis, sd)
        good = (
            (fall >= LEAST_FALL)
            & (bent <= BENT)
            & (rms <= np.maximum(CLOSE, ROUGH * fall / float(np.min(sd))))
        )
        for place in np.flatnonzero(good).tolist():
            start = place * max(1, frames // PLACES)
            candidates.append((float(fall[place]), start, start + frames))
        length *= LONGER
    taken: list[tuple[int, int]] = []
    for _, start, stop in sorted(candidates, reverse=True):
        if all(stop <= other or start >= end for other, end in taken):
            taken.append((start, stop))
        if len(taken) == MOST_FALLS:
            break
    return taken


def _fall_of(parts: Array, basis: Array, sd: Array) -> tuple[Array, Array]:
    """1/2 a T^2 [m] (windows,) and the third degree's size over the second's (windows,), of coefficients (windows, 3, 4)."""
    in_metres = parts * sd[:, None]
    # Each column's reach: of u^2 over -1..1 it is 1 (2/3 to -1/3), of a fall of 1/2 a T^2 a quarter.
    second = np.linalg.norm(in_metres[..., 2], axis=1) * float(np.ptp(basis[:, 2]))
    third = np.linalg.norm(in_metres[..., 3], axis=1) * float(np.ptp(basis[:, 3]))
    return 4 * second, third / np.maximum(second, 1e-12)


def _extended(number: IntArray, scaled: Array, sd: Array, start: int, stop: int) -> FallWindow | None:
    """Grown frame by frame while the next lies where the others lead, then without its ends, where something touched it."""
    noise = max(1.0, _Curve(number[start:stop], scaled[start:stop]).rms)
    while stop < len(number) and _belongs(number, scaled, sd, (start, stop), stop, noise):
        stop += 1
    while start > 0 and _belongs(number, scaled, sd, (start, stop), start - 1, noise):
        start -= 1
    start, stop = start + 1, stop - 1
    if stop - start < LEAST_FRAMES:
        return None
    fall = _Curve(number[start:stop], scaled[start:stop]).fall(sd)
    return FallWindow(start, stop, fall) if fall >= LEAST_FALL else None


class _Curve:
    """Of third degree, through positions (n, 3) at frames `number` (n,)."""

    def __init__(self, number: IntArray, scaled: Array) -> None:
        self._middle, self._half = (number[0] + number[-1]) / 2, max((number[-1] - number[0]) / 2, 1)
        design = np.vander((number - self._middle) / self._half, 4, increasing=True)
        self._inverse = np.linalg.inv(design.T @ design)
        self._parts = self._inverse @ design.T @ scaled
        left = scaled - design @ self._parts
        self.rms = float(np.sqrt(np.sum(left**2) / max(3 * (len(number) - 4), 1)))

    def fall(self, sd: Array) -> float:
        """1/2 a T^2 [m]."""
        return 4 * float(np.linalg.norm(self._parts[2] * sd))

    def off(self, frame: int, position: Array) -> Array:
        """(3,) how far a position is off where the curve leads, for what it is known to."""
        at = ((frame - self._middle) / self._half) ** np.arange(4)
        return np.abs(position - at @ self._parts) / np.sqrt(1 + at @ self._inverse @ at)


def _belongs(
    number: IntArray, scaled: Array, sd: Array, window: tuple[int, int], frame: int, noise: float
) -> bool:
    """Whether a frame beside the stretch lies where the stretch's own curve leads."""
    start, stop = window
    if abs(int(number[frame] - number[start if frame < start else stop - 1])) > MOST_MISSING + 1:
        return False
    curve = _Curve(number[start:stop], scaled[start:stop])
    return bool(
        np.all(curve.off(int(number[frame]), scaled[frame]) <= HELD_TO * noise + ROUGH * curve.fall(sd) / sd)
    )


def _apart(windows: list[FallWindow]) -> list[FallWindow]:
    """Those that fall farthest, without what overlaps them."""
    taken: list[FallWindow] = []
    for window in sorted(windows, key=lambda each: -each.fall):
        if all(window.stop <= other.start or window.start >= other.stop for other in taken):
            taken.append(window)
    return taken
