"""A free body through time: where its frame O lies in W, and the differences of that from one time to the next.

All integrals over a motion are taken on these differences: a sum of differences, summed by parts, loses nothing at the ends, so that
weak forms hold for the discrete motion as they do for the continuous one.
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from analyze.types import Array


@dataclass(frozen=True)
class BodyMotion:
    """Poses at n >= 2 times."""

    time: Array
    """(n,) s, ascending"""
    position: Array
    """(n, 3) m, of O's origin in W"""
    R_world_object: Array
    """(n, 3, 3)"""

    def __len__(self) -> int:
        return len(self.time)

    def part(self, start: int, stop: int) -> BodyMotion:
        """Poses start..stop-1."""
        return BodyMotion(self.time[start:stop], self.position[start:stop], self.R_world_object[start:stop])

    @cached_property
    def dt(self) -> Array:
        """(n - 1,) s."""
        return np.diff(self.time)

    @cached_property
    def angular_velocity(self) -> Array:
        """(n - 1, 3) rad/s between the times, in O."""
        return self._turns.as_rotvec() / self.dt[:, None]

    @cached_property
    def halfway(self) -> Array:
        """(n - 1, 3, 3) R_world_object halfway between the times."""
        half = Rotation.from_rotvec(0.5 * self._turns.as_rotvec()).as_matrix()
        return self.R_world_object[:-1] @ half

    @cached_property
    def _turns(self) -> Rotation:
        return Rotation.from_matrix(self.R_world_object[:-1].transpose(0, 2, 1) @ self.R_world_object[1:])

    def path_of(self, point: Array) -> Array:
        """(n, 3) m in W, of a point (3,) of the body in O."""
        return self.position + self.R_world_object @ point


def trapezoid_weights(time: Array) -> Array:
    """(n,) s: a sum with these weights is the integral by the trapezoidal rule."""
    gaps = np.diff(time)
    return 0.5 * (np.append(gaps, 0.0) + np.insert(gaps, 0, 0.0))
