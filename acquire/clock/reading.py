"""One reading of a device clock."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ClockReading:
    """One reading of the device clock, between two readings of the host's monotonic clock."""

    device_time_ns: int
    host_before_ns: int
    host_after_ns: int
