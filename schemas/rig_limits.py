"""Limits of a rig that planning and `acquire check` share: no plan exceeds what the rig allows."""

from __future__ import annotations

import math
from dataclasses import dataclass

MIN_ARM_SPEED_RAD_S = 0.5
"""Lowest angular speed of the arm [rad/s]: below it the servo's steps are visible."""
RUN_UP_S = 0.06
"""Time until the servo follows its speed profile within 1 % [s].

The fastest strike accelerates over the whole angle from the cocked position.
"""
ARM_LENGTH_M, COCKED_ANGLE_RAD, VELOCITY_LIMIT_RAD_S = 0.12, -0.6, 8.0
"""Arm length [m], cocked (raised) angle [rad] and speed limit [rad/s] of the nominal striker."""
TABLE_FAR_EDGE_M = 0.55
"""Distance of the table's far edge behind the pivot line [m], unless the rig file gives one."""
MIN_TAG_EDGE_PX = 30.0
"""Smallest mean edge of a tag's black square in the image [px]; narrower tags are lost in some frames."""
GOOD_TAG_EDGE_PX = 60.0
"""Mean edge of a tag's black square in the image [px] below which the angle's noise is noticeable: it
grows as 1/edge², from 0.010 deg a frame at 60 px to 0.036 deg at 30 px (`make bench-tags`)."""


@dataclass(frozen=True)
class TipSpeeds:
    """Range of speeds that the tip of the striker's arm can reach [m/s], both ends included."""

    slowest_m_s: float
    fastest_m_s: float

    def allow(self, tip_speed_m_s: float) -> bool:
        """True if the tip speed [m/s] is in the range, ends included; False for NaN."""
        return self.slowest_m_s <= tip_speed_m_s <= self.fastest_m_s

    def problem(self, tip_speed_m_s: float) -> str:
        """Text on a tip speed [m/s] that is not in the range; empty if it is."""
        if self.allow(tip_speed_m_s):
            return ""
        limits = f"{self.slowest_m_s:.3g} to {self.fastest_m_s:.3g} m/s"
        return f"a tip speed of {tip_speed_m_s:.3g} m/s is outside {limits}"


def tip_speeds(
    arm_length_m: float = ARM_LENGTH_M,
    cocked_angle_rad: float = COCKED_ANGLE_RAD,
    velocity_limit_rad_s: float = VELOCITY_LIMIT_RAD_S,
    acceleration_rad_s2: float = math.inf,
) -> TipSpeeds:
    """Range of tip speeds of an arm that swings from `cocked_angle_rad` to 0, where it hits.

    The slowest is MIN_ARM_SPEED_RAD_S times the arm's length. The fastest is the arm's length times the
    smallest of three angular speeds: the limit, the size of the cocked (raised) angle over RUN_UP_S, and what
    the acceleration reaches over that angle. If no speed is possible, the slowest is above the fastest.

    Args:
        arm_length_m: distance from the servo's axis to the tip [m].
        cocked_angle_rad: angle from which the arm is released [rad]; it hangs vertically at 0.
        velocity_limit_rad_s: largest angular speed of the arm [rad/s].
        acceleration_rad_s2: angular acceleration of the arm in a swing [rad/s2].
    """
    accelerated = math.sqrt(2 * acceleration_rad_s2 * abs(cocked_angle_rad))
    fastest_rad_s = min(velocity_limit_rad_s, abs(cocked_angle_rad) / RUN_UP_S, accelerated)
    return TipSpeeds(MIN_ARM_SPEED_RAD_S * arm_length_m, fastest_rad_s * arm_length_m)
