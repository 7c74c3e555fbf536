"""Choice between a hinge (edge in place) and a rolling contact for a strike, with the reason."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.support_function import circular_support

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.motion.tip_angle import PlanarMotion
    from schemas.strike_plan import PlannedStrike

MIN_ROLLING_RADIUS_M = 2.5e-3
"""least rounding [m] of an edge that is treated as rolling instead of as a pivot"""
_MIN_CURVE_RADIUS_M = 5e-4
"""least radius [m] of a curve of the shape itself; a smaller one is a corner with the plan's rounding"""
_MIN_CURVE_RAD = math.radians(15.0)
"""least range of angles [rad] of a curve; where the faces of a scan meet, noise makes a curve of a few
degrees"""
_MAX_BEVEL_M = 5e-4
"""longest flat face [m] within a curve; a longer one is a bevel, over which the body hops"""
_MIN_ROOM_RAD = math.radians(5.0)
"""least angle [rad] from balance to the landing of the next face, up to which the object rolls"""
_MAX_FOOT_RADIUS_M = 4e-3
"""largest radius [m] of a curve on which the object rolls until the next face lands; on 6 mm in facets of 1.2
mm phi was 1.1 deg off"""
_FIRST_ANGLE, PAST_PHI_RAD = math.radians(1.0), math.radians(25.0)
"""range of angles [rad] over which the section is examined: from rest on, and to past the predicted
balance"""


def rolling_curve(
    section: SupportFunction | None, planned: PlannedStrike
) -> tuple[SupportFunction | None, str]:
    """Curve on which the contact rolls, with the reason; (None, "") for an edge that acts as a hinge.

    Args:
        section: the object's cross-section at the pivot axis; None if unknown.
        planned: the planned strike, with the rounding of its edge.

    Returns:
        The curve as a support function (height of the pivot over the table against the tipping angle), and
        the reason in words. The curve is the cross-section itself if it is curved where it touches; otherwise
        a circle with the radius of the edge's rounding, if that is at least 2.5 mm (or a round rim's, of any
        radius above 0).
    """
    radius, last = planned.pivot.radius_m, planned.phi_predicted_rad + PAST_PHI_RAD
    lands = None if section is None else rolls_until(section, planned.phi_predicted_rad)
    if section is not None and lands is not None:
        least, most = section.range_of_radius(_FIRST_ANGLE, min(last, lands))
        return section, f"the object rolls on a curve of {1e3 * least:.0f} to {1e3 * most:.0f} mm radius"
    if radius >= MIN_ROLLING_RADIUS_M:
        return circular_support(radius), f"the edge rolls on its rounding of {1e3 * radius:.1f} mm"
    if planned.rolls and radius > 0.0:
        return circular_support(radius), f"the rim rolls on its rounding of {1e3 * radius:.1f} mm"
    return None, ""


def is_curved(section: SupportFunction, phi: float) -> bool:
    """True if the section rolls on a curve of its shape, from 1 deg past rest to balance (`rolls_until`).

    Args:
        section: the object's cross-section at the pivot axis.
        phi: balance angle [rad].
    """
    return rolls_until(section, phi) is not None


def rolls_until(section: SupportFunction, phi: float) -> float | None:
    """Tipping angle [rad] up to which the section rolls on a curve of its shape; None if it does not.

    It rolls from 1 deg past rest to 25 deg past `phi`, or until a flat face (a bevel, or a part that juts
    out) of 0.5 mm or more lands, if that is at least 5 deg past `phi` and the curve's radius is at most 4 mm.
    In that range curves of more than 0.5 mm radius must touch the table over more than 15 deg.

    Args:
        section: the object's cross-section at the pivot axis.
        phi: balance angle [rad].

    Returns:
        The angle at which the first such face lands; infinite if none does up to 25 deg past `phi`.
    """
    lands = next_landing(section, phi)
    if lands < phi + _MIN_ROOM_RAD:
        return None
    if math.isfinite(lands):
        _, _, radius = section.evaluate(np.linspace(_FIRST_ANGLE, phi, 20))
        if float(np.median(radius)) > _MAX_FOOT_RADIUS_M:
            return None
    last = min(phi + PAST_PHI_RAD, lands)
    if section.curved_over(_FIRST_ANGLE, last, _MIN_CURVE_RADIUS_M) <= _MIN_CURVE_RAD:
        return None
    return lands


def next_landing(section: SupportFunction, phi: float) -> float:
    """Tipping angle [rad] at which the first flat face of 0.5 mm or more lands; infinite if none does.

    Faces that land later than 25 deg past `phi` do not count.

    Args:
        section: the object's cross-section at the pivot axis.
        phi: balance angle [rad].
    """
    return section.first_flat(_FIRST_ANGLE, phi + PAST_PHI_RAD, _MAX_BEVEL_M)


def relative_to_rolling(motion: PlanarMotion, curve: SupportFunction, planned: PlannedStrike) -> PlanarMotion:
    """Copy of a motion with slip and lift [m] measured against rolling on a curve, without sliding.

    The given slip is measured against rolling on the circle that the plan states for the edge's rounding, the
    given lift against the height at rest.

    Args:
        motion: tracked motion, with slip (along the table) and lift (off it) of the pivot edge.
        curve: support function of the cross-section that rolls: height of the pivot point over the table by
            tipping angle.
        planned: the planned strike, with the rounding of its edge.
    """
    along, over = curve.rolling_displacement(motion.angle.theta)
    slip = motion.angle.slip + planned.pivot.radius_m * motion.angle.theta - along
    return replace(motion, angle=replace(motion.angle, slip=slip), lift=motion.lift - over)
