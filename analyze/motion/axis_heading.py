"""Direction of the line about which a body turns, measured against the planned pivot line.

A body that stands with both ends of a straight edge on the table cannot roll aside: all its rotation is about
that edge. If it turns by theta about the planned line and by r about the horizontal axis across it, then it
turns about a line on the table at the angle atan(r / theta) to the planned one. Balance angle and rate belong
to that line.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.strike_task import Judgement
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from analyze.motion.tip_angle import PlanarMotion

MOST_ASKEW_RAD = math.radians(8.0)
"""largest angle [rad] between the planned line and that about which the body turns

Of 17 strikes on scans at 6 to 8 deg most equi-planes passed c within 0.35 mm; of 6 beyond, by 1.6 to 4.2 mm.
"""
CLEAR_SIGMAS = 3.0
"""number of standard deviations beyond which chance is excluded"""
_MIN_THETA = math.radians(1.0)
"""least tipping angle [rad] of a frame that shows the direction"""


def measure_heading(motion: PlanarMotion, window: tuple[int, int]) -> tuple[float, float] | None:
    """Ratio of roll to theta and its sd [-]: the tangent of the angle between measured and planned line.

    Args:
        motion: the motion with its roll.
        window: frames [start, stop) of the fit.

    Returns:
        None if the roll is unknown, or no frame has tipped by a degree.
    """
    if motion.roll is None or motion.roll_sd is None:
        return None
    used = np.arange(*window)[motion.angle.theta[slice(*window)] > _MIN_THETA]
    if not len(used):
        return None
    theta, sd = motion.angle.theta[used], np.maximum(motion.roll_sd[used], 1e-7)
    weight = float(np.sum((theta / sd) ** 2))
    return float(np.sum(theta * motion.roll[used] / sd**2)) / weight, 1.0 / math.sqrt(weight)


def judge_heading(motion: PlanarMotion, window: tuple[int, int], rolls: bool) -> Judgement | None:
    """Verdict "wrong edge" on a body that turned about a line clearly askew of the planned edge, else None.

    On a round rim the line of contact has no fixed direction: None.

    Args:
        motion: the motion with its roll.
        window: frames [start, stop) of the fit.
        rolls: True if the edge is a round rim.
    """
    measured = None if rolls else measure_heading(motion, window)
    if measured is None:
        return None
    ratio, sd = measured
    if abs(ratio) < max(math.tan(MOST_ASKEW_RAD), CLEAR_SIGMAS * sd):
        return None
    askew = math.degrees(math.atan(abs(ratio)))
    text = f"turned over a line {askew:.0f} deg askew of the planned edge"
    return Judgement(Verdict.WRONG_EDGE, f"{text}: put it square to the striker, or leave it out")
