"""Time ranges of messages and images: both ends belong to a range, None stands for no limit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def is_within(time_ns: int, start_ns: int | None, end_ns: int | None) -> bool:
    """True if a time is in the range from `start_ns` to `end_ns` [ns], both included; None: no limit."""
    return (start_ns is None or time_ns >= start_ns) and (end_ns is None or time_ns <= end_ns)


def index_range(times_ns: NDArray[np.int64], start_ns: int | None, end_ns: int | None) -> tuple[int, int]:
    """Index of the first time in a range, and one past the index of the last; equal for an empty range.

    Args:
        times_ns: (n,) times [ns], sorted.
        start_ns: start of the range, included; None for no limit.
        end_ns: end of the range, included; None for no limit.
    """
    first = 0 if start_ns is None else int(np.searchsorted(times_ns, start_ns, "left"))
    last = len(times_ns) if end_ns is None else int(np.searchsorted(times_ns, end_ns, "right"))
    return first, last
