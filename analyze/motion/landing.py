"""Landing angle from the object's shape: tipping angle at which its next face reaches the table.

A box lands on a side at 90 deg and stops, which shows in the tipping angle theta(t). A bottle that lies on
its side lands on a chamfer at 45 deg, which hardly slows it; from there on it turns about the chamfer's other
edge, with another balance angle phi and another k.

Turned by theta about the pivot p, at the height of its rounding's radius, the body would penetrate the table
by height(theta) - radius, where height is the support function: the height that p needs for the lowest point
to touch. A face at angle a to the table that reaches a distance L ahead of p penetrates by L sin(theta - a).
A face counts only if it penetrates deeper than the error of the surface: neither a scan's facets nor a narrow
bevel carry the body.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.rolling_choice import rolls_until

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from schemas.strike_plan import PlannedStrike

_MIN_DEPTH_M = 5e-4
"""least penetration [m] of a face that carries the body"""
_SURFACE_SIGMAS = 3.0
"""largest error of the surface, in standard deviations of the edge's position"""
_LANDING_MARGIN_RAD = math.radians(1.0)
"""angle before the landing [rad] for a frame's exposure, its angle's error and unequal rounding of the two
edges"""
_FACE_SIGMAS = 1.0
"""error of the face's far end, in standard deviations of the edge's position, by which the face may land
earlier; most of that error moves both ends alike"""
_LIFTED_RAD = math.radians(1.0)
"""theta [rad] from which no part of the resting face touches"""


def landing_angle(section: SupportFunction, planned: PlannedStrike) -> float | None:
    """Landing angle: tipping angle theta [rad] from which the next face may touch the table.

    It is the angle at which the face touches by the shape, less a margin of 1 deg and the error of the face's
    far end, as an angle about the pivot. None if no flat face touches within the angles that `section`
    covers, or if the landing angle of the first one is not beyond the predicted balance angle.

    Args:
        section: support function of the object's cross-section about the pivot point.
        planned: the planned strike, with the pivot's rounding and its uncertainty, and the predicted balance
            angle.
    """
    depth = section.height - planned.pivot.radius_m
    # A curve that touches rolls on; it does not land.
    flat = np.ones(len(depth), dtype=bool) if section.curved is None else ~section.curved
    deep = np.flatnonzero(
        (section.angles > _LIFTED_RAD)
        & (depth > _MIN_DEPTH_M + _SURFACE_SIGMAS * planned.pivot.sd_m)
        & (section.ahead > 0.0)
        & flat
    )
    if not len(deep):
        return None
    reach = math.hypot(float(depth[deep[0]]), float(section.ahead[deep[0]]))
    lands = float(section.angles[deep[0]]) - math.atan2(float(depth[deep[0]]), float(section.ahead[deep[0]]))
    lands -= _LANDING_MARGIN_RAD + _FACE_SIGMAS * planned.pivot.sd_m / reach
    return lands if lands > planned.phi_predicted_rad else None


def rolling_landing_angle(section: SupportFunction, planned: PlannedStrike) -> float | None:
    """Landing angle of an object that rolls on a curve: from it on, the next face may touch the table.

    Such a face is a bevel, or a part that juts out, such as a handle. The angle is that at which it lies on
    the table by the shape, less a margin of 1 deg and the error of its far end.

    Args:
        section: support function of the object's cross-section, which rolls (`rolls_until`).
        planned: the planned strike, with the edge's uncertainty and the predicted balance angle.

    Returns:
        The angle [rad]; None if no flat face touches up to 25 deg past the predicted balance.
    """
    lands = rolls_until(section, planned.phi_predicted_rad)
    if lands is None or not math.isfinite(lands):
        return None
    reach = section.longest_flat(lands - section.step, lands + 2 * section.step)
    return lands - _LANDING_MARGIN_RAD - _FACE_SIGMAS * planned.pivot.sd_m / max(reach, planned.pivot.sd_m)
