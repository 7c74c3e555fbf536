"""Log times of the first and last image of a strike or toss that an import writes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analyze.importing.windows import StrikeWindow
from analyze.reading.time_range import index_range


@dataclass
class LogTimes:
    """Log times [ns] of the first and the last image of a strike."""

    first_ns: int | None = None
    """earliest log time [ns]; None without images"""
    last_ns: int = 0
    """latest log time [ns]; 0 without images"""

    def add_range(self, at_ns: int, times_ns: NDArray[np.int64], window: StrikeWindow) -> None:
        """Extend first and last log time to the images of a source that lie in a strike's window.

        Args:
            at_ns: log time of the source's start [ns].
            times_ns: (n,) times of the images since the source's start [ns], increasing.
            window: the strike's window (start and end [ns]) since the source's start.
        """
        first, last = index_range(times_ns, window.start_ns, window.end_ns)
        if first < last:
            self.add(at_ns + int(times_ns[first]))
            self.add(at_ns + int(times_ns[last - 1]))

    def add(self, log_time_ns: int) -> None:
        """Extend first and last log time, if needed, to include that of one more image [ns]."""
        self.first_ns = log_time_ns if self.first_ns is None else min(self.first_ns, log_time_ns)
        self.last_ns = max(self.last_ns, log_time_ns)
