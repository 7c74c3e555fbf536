"""Capture times of a video's frames from a table (CSV), in place of its container's time stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analyze.errors import ImportRefused
from analyze.sources.frame_timing import time_sd_ns
from analyze.sources.times_columns import COLUMNS_TEXT
from analyze.sources.times_table import (
    TimesTable,
    checked_times_ns,
    is_times_table,
    read_times_table,
    refuse_repeated,
    usual_rate_hz,
)
from schemas.session_manifest import TimeSource
from schemas.wording import counted


@dataclass(frozen=True)
class ListedTiming:
    """Capture times of a video's frames by their place in the order of the container's time stamps.

    The stamps only give the order: the first frame has the table's first time, whatever its stamp.
    """

    stamps: NDArray[np.int64]
    """(n,) time stamps of all frames, increasing [steps]"""
    listed_ns: NDArray[np.int64]
    """(n,) capture times [ns] of these frames since the first, increasing"""
    interval_s: float
    """interval between two frames as captured [s]"""
    sd_ns: int
    """standard deviation of a frame's capture time [ns]"""
    time_source: TimeSource
    """clock of the times: the camera's, or the computer's at the frames' arrival"""
    slowed: Fraction = Fraction(1)
    """playing time over capture time: the table has times of capture"""

    @property
    def played_hz(self) -> float:
        """Frame rate of the table's times [Hz]."""
        return 1.0 / self.interval_s

    def time_ns(self, stamp: int) -> int:
        """Capture time [ns] since the first frame that belongs to a frame's time stamp [steps]."""
        return int(self.times_ns([stamp])[0])

    def times_ns(self, stamps: Sequence[int]) -> NDArray[np.int64]:
        """Capture times (n,) [ns] that belong to n frames' time stamps; 0 is the first frame's."""
        places = np.searchsorted(self.stamps, np.asarray(stamps, dtype=np.int64))
        return self.listed_ns[np.minimum(places, len(self.stamps) - 1)]

    def stamp(self, time_ns: int) -> int:
        """Time stamp of the last frame that was captured at a time [ns] since the first, or before it."""
        place = int(np.searchsorted(self.listed_ns, time_ns, side="right")) - 1
        return int(self.stamps[max(place, 0)])


def listed_timing(table: TimesTable, stamps: Sequence[int], video: str) -> ListedTiming:
    """Capture times of a video's frames from a table with a row for each.

    Rows belong to frames in their order, or in that of the frame numbers if the table has them; numbers that
    are left out are frames that the camera lost, so that the video does not have them either.

    Args:
        table: the table.
        stamps: (n,) time stamps of all frames of the video, all different, in any order [steps].
        video: name of the video, for messages.

    Raises:
        ImportRefused: the table has more or fewer rows than the video has frames, numbers a frame twice, or
            its times do not increase.
    """
    rows, path = table.rows, table.path
    numbers = [row.frame for row in rows if row.frame is not None]
    if numbers:
        refuse_repeated(path, [f"frame {number}" for number in numbers])
        rows = sorted(rows, key=lambda row: row.frame or 0)
    if len(rows) != len(stamps):
        raise ImportRefused(
            f"{path}: has {counted(len(rows), 'row')}, but {video} has {counted(len(stamps), 'frame')}: give "
            "the table that was written with it, with a row for each frame in the video"
        )
    times = checked_times_ns(path, rows, "frame")
    by_host = table.column.by_host
    return ListedTiming(
        np.sort(np.asarray(stamps, dtype=np.int64)),
        np.asarray(times, dtype=np.int64),
        1.0 / usual_rate_hz(times),
        max(table.sd_ns, time_sd_ns(times)) if by_host else table.sd_ns,
        TimeSource.HOST_ARRIVAL if by_host else TimeSource.CONTAINER_PTS,
    )


def read_listed_timing(
    path: Path, stamps: Sequence[int], video: str, rate_hz: float | None
) -> tuple[ListedTiming, str | None]:
    """Read a video's capture times from a table; and what was assumed in reading it, None for nothing.

    Args:
        path: the table.
        stamps: (n,) time stamps of all frames of the video, all different, in any order [steps].
        video: name of the video, for messages.
        rate_hz: frame rate that the video itself states [Hz]; None if unknown.

    Raises:
        ImportRefused: the table cannot be read, or is not of this video.
    """
    table = read_times_table(path, "frame", rate_hz)
    return listed_timing(table, stamps, video), table.remark


def table_beside(video: Path) -> tuple[Path | None, str | None]:
    """Table of times beside a video by its name (`clip.csv` beside `clip.mp4`); and a remark on another CSV.

    Both are None if there is no such file; a CSV without a column of times is not used, with a remark.
    """
    beside = video.with_suffix(".csv")
    if beside == video or not beside.is_file():
        return None, None
    if is_times_table(beside):
        return beside, None
    why = f"{beside.name} beside it is not used, as it has no column of times: it needs {COLUMNS_TEXT}"
    return None, f"{video.name}: {why}"
