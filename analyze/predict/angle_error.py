"""Error of a simulated motion against the video, as an angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.types import Array


@dataclass(frozen=True)
class AngleError:
    """Error of a simulated tipping angle or attitude over the frames compared."""

    rms: float
    """root mean square [rad]"""
    largest: float
    """largest size [rad]"""

    @staticmethod
    def of(off: Array) -> AngleError:
        """Error from the differences (n,) [rad] of simulated and measured angle."""
        return AngleError(float(np.sqrt(np.mean(off**2))), float(np.max(np.abs(off))))
