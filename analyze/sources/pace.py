"""From a container's time stamps to times: its clock, slow motion undone, frames that are missing."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

_NEAR = 0.5
"""of the median interval, by which one may differ and still be one frame's"""
_MISSED = 1.6
"""intervals between two frames from which on one is missing between them"""
_COARSE = 0.01
"""of an interval, from which on a step of the stamps is coarse: Matroska counts milliseconds"""
_REMEMBERED = 15
"""intervals that say what the rate is now: a phone's changes with the light"""


@dataclass(frozen=True)
class Pace:
    """How a stream counts time.

    A slow-motion file plays what was captured at 240 frames a second at 30, say: `slowed` is 8 then, and its times are divided by it.
    """

    first: int
    """smallest stamp"""
    unit: Fraction
    """seconds of one step of the stamps, as the file plays"""
    interval_s: float
    """between two frames, as they were captured"""
    slowed: Fraction = Fraction(1)
    steady_s: Fraction | None = None
    """interval, as the file plays, where the stamps are those of a constant rate rounded to coarse steps; None: they are times"""

    @property
    def played_hz(self) -> float:
        """Frames per second as the file plays."""
        return 1.0 / (self.interval_s * float(self.slowed))

    def time_ns(self, stamp: int) -> int:
        """Time since the first frame, as it was captured [ns]."""
        steps = stamp - self.first
        if self.steady_s is not None:
            number = round(steps / self._steady_steps)
            # Not for ever: a rate that is a little off leaves the line.
            if abs(number * self._steady_steps - steps) <= 1:
                return round(number * self.steady_s / self.slowed * 10**9)
        over, under = self._step_ns
        return (2 * steps * over + under) // (2 * under)

    def times_ns(self, stamps: Sequence[int]) -> NDArray[np.int64]:
        """`time_ns` of each."""
        over, under = self._step_ns
        steps = np.asarray(stamps, dtype=np.int64) - self.first
        if self.steady_s is not None or 2 * over * (int(np.abs(steps).max(initial=0)) + 1) + under >= 1 << 62:
            return np.array([self.time_ns(stamp) for stamp in stamps], dtype=np.int64)
        return (2 * steps * over + under) // (2 * under)

    @cached_property
    def _step_ns(self) -> tuple[int, int]:
        """Nanoseconds of a step as a fraction: it is asked for every frame, and whole numbers are quick."""
        return (self.unit / self.slowed * 10**9).as_integer_ratio()

    @cached_property
    def _steady_steps(self) -> float:
        return float((self.steady_s or 1) / self.unit)

    def stamp(self, time_ns: int) -> int:
        """The last stamp that is not after `time_ns`."""
        return self.first + int(Fraction(time_ns, 10**9) * self.slowed / self.unit)

    @property
    def sd_ns(self) -> int:
        """1 sigma of a time: a stamp is rounded to a whole step."""
        if self.steady_s is not None:
            return 1
        return max(1, round(float(self.unit / self.slowed) * 1e9 / 12**0.5))


def pace_of(stamps: Sequence[int], unit: Fraction, said_hz: Fraction | None, capture_hz: float | None) -> Pace | None:
    """Read off the stamps of a stream's first frames; None where they are fewer than two.

    Args:
        stamps: in any order.
        unit: seconds of one step.
        said_hz: the frame rate that the container tells.
        capture_hz: the true one, where the container plays slower than was captured; None: the stamps are true.
    """
    rising = np.unique(np.asarray(stamps, dtype=np.int64))
    if len(rising) < 2:
        return None
    interval_s = usual_interval(stamps) * float(unit)
    if said_hz and abs(interval_s * float(said_hz) - 1) < 2e-3:
        interval_s = float(1 / said_hz)
    slowed = Fraction(1) if capture_hz is None else Fraction(interval_s * capture_hz).limit_denominator(100_000)
    said_s = 1 / said_hz if said_hz else None
    steady_s = said_s if said_s is not None and unit > _COARSE * said_s and _is_steady(rising - rising[0], said_s / unit) else None
    return Pace(int(rising[0]), unit, interval_s / float(slowed), slowed, steady_s)


def usual_interval(times: Sequence[int]) -> float:
    """Between two frames that follow each other, by two or more times, in any order; frames that are missing between others leave it."""
    gaps = np.diff(np.unique(np.asarray(times, dtype=np.int64)))
    middle = np.sort(gaps)[len(gaps) // 2]  # one of them, so that one at least is near it
    return float(np.mean(gaps[np.abs(gaps - middle) <= _NEAR * middle]))


def _is_steady(steps: NDArray[np.int64], interval: Fraction) -> bool:
    """Whether whole steps are multiples of an interval, rounded, and about one after the other."""
    places = steps / float(interval)
    off = np.abs(steps - np.rint(places) * float(interval))
    return bool(off.max() <= 1.0 and np.median(np.diff(places)) < 1 + _NEAR)


def paces(times_ns: NDArray[np.int64]) -> tuple[float, float]:
    """Shortest and longest interval between frames [ns], each the median of some in a row: alike, where a film has one pace.

    Args:
        times_ns: (n,) of all its frames, rising.
    """
    gaps = np.diff(times_ns)
    if not len(gaps):
        return 0.0, 0.0
    windows = np.lib.stride_tricks.sliding_window_view(gaps, min(_REMEMBERED, len(gaps)))
    usual = np.median(windows, axis=1)
    return float(usual.min()), float(usual.max())


@dataclass
class Missing:
    """Finds frames that are missing between others. Feed times that rise."""

    interval_ns: float
    """between two frames, to begin with"""
    frames: int = 0
    places: int = 0
    longest_ns: int = 0
    longest_at_ns: int = 0
    _last_ns: int | None = None
    _recent: deque[int] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))

    def before(self, time_ns: int) -> int:
        """How many are missing between the frame before and this one."""
        last, self._last_ns = self._last_ns, time_ns
        if last is None:
            return 0
        gap = time_ns - last
        usual = sorted(self._recent)[_REMEMBERED // 2] if len(self._recent) == _REMEMBERED else self.interval_ns
        self._recent.append(gap)
        if gap < _MISSED * usual:
            return 0
        missing = round(gap / usual) - 1
        self.frames, self.places = self.frames + missing, self.places + 1
        if gap > self.longest_ns:
            self.longest_ns, self.longest_at_ns = gap, last
        return missing

    def before_each(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """`before` of each of some frames, (n,)."""
        if not len(times_ns):
            return np.zeros(0, np.int64)
        gaps = np.diff(times_ns, prepend=times_ns[0] if self._last_ns is None else self._last_ns)
        known = gaps if self._last_ns is not None else gaps[1:]
        usual = [*self._recent, *known.tolist()] if len(self._recent) == _REMEMBERED else [self.interval_ns, *self._recent, *known.tolist()]
        if max(usual) < _MISSED * min(usual):  # whatever the median is, none is missing
            self._last_ns = int(times_ns[-1])
            self._recent.extend(known[-_REMEMBERED:].tolist())
            return np.zeros(len(times_ns), np.int64)
        return np.array([self.before(time_ns) for time_ns in times_ns.tolist()], dtype=np.int64)

    def pause(self) -> None:
        """What follows does not follow on what came before."""
        self._last_ns = None

    def remark(self, name: str) -> str | None:
        """In one line; None where none is missing."""
        if not self.frames:
            return None
        where = f"in {self.places} places, the longest" if self.places > 1 else "once:"
        return f"{name}: {self.frames} frames are missing {where} {self.longest_ns * 1e-9:.3f} s from {self.longest_at_ns * 1e-9:.3f} s on"
