"""Check of a plan against the rig at hand: the striker's speeds and reach, and the camera's position.

A plan made without `--rig` is for the nominal rig. The check is made before the first strike, so that no
session ends in the middle because the striker cannot reach a speed or a height.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from acquire.config import RigLimits
from schemas.servo_models import SERVO_MODELS
from schemas.strike_plan import PlannedStrike, StrikePlan

MAX_CAMERA_SHIFT_M, MAX_CAMERA_TURN_RAD = 0.02, math.radians(2.0)
"""differences [m], [rad] from the plan's camera pose above which tags may leave the image: each shifts them
by some 50 of 656 pixels"""
STRONG_N_M = 1.0
"""stall torque of servos that swing any usual arm as fast as they turn [N m]"""
MAX_STRIKES_NAMED = 4
"""largest number of strikes that a message lists by id"""


def striker_limit_problem(plan: StrikePlan, limits: RigLimits) -> str:
    """Text that names planned strikes which the rig's striker cannot make, and the limits they exceed.

    A strike exceeds a limit if one of its speeds of the arm's tip [m/s] or the height of its impact point [m]
    is outside `limits`. The text is "" if there is no such strike, or if a person strikes by hand.
    """
    return "; ".join(text for text in (_speed_problem(plan, limits), _reach_problem(plan, limits)) if text)


def _speed_problem(plan: StrikePlan, limits: RigLimits) -> str:
    if limits.speeds is None:
        return ""
    allow = limits.speeds.allow
    wrong = [
        each
        for each in plan.strikes
        if not (allow(each.aim.tip_speed_m_s.min) and allow(each.aim.tip_speed_m_s.max))
    ]
    if not wrong:
        return ""
    low, high = (
        min(each.aim.tip_speed_m_s.min for each in wrong),
        max(each.aim.tip_speed_m_s.max for each in wrong),
    )
    slowest, fastest = limits.speeds.slowest_m_s, limits.speeds.fastest_m_s
    needed = f"{_strike_ids(wrong)} may need {low:.3g} to {high:.3g} m/s"
    more = _faster_striker(high, fastest, limits.arm_length_m) if high > fastest else ""
    return f"{needed}, the striker swings at {slowest:.3g} to {fastest:.3g} m/s{more}"


def _faster_striker(needed_m_s: float, fastest_m_s: float, arm_length_m: float | None) -> str:
    """Arm and strong servos that reach a tip speed which this striker does not, in words; "" without one."""
    if arm_length_m is None:
        return ""
    longer_mm = math.ceil(1000 * arm_length_m * needed_m_s / fastest_m_s)
    models = [
        name
        for name, each in SERVO_MODELS.items()
        if each.no_load_rad_s * arm_length_m >= needed_m_s and each.stall_torque_n_m >= STRONG_N_M
    ]
    other = f", or an {' or '.join(models)}" if models else ""
    return f" (an arm of {longer_mm} mm{other} would do)"


def _reach_problem(plan: StrikePlan, limits: RigLimits) -> str:
    if limits.reach_m is None:
        return ""
    lowest, highest = limits.reach_m
    wrong = [each for each in plan.strikes if not lowest <= each.aim.impact_height_m <= highest]
    if not wrong:
        return ""
    heights = sorted(1000 * each.aim.impact_height_m for each in wrong)
    needed = f"{heights[0]:.0f}" if len(wrong) == 1 else f"{heights[0]:.0f} to {heights[-1]:.0f}"
    reach = f"the striker reaches {1000 * lowest:.0f} to {1000 * highest:.0f} mm"
    return f"{_strike_ids(wrong)}: impact point {needed} mm over the table, {reach}"


def camera_pose_problem(plan: StrikePlan, limits: RigLimits) -> str:
    """Text with distance and rotation between the rig's camera pose and the plan's; "" if small.

    The limits are MAX_CAMERA_SHIFT_M and MAX_CAMERA_TURN_RAD. The plan's pose is that of its first strike; a
    plan of tosses alone has none.
    """
    if not plan.strikes:
        return ""
    planned, here = _station_camera_pose(plan.strikes[0]), limits.T_world_camera
    moved = math.dist([row[3] for row in planned[:3]], [row[3] for row in here[:3]])
    trace = sum(planned[i][j] * here[i][j] for i in range(3) for j in range(3))
    turned = math.acos(min(max((trace - 1) / 2, -1.0), 1.0))
    if moved <= MAX_CAMERA_SHIFT_M and turned <= MAX_CAMERA_TURN_RAD:
        return ""
    difference = f"{1000 * moved:.0f} mm and {math.degrees(turned):.0f} deg"
    return f"the camera stands {difference} off the plan's position: tags may leave its image"


def _station_camera_pose(strike: PlannedStrike) -> list[list[float]]:
    """Camera pose T_world_camera (4, 4) [m] that a planned strike expects, in the world frame W.

    The plan states the pose in W turned about the vertical by the strike's heading (direction in which object
    and striker face). That rotation is undone here.
    """
    pose, cos, sin = strike.camera_pose, math.cos(strike.heading_rad), math.sin(strike.heading_rad)
    x, y = pose[0], pose[1]
    turned_x = [cos * a - sin * b for a, b in zip(x, y, strict=True)]
    turned_y = [sin * a + cos * b for a, b in zip(x, y, strict=True)]
    return [turned_x, turned_y, *pose[2:]]


def _strike_ids(strikes: Sequence[PlannedStrike]) -> str:
    more = f" and {len(strikes) - MAX_STRIKES_NAMED} more" if len(strikes) > MAX_STRIKES_NAMED else ""
    return ", ".join(each.id for each in strikes[:MAX_STRIKES_NAMED]) + more
