"""Host clock, passed in wherever time is read, and the mapping of a device's clock to the host clock."""

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

        Used only for the wall anchor: log time (Unix time in a recording) minus monotonic time.
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
    """Line from device time to host time, with its terms counted from an origin (device0, host0).

    host = host0 + (device - device0) + offset + rate * (device - device0), all times in ns. The rate is the
    host clock's against the device clock's, minus 1. Only offset and rate, both small, are floating point.
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

    Each `ClockReading` is a reading of the device clock between two readings of the host clock. Whatever the
    delays, the device was read between the two host times (Cristian 1989, "Probabilistic clock
    synchronization"). All straight lines, device time to host time, that satisfy every reading (Marzullo
    1984) are a convex polygon in the plane of offset and drift. None of them is more probable than another:
    the mapping is their mean, its uncertainty their spread. A slow machine or a delay in one direction makes
    the polygon larger, never wrong. A uniform distribution over a polygon, projected on any
    axis, ends within 2.83 sd of its mean (at the tip of a triangle): **while the drift is steady, the error
    is below 3 sd, always.** Where no line fits, the drift was not steady (the device warmed up, the host
    clock was slewed) and the oldest readings are discarded.

    Where the device cannot latch its clock (store it on a command, to be read later), `add_arrival` takes the
    arrival times of frames instead. In each bin of BIN_NS (0.5 s) only the frame of the least delay counts,
    because queues only add delay; the mapped times are late by the constant least delay. As soon as there are
    clock readings, only they are used.

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
        """True if the mapping uses clock readings; False: frame arrivals only, or nothing yet."""
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
        """Least time [ns] between the two host times of a clock reading in use; 0 if there is none."""
        return min((_round_trip_ns(reading) for reading in self._readings), default=0)

    def sd_at(self, device_time_ns: int) -> int:
        """1 sigma [ns] of the host time that `to_host` gives for a device time [ns].

        It grows with the time since the last clock reading or frame arrival, and is at least
        MAPPING_SD_FLOOR_NS; 0 before the first one.
        """
        return 0 if self._line is None else round(max(MAPPING_SD_FLOOR_NS, self._line.sd_ns(device_time_ns)))

    def add(self, reading: ClockReading) -> None:
        """Add a reading of the device clock and update the mapping.

        If the device clock ran backwards (the device restarted), all earlier readings are discarded. Of
        readings within BURST_NS (20 ms) only the quickest is kept: the least time between its two host times.
        Readings older than the window are discarded, then the oldest ones until a straight line, device time
        to host time, satisfies all that are left.
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

        The pair is used only while there is no clock reading. If the device clock ran backwards (the device
        restarted), all earlier pairs are discarded.
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
        """Host monotonic time [ns] at which the device clock showed `device_time_ns` [ns].

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
    """Fit the line host time over device time to frames' arrivals, by weighted least squares.

    The line's rate is the drift, host time gained per device time. Its prior, 0 with 1 sigma DRIFT_PRIOR_SD,
    enters as one more observation.

    Args:
        points: pairs of device and host time [ns], with the host time's sd; at least one, oldest first.

    Returns:
        The line with the first point as its origin: offset [ns], rate (no unit), and their covariance
        (var(offset) [ns^2], cov [ns], var(rate)).
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
