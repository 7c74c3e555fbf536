"""Motion of a free body: poses of its object frame O in world frame W over time, and differences.

Integrals over a motion are computed as sums over the differences between neighbouring times. Summation by
parts is exact for such sums, so that equations in weak form, which are integrated by parts, hold exactly for
the sampled motion too.
"""

# scipy is only partly typed.
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
    """Poses of a body, that is of its object frame O in the world frame W, at n >= 2 times."""

    time: Array
    """(n,) time [s], ascending"""
    position: Array
    """(n, 3) O's origin in W [m]"""
    R_world_object: Array
    """(n, 3, 3) rotation from O to W"""

    def __len__(self) -> int:
        return len(self.time)

    def part(self, start: int, stop: int) -> BodyMotion:
        """Motion that consists of the poses with indices [start, stop) only."""
        return BodyMotion(self.time[start:stop], self.position[start:stop], self.R_world_object[start:stop])

    @cached_property
    def dt(self) -> Array:
        """Differences (n - 1,) between neighbouring times [s]."""
        return np.diff(self.time)

    @cached_property
    def angular_velocity(self) -> Array:
        """Mean angular velocity (n - 1, 3) between neighbouring times, in the object frame O [rad/s]."""
        return self._turns.as_rotvec() / self.dt[:, None]

    @cached_property
    def halfway(self) -> Array:
        """Rotations (n - 1, 3, 3) from object frame O to world W, halfway between neighbouring times."""
        half = Rotation.from_rotvec(0.5 * self._turns.as_rotvec()).as_matrix()
        return self.R_world_object[:-1] @ half

    @cached_property
    def _turns(self) -> Rotation:
        """Rotation (scipy, n - 1 of them) from each pose to the next, in the object frame O."""
        return Rotation.from_matrix(self.R_world_object[:-1].transpose(0, 2, 1) @ self.R_world_object[1:])

    def path_of(self, point: Array) -> Array:
        """Positions (n, 3) in the world frame W [m] of a body point (3,) given in the object frame O [m]."""
        return self.position + self.R_world_object @ point


def trapezoid_weights(time: Array) -> Array:
    """Weights (n,) [s] of the trapezoidal rule for values at times (n,) [s], ascending."""
    gaps = np.diff(time)
    return 0.5 * (np.append(gaps, 0.0) + np.insert(gaps, 0, 0.0))
