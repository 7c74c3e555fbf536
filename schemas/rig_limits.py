"""What both commands hold a rig to, so that no plan asks for what the striker or `acquire check` then refuses."""

from __future__ import annotations

from dataclasses import dataclass

SLOWEST_RAD_S = 0.5
"""of the arm: slower, the servo's steps show"""
RUN_UP_S = 0.06
"""the servo follows its profile within 1 % after this; at full speed the arm needs the way from the cocked angle for it"""
ARM_LENGTH_M, COCKED_ANGLE_RAD, VELOCITY_LIMIT_RAD_S = 0.12, -0.6, 8.0
"""of the nominal striker"""
SMALLEST_TAG_PX = 60.0
"""mean edge of the black square in the image; at 80 px a tag gives 0.07 deg a frame, and the noise grows with the inverse square"""


@dataclass(frozen=True)
class TipSpeeds:
    """What the striker's tip can be asked for [m/s], both ends allowed."""

    slowest_m_s: float
    fastest_m_s: float

    def allow(self, tip_speed_m_s: float) -> bool:
        """Whether the striker takes it; never one that is no number."""
        return self.slowest_m_s <= tip_speed_m_s <= self.fastest_m_s


def tip_speeds(
    arm_length_m: float = ARM_LENGTH_M,
    cocked_angle_rad: float = COCKED_ANGLE_RAD,
    velocity_limit_rad_s: float = VELOCITY_LIMIT_RAD_S,
) -> TipSpeeds:
    """Of an arm that swings from `cocked_angle_rad` to 0: its speed limit, or what it can run up to on the way.

    Where the two leave nothing, the slowest is above the fastest.
    """
    fastest_rad_s = min(velocity_limit_rad_s, abs(cocked_angle_rad) / RUN_UP_S)
    return TipSpeeds(SLOWEST_RAD_S * arm_length_m, fastest_rad_s * arm_length_m)
