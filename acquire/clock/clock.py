"""Host clock, passed in wherever time is read, and the mapping of a device clock to it."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from acquire.clock.bounds import LineBounds, lines_between

if TYPE_CHECKING:
    from acquire.clock.reading import ClockReading

DRIFT_LIMIT = 3e-4
"""greatest |rate| of the host clock against a device clock, minus 1: twice a poor crystal's 100 ppm, plus the
rate at which NTP slews the host clock"""
DRIFT_PRIOR_SD = 1e-4
"""1 sigma of the rate of one clock against another, minus 1, before any reading: 100 ppm"""
BIN_NS = 500_000_000
"""length of a bin of frame arrivals [ns]; only the arrival of the least delay in each bin is used"""
BURST_NS = 20_000_000
"""of readings closer than this [ns] only the quickest counts: the others bound the same line less tightly"""
MAPPING_SD_FLOOR_NS = 2_000.0
"""smallest 1 sigma [ns] of the mapping of a clock that is read over a wire"""


class Clock(Protocol):
    """Host clock. Code that reads time or sleeps takes one as an argument, so that tests can replace it."""

    def monotonic_ns(self) -> int:
        """Present time of CLOCK_MONOTONIC [ns]."""
        ...

    def wall_ns(self) -> int:
        """Present time of CLOCK_REALTIME, since the Unix epoch [ns].

        Used only for the wall anchor (log time minus monotonic time).
        """
        ...

    def sleep(self, seconds: float) -> None:
        """Block the calling thread for `seconds`."""
        ...


class SystemClock:
    """Clock of the operating system."""

    def monotonic_ns(self) -> int:
        """Present time of CLOCK_MONOTONIC [ns]."""
        return time.monotonic_ns()

    def wall_ns(self) -> int:
        """Present time of CLOCK_REALTIME, since the Unix epoch [ns]."""
        return time.time_ns()

    def sleep(self, seconds: float) -> None:
        """Block the calling thread for `seconds`; zero and negative durations return at once."""
        if seconds > 0:
            time.sleep(seconds)


@dataclass(frozen=True)
class _Point:
    device_ns: int
    host_ns: int
    sd_ns: float


@dataclass(frozen=True)
class _Line:
    """Line host = host0 + (device - device0) + offset + rate * (device - device0) between two clocks.

    Only the small terms, offset [ns] and rate, are floating point.
    """

    device0_ns: int
    host0_ns: int
    offset_ns: float
    rate: float
    covariance: tuple[float, float, float]
    """covariance of (offset, rate): var(offset) [ns^2], cov [ns], var(rate)"""

    def host_ns(self, device_ns: int) -> int:
        elapsed = device_ns - self.device0_ns
        return self.host0_ns + elapsed + round(self.offset_ns + self.rate * elapsed)

    def sd_ns(self, device_ns: int) -> float:
        elapsed = float(device_ns - self.device0_ns)
        var_offset, cov, var_rate = self.covariance
        return max(0.0, var_offset + 2.0 * elapsed * cov + elapsed * elapsed * var_rate) ** 0.5


class DeviceClockMapper:
    """Mapping of a device clock to the host's monotonic clock: offset and drift over a sliding window.

    Each `ClockReading` holds the device clock between two readings of the host clock: a bound that no delay
    can break (Cristian 1989, "Probabilistic clock synchronization"). All straight lines between all bounds
    (Marzullo 1984) are a convex polygon in offset and drift; none of them is more probable than another, so
    the mapping is their mean, and their spread is its uncertainty. A slow machine or a queue in one direction
    makes the polygon larger, never wrong. The marginal of a uniform polygon ends within 2.83 sd of its mean
    (a triangle's tip): **while the drift is steady, the error is below 3 sd, always.** Where no line fits,
    the drift was not steady (the device warmed up, the host clock was slewed) and the oldest readings are
    discarded.

    Where the device cannot latch (store its clock on a command), `add_arrival` takes the frames themselves:
    the frame of the least delay in each bin of BIN_NS represents the bin (queues only add delay), and the
    result lags by the constant least delay. As soon as there are latched readings, only they are used.

    Args:
        window_s: length of the sliding window [s].
    """

    def __init__(self, window_s: float = 10.0) -> None:
        self._window_ns = round(window_s * 1e9)
        self._readings: deque[ClockReading] = deque()
        self._bins: deque[_Point] = deque()
        self._bin_start_ns: int | None = None
        self._line: _Line | None = None
        self._newest_device_ns = 0

    @property
    def latched(self) -> bool:
        """True if the mapping uses clock readings; False: arrival times only, or nothing yet."""
        return bool(self._readings)

    @property
    def span_s(self) -> float:
        """Time between the oldest and the newest clock reading in use [s]; 0 if there is none."""
        return (
            (self._readings[-1].host_after_ns - self._readings[0].host_after_ns) * 1e-9
            if self._readings
            else 0.0
        )

    @property
    def shortest_round_trip_ns(self) -> int:
        """Shortest time between the two host times of a clock reading in use [ns]; 0 if there is none."""
        return min((_round_trip_ns(reading) for reading in self._readings), default=0)

    def sd_at(self, device_time_ns: int) -> int:
        """1 sigma of the mapping at a device time [ns]; 0 before the first reading or arrival.

        It grows with the time since the last reading, and is at least MAPPING_SD_FLOOR_NS.
        """
        return 0 if self._line is None else round(max(MAPPING_SD_FLOOR_NS, self._line.sd_ns(device_time_ns)))

    def add(self, reading: ClockReading) -> None:
        """Add a reading of the device clock and update the mapping.

        A clock that ran backwards (the device restarted) empties the window. Of readings within BURST_NS only
        the quickest is kept. Readings older than the window are discarded, and the oldest ones as long as no
        line satisfies all.
        """
        if self._readings and reading.device_time_ns < self._readings[-1].device_time_ns:
            self._readings.clear()
        if self._readings and reading.device_time_ns - self._readings[-1].device_time_ns < BURST_NS:
            if _round_trip_ns(reading) >= _round_trip_ns(self._readings[-1]):
                return
            self._readings.pop()
        self._readings.append(reading)
        while self._readings[0].host_after_ns < reading.host_after_ns - self._window_ns:
            self._readings.popleft()
        while (lines := lines_between(self._readings, DRIFT_LIMIT)) is None:
            self._readings.popleft()
        self._line = _mean_line(lines, reading)

    def add_arrival(self, device_time_ns: int, host_time_ns: int) -> None:
        """Add a frame's time on the device clock and its arrival on the host's monotonic clock, both [ns].

        They are used only while there is no clock reading. A device clock that ran backwards empties the
        window.
        """
        if self._readings:
            return
        if self._bins and device_time_ns < self._newest_device_ns:
            self._bins.clear()
            self._bin_start_ns = None
        self._newest_device_ns = device_time_ns
        point = _Point(device_time_ns, host_time_ns, 1e5)
        if self._bin_start_ns is None or device_time_ns - self._bin_start_ns >= BIN_NS:
            self._bin_start_ns = device_time_ns
            self._bins.append(point)
        elif point.host_ns - point.device_ns < self._bins[-1].host_ns - self._bins[-1].device_ns:
            self._bins[-1] = point
        elif self._line is not None:
            return
        while self._bins[0].device_ns < device_time_ns - self._window_ns:
            self._bins.popleft()
        # The bin being filled may not have seen its least delay yet: it counts only while it is the only one.
        self._line = _fit(list(self._bins)[:-1] or list(self._bins))

    def to_host(self, device_time_ns: int) -> int:
        """Host monotonic time [ns] of a device time [ns].

        Raises:
            ValueError: no reading and no arrival was added yet.
        """
        if self._line is None:
            raise ValueError("the device clock cannot be mapped before its first reading")
        return self._line.host_ns(device_time_ns)


def _round_trip_ns(reading: ClockReading) -> int:
    return reading.host_after_ns - reading.host_before_ns


def _mean_line(lines: LineBounds, newest: ClockReading) -> _Line:
    return _Line(newest.device_time_ns, newest.host_before_ns, lines.offset_ns, lines.rate, lines.covariance)


def _fit(points: list[_Point]) -> _Line:
    """Line by weighted least squares of host - device against device, with a prior of the drift.

    The prior, drift 0 with 1 sigma DRIFT_PRIOR_SD, enters as one more row.

    Args:
        points: at least one, oldest first.

    Returns:
        Line relative to the first point, with covariance.
    """
    device0, host0 = points[0].device_ns, points[0].host_ns
    x = np.array([point.device_ns - device0 for point in points], dtype=np.float64)
    y = np.array(
        [(point.host_ns - host0) - (point.device_ns - device0) for point in points], dtype=np.float64
    )
    weight = np.array([point.sd_ns**-2 for point in points])
    mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
    total = weight.sum()
    information = (weight * (x - mean_x) ** 2).sum() + DRIFT_PRIOR_SD**-2
    rate = float((weight * (x - mean_x) * (y - mean_y)).sum() / information)
    var_rate, var_mean = float(1.0 / information), float(1.0 / total)
    return _Line(
        device0_ns=device0,
        host0_ns=host0,
        offset_ns=float(mean_y - rate * mean_x),
        rate=rate,
        covariance=(var_mean + mean_x**2 * var_rate, -float(mean_x) * var_rate, var_rate),
    )
