"""Host time of events that a striker board timed with its own clock."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from acquire.clock.bounds import lines_between
from acquire.clock.reading import ClockReading
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Sequence

    from acquire.striker.base import ClockSink


WRAP_US = 1 << 32
"""microseconds after which a board's clock starts again from 0"""
RATE_LIMIT = 0.02
"""greatest relative error of a board's clock: that of a ceramic resonator is 0.005"""
RESOLUTION_NS = 10_000
"""resolution of a board's clock with margin [ns]: that of Arduino's `micros` at 16 MHz is 4 us"""
PERIOD_NS = 500_000_000
"""shortest interval between published clock samples [ns]"""


class BoardClock:
    """Continuous time of a board's clock [ns], which counts microseconds and wraps after 72 minutes.

    Read it at least once an hour.

    Args:
        sink: called with clock samples, at most twice a second.
    """

    def __init__(self, sink: ClockSink) -> None:
        self._sink = sink
        self._last: ClockReading | None = None
        self._offset_ns: int | None = None
        """continuous device time minus the board's clock [ns]; None: chosen at the next reading"""
        self._published_ns = 0

    def restart(self) -> None:
        """Continue the device time without a jump at the next reading: the board may have started anew."""
        self._offset_ns = None

    def observe(self, microseconds: int, before_ns: int, after_ns: int) -> ClockReading:
        """Reading with continuous device time; it is published if the last one was half a second ago.

        Args:
            microseconds: the board's clock [us].
            before_ns: host monotonic time before the request was sent [ns].
            after_ns: host monotonic time after the reply arrived [ns].
        """
        raw_ns = microseconds * 1000
        expected = raw_ns
        if self._last is not None:
            expected = self._last.device_time_ns + after_ns - self._last.host_after_ns
        if self._offset_ns is None:
            self._offset_ns = expected - raw_ns
        self._offset_ns += 1000 * WRAP_US * round((expected - raw_ns - self._offset_ns) / (1000 * WRAP_US))
        reading = ClockReading(raw_ns + self._offset_ns, before_ns, after_ns)
        self._last = reading
        if before_ns - self._published_ns >= PERIOD_NS:
            self._published_ns = before_ns
            self._sink(
                pb.ClockSample(
                    clock="striker",
                    device_time_ns=reading.device_time_ns,
                    host_before_ns=before_ns,
                    host_after_ns=after_ns,
                )
            )
        return reading

    def device_time_ns(self, microseconds: int) -> int:
        """Continuous device time [ns] of an event within 36 minutes of the last reading of the clock.

        Args:
            microseconds: the board's clock at the event [us].
        """
        assert self._last is not None  # noqa: S101 - the clock is read before every strike
        assert self._offset_ns is not None  # noqa: S101 - set by that reading
        last_us = (self._last.device_time_ns - self._offset_ns) // 1000
        ahead = (microseconds - last_us + WRAP_US // 2) % WRAP_US - WRAP_US // 2
        return self._last.device_time_ns + 1000 * ahead


def host_time(device_time_ns: int, readings: Sequence[ClockReading]) -> tuple[int, float] | None:
    """Host monotonic time of an event on the board's clock, and its standard deviation [ns].

    The board answers at some time between request and reply, so that each reading bounds the line from device
    to host time; the result is the mean over all lines within all bounds. With readings on both sides of the
    event the error is at most half the shortest round trip, whatever the clock's rate.

    Args:
        device_time_ns: continuous device time of the event [ns].
        readings: readings of the clock before the event, or before and after it; at least one.

    Returns:
        Time and standard deviation; None if no line satisfies all readings: the clock was reset, or its rate
        is wrong by more than RATE_LIMIT.
    """
    widened = [
        ClockReading(
            each.device_time_ns, each.host_before_ns - RESOLUTION_NS, each.host_after_ns + RESOLUTION_NS
        )
        for each in readings
    ]
    lines = lines_between(widened, RATE_LIMIT)
    if lines is None:
        return None
    newest = widened[-1]
    since = device_time_ns - newest.device_time_ns
    var_offset, cov, var_rate = lines.covariance
    variance = var_offset + 2 * cov * since + var_rate * since * since
    time_ns = newest.host_before_ns + since + round(lines.offset_ns + lines.rate * since)
    return time_ns, math.sqrt(max(variance, 0.0))
