"""Whether a plan is for the rig that is to carry it out: the striker's speeds and reach, and where the camera stands.

A plan made without `--rig` is for the nominal rig. What this striker cannot do is said before the first strike, not in the middle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from acquire.config import RigConfig
from schemas.rig_limits import TipSpeeds
from schemas.strike_plan import PlannedStrike, StrikePlan

CAMERA_MOVED_M, CAMERA_TURNED_RAD = 0.02, math.radians(2.0)
"""of the camera against the plan's, from which the tags may leave the image: either moves them by some 50 of its 656 pixels"""
MOST_NAMED = 4


@dataclass(frozen=True)
class RigLimits:
    """What a rig can be asked for."""

    speeds: TipSpeeds | None
    """m/s; None: a hand strikes, which has no limits of its own"""
    reach_m: tuple[float, float] | None
    """heights over the table; None likewise"""
    T_world_camera: list[list[float]]

    @classmethod
    def of(cls, config: RigConfig) -> RigLimits:
        """As the rig file has them."""
        striker, pose = config.striker, config.camera.calibration.T_world_camera
        by_hand = striker.kind == "manual"
        return cls(None if by_hand else striker.tip_speeds(), None if by_hand else striker.reach_m, pose)

    def as_dict(self) -> dict[str, Any]:
        """For the daemon's answer."""
        speeds = None if self.speeds is None else [self.speeds.slowest_m_s, self.speeds.fastest_m_s]
        return {"speeds_m_s": speeds, "reach_m": self.reach_m, "T_world_camera": self.T_world_camera}

    @classmethod
    def from_dict(cls, answer: Mapping[str, Any]) -> RigLimits:
        """From the daemon's answer."""
        speeds, reach = answer["speeds_m_s"], answer["reach_m"]
        return cls(
            None if speeds is None else TipSpeeds(*speeds), None if reach is None else (reach[0], reach[1]), answer["T_world_camera"]
        )


def beyond_striker(plan: StrikePlan, limits: RigLimits) -> str:
    """Which strikes may ask for more than the striker can, by any speed of their range, in words; empty where none does."""
    found: list[str] = []
    if limits.speeds is not None:
        speeds = limits.speeds
        wrong = [each for each in plan.strikes if not (speeds.allow(each.tip_speed_m_s.min) and speeds.allow(each.tip_speed_m_s.max))]
        if wrong:
            low, high = min(each.tip_speed_m_s.min for each in wrong), max(each.tip_speed_m_s.max for each in wrong)
            ask = f"{_named(wrong)} may ask for {low:.3g} to {high:.3g} m/s"
            found.append(f"{ask}, it swings at {speeds.slowest_m_s:.3g} to {speeds.fastest_m_s:.3g} m/s")
    if limits.reach_m is not None:
        lowest, highest = limits.reach_m
        wrong = [each for each in plan.strikes if not lowest <= each.impact_height_m <= highest]
        if wrong:
            heights = sorted(1000 * each.impact_height_m for each in wrong)
            at = f"{heights[0]:.0f}" if len(wrong) == 1 else f"{heights[0]:.0f} to {heights[-1]:.0f}"
            found.append(f"{_named(wrong)}: struck at {at} mm over the table, it reaches {1000 * lowest:.0f} to {1000 * highest:.0f} mm")
    return "; ".join(found)


def camera_elsewhere(plan: StrikePlan, limits: RigLimits) -> str:
    """How far the camera stands from where the plan has it, in words; empty where that is the same place."""
    planned, here = _in_station(plan.strikes[0]), limits.T_world_camera
    moved = math.dist([row[3] for row in planned[:3]], [row[3] for row in here[:3]])
    trace = sum(planned[i][j] * here[i][j] for i in range(3) for j in range(3))
    turned = math.acos(min(max((trace - 1) / 2, -1.0), 1.0))
    if moved <= CAMERA_MOVED_M and turned <= CAMERA_TURNED_RAD:
        return ""
    return f"the camera stands {1000 * moved:.0f} mm and {math.degrees(turned):.0f} deg off the plan's: tags may leave its image"


def _in_station(strike: PlannedStrike) -> list[list[float]]:
    """T_world_camera of a strike, turned back by its heading."""
    pose, cos, sin = strike.camera_pose, math.cos(strike.heading_rad), math.sin(strike.heading_rad)
    x, y = pose[0], pose[1]
    return [[cos * a - sin * b for a, b in zip(x, y, strict=True)], [sin * a + cos * b for a, b in zip(x, y, strict=True)], *pose[2:]]


def _named(strikes: Sequence[PlannedStrike]) -> str:
    more = f" and {len(strikes) - MOST_NAMED} more" if len(strikes) > MOST_NAMED else ""
    return ", ".join(each.id for each in strikes[:MOST_NAMED]) + more
