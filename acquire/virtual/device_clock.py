"""Clock of the virtual camera: it runs at a rate of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from acquire.clock.clock import Clock

DRIFT = 37e-6
"""default relative rate error of the camera's clock"""
CLOCK_OFFSET_NS = 5_000_000_000
"""default time of the camera's own clock at its construction [ns]"""


class DeviceClock:
    """Clock of the virtual camera: offset and constant rate error against the host's monotonic clock.

    Does not model temperature.

    Args:
        clock: the host's clock.
        drift: relative rate error against the host's clock.
        offset_ns: time of the virtual camera's clock at construction [ns].
    """

    def __init__(self, clock: Clock, drift: float = DRIFT, offset_ns: int = CLOCK_OFFSET_NS) -> None:
        self._clock, self._drift, self._offset_ns = clock, drift, offset_ns
        self._host0_ns = clock.monotonic_ns()

    def now_ns(self) -> int:
        """Time now on the virtual camera's clock [ns]."""
        return self.to_device(self._clock.monotonic_ns())

    def to_device(self, host_ns: int) -> int:
        """Time on the virtual camera's clock [ns] at a host monotonic time [ns]."""
        elapsed = host_ns - self._host0_ns
        return self._offset_ns + elapsed + round(elapsed * self._drift)

    def to_host(self, device_ns: int) -> int:
        """Host monotonic time [ns] at a time on the virtual camera's clock [ns]; inverse of `to_device`."""
        elapsed = device_ns - self._offset_ns
        return self._host0_ns + elapsed - round(elapsed * self._drift / (1.0 + self._drift))
