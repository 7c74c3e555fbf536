"""Unwrapping of the servo's realtime tick (a 15-bit millisecond counter), published as clock samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquire.striker.sample import TICK_WRAP
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from acquire.striker.base import ClockSink
    from acquire.striker.sample import Sample

PERIOD_NS = 500_000_000
"""interval between published clock samples [ns]"""


class TickClock:
    """Continuous device time [ns] from the servo's tick, which counts 1 ms and wraps at 32768.

    It is published with the host's times around the reading; its mapping to host time is left to those
    who read the samples. At some time between `host_before_ns` and `host_after_ns` (host monotonic) the clock
    showed at least the published time and less than 1 ms more, which over 5 to 10 s determines the mapping to
    about 0.4 ms.

    Args:
        sink: called with each published clock sample (device time with the host times around it).
    """

    def __init__(self, sink: ClockSink) -> None:
        self._sink = sink
        self._ticks: int | None = None
        self._host_ns = 0
        self._sent_ns = 0
        self._offset = 0

    def restart(self) -> None:
        """Keep the servo's device time without a jump over a reboot, which sets its tick (counter) to 0.

        The next call of `observe` must have a sample of the rebooted servo.
        """
        if self._ticks is not None:
            self._offset = -1

    def observe(self, sample: Sample) -> None:
        """Update the count with the next sample of the servo; publish a ClockSample at most twice per second.

        The ClockSample holds the unwrapped tick [ns] and the host times before and after the reading.
        """
        if self._ticks is None:
            self._ticks = sample.tick_ms
        else:
            expected = self._ticks + (sample.time_ns - self._host_ns) // 1_000_000
            if self._offset < 0:
                self._offset = (expected - sample.tick_ms) % TICK_WRAP
            ahead = (sample.tick_ms + self._offset - expected + TICK_WRAP // 2) % TICK_WRAP - TICK_WRAP // 2
            self._ticks = expected + ahead
        self._host_ns = sample.time_ns
        if sample.time_ns - self._sent_ns >= PERIOD_NS:
            self._sent_ns = sample.time_ns
            self._sink(
                pb.ClockSample(
                    clock="striker",
                    device_time_ns=self._ticks * 1_000_000,
                    host_before_ns=sample.host_before_ns,
                    host_after_ns=sample.host_after_ns,
                )
            )
