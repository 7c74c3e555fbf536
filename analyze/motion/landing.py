"""Where the free motion must end by the shape: at the angle at which its next face comes to lie on the table.

A box lands on a wall at 90 deg and stops: theta(t) shows that. A bottle that lies on its side lands on a chamfer at 45 deg, which hardly
slows it; from there on it turns about the chamfer's other edge, with another phi and another k.

Turned by theta about the pivot p, at the height of its rounding, the body would lie height(theta) - radius deep in the table. A face at
angle a that reaches L ahead makes that L sin(theta - a). So it counts only where it lies deeper than the surface is off: neither a scan's
facets nor a narrow bevel carry the body.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from schemas.strike_plan import PlannedStrike

_DEEP = 5e-4
"""m, from which on a face that would lie in the table carries the body"""
_SURFACE = 3.0
"""1 sigma of the edge's place, up to which it may be the surface's error"""
_NEAR = math.radians(1.0)
"""before the landing: what a frame's exposure, its angle's error and another rounding of the two edges may make of it"""
_FACE = 1.0
"""1 sigma of the edge's place at the face's far end, by which it may lie on the table earlier; most of it moves both ends alike"""
_LIFTED = math.radians(1.0)
"""from which on no part of the face that it stood on touches"""


def landing_angle(section: SupportFunction, planned: PlannedStrike) -> float | None:
    """Angle [rad] from which on the next face may touch; None where none does before the section ends, or before the body balances.

    Args:
        section: of the object across the pivot axis, about the pivot point.
        planned: the strike, with the pivot's rounding and its uncertainty, and the balance that is expected.
    """
    angles = section.start + section.step * np.arange(len(section.height))
    depth = section.height - planned.pivot.radius_m
    # What touches with a curve rolls on; it does not land.
    flat = np.ones(len(angles), dtype=bool) if section.bent is None else ~section.bent
    deep = np.flatnonzero(
        (angles > _LIFTED) & (depth > _DEEP + _SURFACE * planned.pivot.sd_m) & (section.ahead > 0.0) & flat
    )
    if not len(deep):
        return None
    reach = math.hypot(float(depth[deep[0]]), float(section.ahead[deep[0]]))
    lands = float(angles[deep[0]]) - math.atan2(float(depth[deep[0]]), float(section.ahead[deep[0]]))
    lands -= _NEAR + _FACE * planned.pivot.sd_m / reach
    return lands if lands > planned.phi_predicted_rad else None
