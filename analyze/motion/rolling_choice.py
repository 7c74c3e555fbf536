"""Whether a strike's edge is to be taken as a hinge, or as a contact that rolls, and why."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from analyze.motion.support_function import circle

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.motion.tip_angle import PlanarMotion
    from schemas.strike_plan import PlannedStrike

ROUNDED = 2.5e-3
"""m of rounding from which on the contact is told apart from a pivot, with where it rolls"""
_BENT = 5e-4
"""m of radius of a curve of the shape's own, from which on the section is a flank; the plan's rounding is of its corners"""
_OVER = math.radians(15.0)
"""over which it must be one: where a scan's faces meet, its noise makes a curve of a few degrees"""
_FLAT = 5e-4
"""m, of a face that comes to lie on the table in between: a bevel, over which the body hops"""
_FROM, _PAST = math.radians(1.0), math.radians(25.0)
"""rad after rest, and past the predicted balance: where the section counts"""


def rolls_on(section: SupportFunction | None, planned: PlannedStrike) -> tuple[SupportFunction | None, str]:
    """What the contact rolls on, and what says so; None for an edge that is as good as a hinge.

    Args:
        section: of the object across the pivot axis, as its shape has it; None: not known.
        planned: the strike, with the rounding of its edge.
    """
    radius, last = planned.pivot.radius_m, planned.phi_predicted_rad + _PAST
    if section is not None and is_curved(section, planned):
        least, most = section.range_of_radius(_FROM, last)
        return section, f"it rolls on a flank whose radius is {1e3 * least:.0f} to {1e3 * most:.0f} mm there"
    if radius >= ROUNDED:
        return circle(radius), f"the edge rolls on its rounding of {1e3 * radius:.1f} mm"
    if planned.rolls and radius > 0.0:
        return circle(radius), f"the rim rolls on its rounding of {1e3 * radius:.1f} mm"
    return None, ""


def is_curved(section: SupportFunction, planned: PlannedStrike) -> bool:
    """Whether the section is a curve where it touches, and not a corner or a bevel."""
    return is_curved_to(section, planned.phi_predicted_rad)


def is_curved_to(section: SupportFunction, phi: float) -> bool:
    """The same for a balance expected at `phi` [rad]."""
    last = phi + _PAST
    return section.curved_over(_FROM, last, _BENT) > _OVER and section.longest_flat(_FROM, last) < _FLAT


def against_rolling(motion: PlanarMotion, flank: SupportFunction, planned: PlannedStrike) -> PlanarMotion:
    """The motion with slip and lift against rolling on the flank; as tracked they are against rolling on the plan's rounding."""
    along, over = flank.rolled(motion.angle.theta)
    slip = motion.angle.slip + planned.pivot.radius_m * motion.angle.theta - along
    return replace(motion, angle=replace(motion.angle, slip=slip), lift=motion.lift - over)
