"""Capture times of frames from a container's time stamps, with slow motion and missing frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analyze.types import Array
from schemas.wording import counted

SAME_INTERVAL_FRACTION = 0.5
"""largest deviation of a one-frame interval from the median interval, relative to it"""
GAP_INTERVALS = 1.6
"""gap between two frames, in frame intervals, from which on a frame is missing"""
COARSE_STEP_FRACTION = 0.01
"""step of the stamps, relative to the frame interval, above which it is coarse (Matroska: milliseconds)"""
ROUNDING_STEPS = 1e-6
"""room for the arithmetic's rounding in a comparison of stamps [steps]"""
RECENT_INTERVALS = 15
"""number of intervals that determine the current rate: a phone's changes with the light"""
MIN_TIME_SD_NS = 1_000
"""smallest standard deviation of a time stamp [ns]"""


@dataclass(frozen=True)
class FrameTiming:
    """Conversion of a video's stamps (steps of `unit` seconds) to capture times since its first frame.

    A slow-motion file may play at 30 frames a second what was captured at 240: `slowed` is then 8, and the
    playing times are divided by it. If `steady_s` is not None, the frame rate is constant, with this playing
    interval [s], and the stamps are its multiples rounded to coarse steps.
    """

    first: int
    """smallest stamp [steps]; its capture time is 0"""
    unit: Fraction
    """duration of a step as the file plays [s]"""
    interval_s: float
    """interval between two frames as captured [s]"""
    slowed: Fraction = Fraction(1)
    """playing time over capture time"""
    steady_s: Fraction | None = None
    """playing interval [s] of a constant rate whose stamps are rounded to coarse steps.

    None if the stamps themselves are the times.
    """

    @property
    def played_hz(self) -> float:
        """Frame rate at which the file plays [Hz]; for slow motion lower than that of capture."""
        return 1.0 / (self.interval_s * float(self.slowed))

    def time_ns(self, stamp: int) -> int:
        """Capture time [ns] since the first frame that belongs to a frame's time stamp.

        If the frame rate is constant and the stamps are coarsely rounded (`steady_s` is not None), it is the
        nearest multiple of the frame interval, provided that it is within one step of the stamp. Otherwise it
        is the stamp's own time.

        Args:
            stamp: the file's time stamp [steps of `unit`].
        """
        steps = stamp - self.first
        if self.steady_s is not None:
            number = round(steps / self._steady_steps)
            # Only while both agree: a stated rate that is slightly wrong drifts away from the stamps.
            if abs(number * self._steady_steps - steps) <= 1:
                return round(number * self.steady_s / self.slowed * 10**9)
        over, under = self._step_ns
        return (2 * steps * over + under) // (2 * under)

    def times_ns(self, stamps: Sequence[int]) -> NDArray[np.int64]:
        """Capture times (n,) [ns] that belong to n time stamps; 0 is the first frame's.

        If the frame rate is constant and the stamps are coarsely rounded (`steady_s` is not None), they are
        the nearest multiples of the frame interval, where these are within one step (unit of the stamps) of
        the stamps. Otherwise they are the stamps' own times.
        """
        over, under = self._step_ns
        steps = np.asarray(stamps, dtype=np.int64) - self.first
        if self.steady_s is not None or 2 * over * (int(np.abs(steps).max(initial=0)) + 1) + under >= 1 << 62:
            return np.array([self.time_ns(stamp) for stamp in stamps], dtype=np.int64)
        return (2 * steps * over + under) // (2 * under)

    @cached_property
    def _step_ns(self) -> tuple[int, int]:
        """Capture time [ns] per unit of a video's time stamps, as numerator and denominator.

        In slow motion it is shorter than the time that the unit takes in playing. Arithmetic with whole
        numbers is faster than with fractions.
        """
        return (self.unit / self.slowed * 10**9).as_integer_ratio()

    @cached_property
    def _steady_steps(self) -> float:
        """Frame interval `steady_s` as a number of time-stamp steps, not necessarily whole.

        `steady_s` is the interval [s] at which a file of constant rate plays; if it is None, the number is
        meaningless.
        """
        return float((self.steady_s or 1) / self.unit)

    def stamp(self, time_ns: int) -> int:
        """Time stamp (whole number of steps, as in the video file) that belongs to a capture time.

        It is rounded down. The captured duration of a step is constant here; `time_ns`, the reverse, also
        corrects coarse stamps to a constant frame rate.

        Args:
            time_ns: capture time since the first frame [ns], not negative.
        """
        return self.first + int(Fraction(time_ns, 10**9) * self.slowed / self.unit)

    @property
    def sd_ns(self) -> int:
        """Standard deviation of a frame's capture time [ns] that comes from rounding stamps to steps.

        It is a step's duration in capture time over sqrt(12), at least 1 ns. It is 1 ns if `steady_s` is not
        None: the frame rate is then known to be constant, and the rounding is undone.
        """
        if self.steady_s is not None:
            return 1
        return max(1, round(float(self.unit / self.slowed) * 1e9 / 12**0.5))


def frame_timing(
    stamps: Sequence[int], unit: Fraction, stated_hz: Fraction | None, capture_hz: float | None
) -> FrameTiming | None:
    """Determine how a video's time stamps convert to capture times, from those of its first frames.

    Args:
        stamps: time stamps in any order [steps].
        unit: duration of one step as the file plays [s].
        stated_hz: frame rate that the container states [Hz]; None if it states none.
        capture_hz: true frame rate [Hz] if the container plays slower than was captured; None if the stamps
            are true.

    Returns:
        The conversion, with first stamp, frame interval and slowing factor; None for fewer than two
        different stamps.
    """
    rising = np.unique(np.asarray(stamps, dtype=np.int64))
    if len(rising) < 2:
        return None
    interval_s = usual_interval(stamps) * float(unit)
    if stated_hz and abs(interval_s * float(stated_hz) - 1) < 2e-3:
        interval_s = float(1 / stated_hz)
    slowed = (
        Fraction(1) if capture_hz is None else Fraction(interval_s * capture_hz).limit_denominator(100_000)
    )
    stated_s = 1 / stated_hz if stated_hz else None
    steady_s = (
        stated_s
        if stated_s is not None
        and unit > COARSE_STEP_FRACTION * stated_s
        and _is_steady(rising - rising[0], stated_s / unit)
        else None
    )
    return FrameTiming(int(rising[0]), unit, interval_s / float(slowed), slowed, steady_s)


def usual_interval(times: Sequence[int]) -> float:
    """Mean interval between consecutive frames without gaps, in the unit of `times`.

    There must be two or more different times, in any order. Intervals that differ from the median by more
    than `SAME_INTERVAL_FRACTION` of it (missing frames) are ignored.
    """
    gaps = np.diff(np.unique(np.asarray(times, dtype=np.int64)))
    middle = np.sort(gaps)[len(gaps) // 2]  # an interval that occurs, so that at least one is near it
    return float(np.mean(gaps[np.abs(gaps - middle) <= SAME_INTERVAL_FRACTION * middle]))


def time_sd_ns(times: list[int]) -> int:
    """Standard deviation of a frame's time [ns], from the second differences of the frames' times [ns].

    It is 1.4826 times the median absolute second difference over sqrt(6), so that lost frames hardly affect
    it, and at least `MIN_TIME_SD_NS`, which is also the value for fewer than three frames.
    """
    second: Array = np.diff(np.array(times, dtype=np.int64), 2).astype(np.float64)
    if len(second) == 0:
        return MIN_TIME_SD_NS
    return max(MIN_TIME_SD_NS, round(1.4826 * float(np.median(np.abs(second))) / 6**0.5))


def _is_steady(steps: NDArray[np.int64], interval: Fraction) -> bool:
    """True if time stamps are the multiples of a constant frame interval, each rounded to a whole step.

    A step is the unit in which the video file states time stamps. Rounding moves all stamps by less than one
    step against each other, and no two of them are those of the same multiple; the median distance between
    neighbouring stamps must also be about one interval.

    Args:
        steps: (n,) increasing stamps since the first [steps].
        interval: frame interval [steps].
    """
    places = steps / float(interval)
    numbers = np.rint(places)
    off = steps - numbers * float(interval)
    return bool(
        np.ptp(off) <= 1.0 + ROUNDING_STEPS
        and len(np.unique(numbers)) == len(numbers)
        and np.median(np.diff(places)) < 1 + SAME_INTERVAL_FRACTION
    )


def interval_range(times_ns: NDArray[np.int64]) -> tuple[float, float]:
    """Shortest and longest usual frame interval in a video [ns]; similar if the frame rate is constant.

    The usual interval at a place is the median of `RECENT_INTERVALS` successive intervals, so that single
    gaps have no effect. Returns the smallest and the largest of these medians; 0 and 0 for fewer than two
    frames.

    Args:
        times_ns: (n,) times of all frames [ns], increasing.
    """
    gaps = np.diff(times_ns)
    if not len(gaps):
        return 0.0, 0.0
    windows = np.lib.stride_tricks.sliding_window_view(gaps, min(RECENT_INTERVALS, len(gaps)))
    usual = np.median(windows, axis=1)
    return float(usual.min()), float(usual.max())


def time_scatter(times_ns: NDArray[np.int64]) -> tuple[float, float]:
    """Scatter (robust 1 sigma) of frame times about a smooth pace, and the usual frame interval [ns].

    Missing frames do not count, as whole intervals are taken off before `time_sd_ns`. Both are 0 for fewer
    than `RECENT_INTERVALS` frames.

    Args:
        times_ns: (n,) times of all frames [ns], increasing.
    """
    if len(times_ns) < RECENT_INTERVALS:
        return 0.0, 0.0
    gaps = np.diff(times_ns)
    interval = max(float(np.median(gaps)), 1.0)
    uneven = np.cumsum(gaps - interval * np.round(gaps / interval))
    return float(time_sd_ns([round(each) for each in uneven])), interval


@dataclass
class MissingFrames:
    """Counter of missing frames, from gaps between the frame times given to its methods.

    An interval is a gap if it is at least `GAP_INTERVALS` times the median of the last `RECENT_INTERVALS`
    intervals. `before` takes one time, `before_each` several; times increase.
    """

    interval_ns: float
    """interval between two frames [ns], used until `RECENT_INTERVALS` intervals were seen"""
    frames: int = 0
    """number of missing frames so far"""
    places: int = 0
    """number of gaps so far"""
    longest_ns: int = 0
    """longest gap [ns]"""
    longest_at_ns: int = 0
    """time of the last frame before the longest gap [ns]"""
    _last_ns: int | None = None
    _recent: deque[int] = field(default_factory=lambda: deque(maxlen=RECENT_INTERVALS))

    def before(self, time_ns: int) -> int:
        """Number of frames missing between the previous frame and the next; 0 if there is no previous one.

        Missing frames and the gap are added to the counts.

        Args:
            time_ns: time of the next frame [ns].
        """
        last, self._last_ns = self._last_ns, time_ns
        if last is None:
            return 0
        gap = time_ns - last
        usual = (
            sorted(self._recent)[RECENT_INTERVALS // 2]
            if len(self._recent) == RECENT_INTERVALS
            else self.interval_ns
        )
        self._recent.append(gap)
        if gap < GAP_INTERVALS * usual:
            return 0
        missing = round(gap / usual) - 1
        self.frames, self.places = self.frames + missing, self.places + 1
        if gap > self.longest_ns:
            self.longest_ns, self.longest_at_ns = gap, last
        return missing

    def before_each(self, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Numbers (n,) of frames missing directly before each of the next n frames.

        A sequence's first frame has 0. Missing frames and gaps are added to the counts.

        Args:
            times_ns: (n,) times of the next frames [ns], increasing.
        """
        if not len(times_ns):
            return np.zeros(0, np.int64)
        gaps = np.diff(times_ns, prepend=times_ns[0] if self._last_ns is None else self._last_ns)
        known = gaps if self._last_ns is not None else gaps[1:]
        usual = [*self._recent, *known.tolist()]
        if len(self._recent) < RECENT_INTERVALS:
            usual.append(self.interval_ns)
        if max(usual) < GAP_INTERVALS * min(usual):  # no frame is missing, whatever the median is
            self._last_ns = int(times_ns[-1])
            self._recent.extend(known[-RECENT_INTERVALS:].tolist())
            return np.zeros(len(times_ns), np.int64)
        return np.array([self.before(time_ns) for time_ns in times_ns.tolist()], dtype=np.int64)

    def restart(self) -> None:
        """Begin a new sequence of frames: a gap before its first frame is not counted.

        All counts are kept.
        """
        self._last_ns = None

    def remark(self, name: str) -> str | None:
        """Sentence for the user: number of missing frames and longest gap; None if none is missing.

        Args:
            name: name of the source, put before the sentence.
        """
        if not self.frames:
            return None
        where = f"in {counted(self.places, 'place')}, the longest" if self.places > 1 else "once:"
        longest = f"{self.longest_ns * 1e-9:.3f} s from {self.longest_at_ns * 1e-9:.3f} s on"
        return f"{name}: {counted(self.frames, 'frame', 'is')} missing {where} {longest}"
