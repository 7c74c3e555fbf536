"""One reading of a device clock, bounded by two readings of the host clock."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ClockReading:
    """One reading of the device clock, taken between two readings of the host's monotonic clock."""

    device_time_ns: int
    """device clock [ns]"""
    host_before_ns: int
    """host monotonic clock before the device clock was read [ns]"""
    host_after_ns: int
    """host monotonic clock after the device clock was read [ns]"""
