"""Recognises columns of frame times and frame numbers by their names, with the unit that a name states."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

MIN_INTERVAL_S, MAX_INTERVAL_S = 1e-5, 0.5
"""bounds of the interval between two frames [s]: no camera is faster, and a slower one misses the tip"""
UNITS_S = {"s": "1", "ms": "1e-3", "us": "1e-6", "ns": "1e-9"}
"""units of a column of times, as decimal numbers of seconds"""
COLUMNS_TEXT = (
    "a header with a column of times, as time_s, time_ms, timestamp_us or timestamp_ns, and for images name"
)
_UNIT_NAMES = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "millis", "millisecond", "milliseconds"),
    "us": ("us", "usec", "micros", "microsecond", "microseconds"),
    "ns": ("ns", "nsec", "nanos", "nanosecond", "nanoseconds"),
}
_UNIT_OF = {name: unit for unit, names in _UNIT_NAMES.items() for name in names}
_DEVICE_TIMES = (
    "time",
    "mid_exposure_time",
    "mid_exposure",
    "device_time",
    "device_timestamp",
    "camera_time",
    "camera_timestamp",
    "sensor_time",
    "sensor_timestamp",
    "hardware_timestamp",
    "hw_timestamp",
    "trigger_time",
    "capture_time",
    "frame_time",
    "frame_timestamp",
    "timestamp",
    "time_stamp",
    "relative_time",
    "elapsed_time",
    "t",
    "pts",
    "pts_time",
)
"""names of columns with the camera's times, without unit, from the most to the least preferred"""
_HOST_TIMES = (
    "host_time",
    "host_timestamp",
    "system_time",
    "system_timestamp",
    "arrival_time",
    "received_time",
)
"""names of columns with the times at which frames arrived at the computer"""
_FRAMES = (
    "frame",
    "frame_number",
    "frame_no",
    "frame_id",
    "frame_index",
    "index",
    "number",
    "sequence",
    "block_id",
)


class TimeColumn(NamedTuple):
    """A column of frame times: its name and place in the table, and the unit that its name states."""

    name: str
    """name as in the table"""
    place: int
    """place among the table's columns, from 0"""
    unit: str | None
    """unit that its name states: s, ms, us or ns; None if it states none"""
    by_host: bool
    """True for times of arrival at the computer, False for times of the camera"""

    @property
    def base(self) -> str:
        """Name without its unit."""
        return _split(self.name)[0]


def time_columns(header: Sequence[str]) -> list[TimeColumn]:
    """Columns of frame times in a table's header, the most preferred first: the camera's, then the host's."""
    found: list[tuple[int, TimeColumn]] = []
    order = (*_DEVICE_TIMES, *_HOST_TIMES)
    for place, name in enumerate(header):
        base, unit = _split(name)
        if base in order:
            found.append((order.index(base), TimeColumn(name, place, unit, base in _HOST_TIMES)))
    return [column for _, column in sorted(found)]


def column_of_frames(header: Sequence[str]) -> int | None:
    """Place (from 0) of the column of frame numbers in a table's header; None if it has none."""
    names = [_plain(name) for name in header]
    return next((names.index(name) for name in _FRAMES if name in names), None)


def plausible_units(interval: float) -> list[str]:
    """Units in which an interval between frames is within `MIN_INTERVAL_S` to `MAX_INTERVAL_S`."""
    return [
        unit for unit, scale in UNITS_S.items() if MIN_INTERVAL_S < interval * float(scale) < MAX_INTERVAL_S
    ]


def _plain(name: str) -> str:
    """Column name in lower case, words joined by single underscores: "Time [ms]" as time_ms."""
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.strip())  # frameId
    return re.sub(r"[^a-z0-9]+", "_", re.sub("[µμ]", "u", name).lower()).strip("_")


def _split(name: str) -> tuple[str, str | None]:
    """Base of a column's name and the unit (s, ms, us, ns) that follows it; None for no unit."""
    plain = _plain(name)
    base, _, last = plain.rpartition("_")
    return (base, _UNIT_OF[last]) if base and last in _UNIT_OF else (plain, None)
