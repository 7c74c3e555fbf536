"""One reading of the servo, and the units in which its registers count angle, velocity and current.

An arm angle is 0 at the impact point, where the arm hangs, and positive towards the object.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

TICK_RAD = 2 * math.pi / 4096
"""unit of the position registers [rad]"""
VELOCITY_UNIT_RAD_S = 0.229 * 2 * math.pi / 60
ACCELERATION_UNIT_RAD_S2 = 214.577 * 2 * math.pi / 3600
TICK_WRAP = 32768
"""value at which Realtime Tick starts again from 0"""


@dataclass(frozen=True, slots=True)
class Sample:
    """One reading of the servo: arm angle [rad], angular velocity [rad/s], current [A], its clock [ms].

    The angle is 0 at the impact point, positive towards the object. Host monotonic times [ns] before and
    after the reading are included.
    """

    host_before_ns: int
    """host monotonic time before the request was sent [ns]"""
    host_after_ns: int
    """host monotonic time after the answer arrived [ns]"""
    tick_ms: int
    """the servo's clock [ms], register Realtime Tick: wraps at 32768"""
    position_rad: float
    """arm angle [rad]"""
    velocity_rad_s: float
    """angular velocity of the arm [rad/s], as the servo filters it"""
    current_a: float
    """motor current [A]; positive drives the arm towards the object"""

    @property
    def time_ns(self) -> int:
        """Host monotonic time [ns] at the middle of the reading."""
        return (self.host_before_ns + self.host_after_ns) // 2
