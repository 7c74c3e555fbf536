"""Choice between a hinge (edge in place) and the moment balance for a strike, with the reason.

The moment balance is a fit that allows for the edge's measured sliding and lifting.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.motion.balance_fit import EdgeErrors, moment_balance
from analyze.motion.creep_error import creep_error
from analyze.motion.free_motion import (
    frame_noise,
    is_jump,
    largest_jump,
    longest_clean_fit,
    settled_fit,
)
from analyze.motion.pendulum_fit import MAX_LINEAR_PHI_SD, pivot_fit
from analyze.motion.two_impact_fit import fit_two_impacts

if TYPE_CHECKING:
    from analyze.motion.edge_motion import EdgeMotion
    from analyze.motion.settings import VerdictLimits
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import MotionFit, TipAngle
    from schemas.strike_plan import PlannedStrike

_MAX_NOISE_TO_SEE_CREEP = math.radians(0.2)
"""largest noise of a frame's angle [rad] at which a creeping edge can be distinguished from noise"""
_MOVED_SIGMAS = 5.0
"""ratio of the edge's motion to the slow error of its place from which on the edge has moved"""
_MAX_EDGE_NOISE = 1.5
"""largest ratio of the residuals' scatter to the angle's own noise that is attributed to the noisy position
of the edge"""
_UNEXPLAINED_SHARE = 0.25
"""largest share of a jump's chi^2 that may remain if the moment balance is to explain the jump"""
_SAME_PHI_SIGMAS = 4.0
"""number of sd within which two values of phi agree"""
_CLEARLY_LESS_VARIANCE = 0.5
"""largest ratio of the balance's variance of phi to that of a hinge whose edge crept, to be chosen for it"""
_CREEP_SIGMAS, _MIN_CREEP_RAD = 3.0, math.radians(0.02)
"""least difference of phi between hinge and balance, in sd and in rad, that proves a creeping edge

Smaller differences are within the error of the edge's position.
"""


def balance_instead_of_hinge(
    edge: EdgeMotion,
    window: tuple[int, int],
    hinge: MotionFit | None,
    planned: PlannedStrike,
    limits: VerdictLimits,
) -> tuple[MotionFit | None, str]:
    """Moment-balance fit that replaces the hinge fit, with the reason; (None, "") to keep the hinge.

    Both fit the balance angle phi and the rate k of theta'' = -k sin(phi - theta), theta the tipping angle.
    The hinge fit takes the edge as staying in place; the moment balance (forces at the contact have no moment
    about it) allows for the edge's measured motion. The hinge is kept if the moment balance fails, or if its
    residuals still show a jump in angular speed. If the edge was not seen to move, the hinge is also kept
    where frames are noisier than 0.2 deg, or where the moment balance neither explains the motion better nor
    is clearly more certain; without a hinge fit the result is then (None, "") too.

    Args:
        edge: sliding and lifting of the edge.
        window: frames [start, stop).
        hinge: the hinge fit; None if a hinge does not fit.
        planned: the planned strike, with predicted phi and the radius of the pivot edge's rounding.
        limits: limits of a moved edge and of a jump in speed.
    """
    slow_sd = edge.motion.slow_place_sd
    moved = max(edge.slide_range, edge.lift_range) >= max(limits.edge_moved, _MOVED_SIGMAS * slow_sd)
    if slow_sd and not moved:
        return None, ""
    noise = float(np.median(edge.motion.angle.sd[slice(*window)]))
    if not moved and (hinge is None or noise > _MAX_NOISE_TO_SEE_CREEP):
        return None, ""
    phi = None if hinge is not None else planned.phi_predicted_rad

    def balance(frames: tuple[int, int]) -> MotionFit:
        """Fit by moment balance: balance angle phi [rad] and rate constant k [rad/s^2] with covariance.

        The moment balance (forces at the contact have no moment about it) allows for the edge's measured
        sliding and lifting; k is that of the tip theta'' = -k sin(phi - theta), with theta the tipping
        angle.

        Args:
            frames: first frame that is fitted, and the one after the last.

        Raises:
            EstimationError: the fit fails.
        """
        errors = EdgeErrors(edge.offset_covariance, edge.by_radius)
        return moment_balance(edge.motion, frames, planned.pivot.radius_m, phi, errors)

    try:
        fit = balance(window)
    except EstimationError:
        return None, ""
    angle = edge.motion.angle
    _, size, left = largest_jump(angle, fit)
    # The angle's sd does not include the noise of the edge's position. The factor is limited, because a
    # motion that does not fit must not pass as noise.
    angle_sd = float(np.median(angle.sd[slice(*fit.window)]))
    left /= min(max(1.0, frame_noise(fit.residual) / angle_sd), _MAX_EDGE_NOISE) ** 2
    if is_jump(fit, size, left, limits):
        return None, ""
    if moved or hinge is None:
        slid = f"the edge slid by {1e3 * edge.slide_range:.1f} mm and rose by {1e3 * edge.lift_range:.1f} mm"
        return settled_fit(fit, balance), slid
    radius = planned.pivot.radius_m
    reason = _reason_for_balance(angle, window, hinge, fit, left, radius, limits)
    reason = reason or _reason_by_certainty(edge.motion, hinge, fit, radius)
    return (fit if reason else None), reason


def _reason_for_balance(
    angle: TipAngle,
    window: tuple[int, int],
    hinge: MotionFit,
    balanced: MotionFit,
    left: float,
    radius: float,
    limits: VerdictLimits,
) -> str:
    """Reason, in words, for a moment balance although the edge was not seen to move; empty if none.

    A moment balance is a fit that allows for the edge's measured motion. It is preferred if it explains a
    jump in angular speed that the hinge fit shows. Without such a jump it is preferred if its balance angle
    is more certain than the hinge's, and differs from it by more than 3 sd and 0.02 deg.

    Args:
        angle: tipping angle theta(t).
        window: frames [start, stop).
        hinge: fit with an edge that stays in place.
        balanced: fit by the moment balance.
        left: decrease of chi^2 that a jump in angular speed, added to `balanced`, would still bring.
        radius: radius of the edge's rounding [m].
        limits: limits of a jump in speed.
    """
    _, size, gain = largest_jump(angle, hinge)
    if is_jump(hinge, size, gain, limits):
        if left < _UNEXPLAINED_SHARE * gain and _explains_jump(angle, window, balanced, radius):
            return f"the edge moved at one end of the window, where a hinge shows a jump of {size:+.2f} rad/s"
        return ""
    sd, balanced_sd = math.sqrt(float(hinge.covariance[0, 0])), math.sqrt(float(balanced.covariance[0, 0]))
    apart = abs(balanced.phi - hinge.phi)
    if balanced_sd < sd and apart > max(_CREEP_SIGMAS * sd, _MIN_CREEP_RAD):
        off = f"{math.degrees(apart):.2f} deg off, {apart / sd:.1f} of its sd"
        return f"a hinge would put phi {off}: the edge crept"
    return ""


def _reason_by_certainty(motion: PlanarMotion, hinge: MotionFit, balanced: MotionFit, radius: float) -> str:
    """Reason, in words, for a moment balance that is more certain than a hinge; empty if it is not.

    Both fit the balance angle phi and the rate k of theta'' = -k sin(phi - theta), theta the tipping angle. A
    hinge is an edge that stays in place; its errors include those of the edge's measured creep (small
    displacements). The moment balance follows these instead. It is more certain if its variance of phi is
    less than half the hinge's, and that of k less than the hinge's. Empty also if the hinge's phi is
    uncertain by more than 0.3 deg (`MAX_LINEAR_PHI_SD`), before the creep is added.

    Args:
        motion: the motion with slip and lift of the edge.
        hinge: fit as a hinge.
        balanced: fit by the moment balance.
        radius: radius of the edge's rounding [m].
    """
    # Beyond that the interval of phi is not that of the linearised fit, which alone the balance knows.
    if float(hinge.covariance[0, 0]) > MAX_LINEAR_PHI_SD**2:
        return ""
    creep = creep_error(hinge, motion, radius)
    variance = np.diag(hinge.covariance + creep)
    better = np.diag(balanced.covariance)
    if not (better[0] < _CLEARLY_LESS_VARIANCE * variance[0] and better[1] < variance[1]):
        return ""
    off = math.degrees(math.sqrt(float(creep[0, 0])))
    return f"the edge crept, by which a hinge's phi is uncertain by {off:.2f} deg"


def _explains_jump(angle: TipAngle, window: tuple[int, int], balanced: MotionFit, radius: float) -> bool:
    """True if a moment balance explains a jump in angular speed that a hinge fit (edge in place) shows.

    The moment balance is a fit that allows for the edge's measured motion. It explains the jump if its
    residuals are no noisier than those of a fit with a second impact, and its balance angle phi agrees
    (within 4 sd) with that of a hinge fitted to the longest stretch without a jump. False if there is no such
    stretch.

    Args:
        angle: tipping angle theta(t).
        window: frames [start, stop).
        balanced: fit by the moment balance.
        radius: radius of the edge's rounding [m].
    """
    twice = fit_two_impacts(angle, window, radius)
    if twice is not None and frame_noise(twice.fit.residual) < frame_noise(balanced.residual):
        return False
    clean = longest_clean_fit(angle, window, partial(pivot_fit, radius=radius))
    if clean is None:
        return False
    sd = math.sqrt(float(clean.covariance[0, 0] + balanced.covariance[0, 0]))
    return abs(clean.phi - balanced.phi) < _SAME_PHI_SIGMAS * sd
