"""Contact of the striker's tip and push of a finger that are still in progress in the simulated world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections import deque

    import numpy as np
    from numpy.typing import NDArray


@dataclass
class OpenContact:
    """Contact of the striker's tip that has not ended: first and last touch [ns], impulse so far [N s].

    The times are world time (host monotonic).
    """

    first_ns: int
    """world time of first touch [ns]"""
    impulse: float
    """impulse so far [N s]"""
    position: NDArray[np.float64]
    """(3,) point of first contact in W [m]"""
    last_ns: int
    """world time at the end of the last time step with contact [ns]"""


@dataclass
class Push:
    """Push by a finger in progress: forces [N] still to be applied, its point, impulse and duration."""

    first_ns: int
    """world time of its start [ns]"""
    forces: deque[NDArray[np.float64]]
    """forces (3,) [N] of the remaining milliseconds"""
    p_object: NDArray[np.float64]
    """(3,) point of contact in O, the object's frame [m]"""
    position: NDArray[np.float64]
    """(3,) point of contact in W at the start [m]"""
    impulse: float
    """magnitude of the total impulse [N s]"""
    duration_s: float
    """requested duration [s]"""
