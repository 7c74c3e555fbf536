"""Place of the line about which a body turns as it balances, measured against the planned pivot line.

The plan's edge is a hypothesis: on a body with a foot or a chamfer the neighbouring line may take over before
balance, and balance angle phi and rate k then belong to that line. The followed point, where the planned line
is assumed to be, rises off the table at d z / d theta = a, its horizontal distance behind the line about
which the body turns. At balance the centre of mass stands above that line, so that a is what the equi-plane
would be off. Only the height is used: sliding along the table does not change it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.edge_offset import fit_creeping
from analyze.motion.strike_task import Judgement
from analyze.motion.supports import carrying_line
from analyze.types import PivotPlace
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.motion.strike_task import StrikeTask
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import Array, MotionFit, SupportLine

_AROUND_RAD = math.radians(10.0)
"""largest angle from balance [rad] of the frames from which the place is measured"""
_MIN_FRAMES, _MIN_SPAN_RAD = 8, math.radians(4.0)
"""least number of frames, and least range of their tipping angles [rad]"""
_HEIGHT_SD = 5e-3
"""standard deviation [m] of the line's height over the followed point, before the measurement"""
CLEAR_SIGMAS = 3.0
"""number of standard deviations beyond which chance is excluded"""
_SAME_SIGMAS = 2.0
"""number of standard deviations within which the line may be the planned one, where another is possible"""
_MIN_OFF_M, _OFF_SIGMAS = 1e-3, 2.5
"""least distance from the planned line [m], and in standard deviations, at which a measurement alone shows
another line

Of 485 simulated strikes called good, all those beyond 2.3 of it were over a line 1.8 mm or more from the
planned one, since the standard deviation covers badly placed markers.
"""
_MIN_SHIFT_M, _SHIFT_SIGMAS = 2e-4, 2.0
"""least distance between two support lines [m], and in standard deviations of the edge's place, from which it
matters which of them carries"""
_ANGLE_MARGIN_RAD = math.radians(0.2)
"""error of a take-over angle [rad] that every shape has: unequal rounding of the two edges"""


def measure_pivot(motion: PlanarMotion, fit: MotionFit) -> PivotPlace | None:
    """Place, against the planned line, of the line about which the body turns at balance.

    Its distance ahead is measured near balance, that of the centre of curvature above over the whole window.

    Args:
        motion: the motion, with the lift (height over the place at rest) of the planned line's point as it
            was measured, not corrected for an error of that point's place.
        fit: fit with the balance angle and its window of frames.

    Returns:
        The place with its sds. None if no marker's place on the object is known, or if fewer than eight
        frames or less than 4 deg lie within 10 deg of balance.
    """
    if motion.place_sd is None:
        return None
    away = motion.angle.theta[slice(*fit.window)] - fit.phi
    near = np.abs(away) < _AROUND_RAD
    if np.count_nonzero(near) < _MIN_FRAMES or float(np.ptp(away[near])) < _MIN_SPAN_RAD:
        return None
    ahead, covariance = _fitted_place(motion, fit, near, _HEIGHT_SD)
    whole, of_whole = _fitted_place(motion, fit, np.ones(len(away), dtype=bool), math.inf)
    return PivotPlace(
        float(ahead[0]),
        math.hypot(math.sqrt(float(covariance[0, 0])), motion.place_sd),
        float(whole[1]),
        math.hypot(math.sqrt(float(of_whole[1, 1])), motion.place_sd),
        float(whole[2]),
    )


def _fitted_place(
    motion: PlanarMotion, fit: MotionFit, used: NDArray[np.bool_], height_sd: float
) -> tuple[Array, Array]:
    """Distance ahead, height and lift (3,) [m] of the line, fitted to some frames, with covariance (3, 3).

    Args:
        motion: the motion with the lift of the planned line's point.
        fit: fit with the balance angle and its window of n frames.
        used: (n,) True for the frames to use.
        height_sd: standard deviation of the height before the measurement [m].
    """
    frames = np.arange(*fit.window)[used]
    away = motion.angle.theta[frames] - fit.phi
    rows = np.column_stack([np.sin(away), 1.0 - np.cos(away), np.ones(len(away))])[None]
    sd = np.maximum(motion.position_sd[frames], 1e-7)
    found = fit_creeping(away, rows, motion.lift[frames][None], sd, np.array([np.inf, height_sd, np.inf]))
    return found.parameters, found.covariance


def judge_support(
    motion: PlanarMotion, fit: MotionFit, place: PivotPlace | None, task: StrikeTask
) -> Judgement | None:
    """Verdict "wrong edge" if by the shape the body balanced over another line than planned, else None.

    A support line is one over which the body turns for a range of tipping angles, until the next takes over.
    By the shape, the body balanced over the last one that took over before the measured balance angle. Where
    a line takes over so near balance that the shape's errors leave it open, the measured place decides. A
    place that contradicts the shape does not save a strike: where the line changes near balance, the measured
    place lies between the two. None also if the other line is too near to the planned one to matter, or if
    the contact rolls on a curve.

    Args:
        motion: the motion, with the tipping angle.
        fit: the chosen fit with the balance angle and its window.
        place: measured horizontal distance of the line at balance from the planned one; None if it was not
            measured.
        task: the strike as planned, with the support lines by the shape.
    """
    line = None if fit.rolling is not None else _line_by_shape(motion, fit, place, task)
    if line is None:
        return None
    shift_mm, reached = 1e3 * math.hypot(line.along_m, line.up_m), math.degrees(line.takes_over_rad)
    text = f"balanced over another edge, {shift_mm:.1f} mm from the planned one, reached at {reached:.0f} deg"
    return Judgement(Verdict.WRONG_EDGE, f"{text}: make the plan anew, or leave this edge out")


def judge_place(place: PivotPlace | None, fit: MotionFit, edge_sd: float = 0.0) -> Judgement | None:
    """Verdict "wrong edge" if the body balanced over a line measured far off the planned one, else None.

    Far is at least 1 mm and 2.5 sd. The shape need not have another edge there. Where the contact rolls, the
    line is that below the centre of curvature at balance.

    Args:
        place: measured horizontal distance of the line at balance from the planned one; None if it was not
            measured.
        fit: the chosen fit, with the circle on which the contact rolled, if it did.
        edge_sd: 1 sigma of the edge's place by a scan [m]; 0 for an exact shape.
    """
    if place is None:
        return None
    ahead, sd, line = place.ahead, math.hypot(place.sd, edge_sd), "the planned one"
    if (rolled := fit.rolling) is not None:
        ahead -= rolled.forward * math.cos(fit.phi) + rolled.up * math.sin(fit.phi)
        sd, line = math.hypot(sd, rolled.sd), "where its shape rolls"
    if abs(ahead) < max(_MIN_OFF_M, _OFF_SIGMAS * sd):
        return None
    side = "ahead of" if ahead > 0 else "behind"
    off = f"{1e3 * abs(ahead):.1f} ± {2e3 * place.sd:.1f} mm {side} {line}"
    text = f"balanced over a line {off}: check the marker's place and the shape of this edge"
    return Judgement(Verdict.WRONG_EDGE, text)


def _line_by_shape(
    motion: PlanarMotion, fit: MotionFit, place: PivotPlace | None, task: StrikeTask
) -> SupportLine | None:
    """Support line over which the body balanced instead of the planned one; None if none is shown.

    A support line is one over which the body turns for a range of tipping angles. The result is None as well
    if the shape has no support lines, or if the other line is too near to the planned one to matter.

    Args:
        motion: the motion, with the tipping angle.
        fit: the chosen fit, with the balance angle.
        place: measured horizontal distance of the line at balance from the planned line, positive in the
            direction of the tip; None if it was not measured.
        task: the strike with its support lines by the shape.
    """
    supports = task.supports
    if not supports:
        return None
    planned = nearest_to_planned(supports)
    top = float(np.max(motion.angle.theta[slice(*fit.window)]))
    candidates = [
        line
        for line in _near_balance(supports, min(fit.phi, top), math.sqrt(float(fit.covariance[0, 0])))
        if line is not supports[planned]
        and matters(line, supports[planned], task, measured=place is not None)
    ]
    if not candidates:
        return None
    carrying = supports[carrying_line(supports, min(fit.phi, top))]
    if carrying in candidates or place is None:
        return carrying if carrying in candidates else None
    other = min(candidates, key=lambda line: abs(line.ahead_m(fit.phi) - place.ahead))
    nearer = abs(other.ahead_m(fit.phi) - place.ahead) < abs(place.ahead)
    return other if nearer and abs(place.ahead) > _SAME_SIGMAS * place.sd else None


def nearest_to_planned(supports: Sequence[SupportLine]) -> int:
    """Index of the support line nearest to the planned pivot, which counts as that pivot by the shape.

    Support lines are the edges over which the body turns in succession as it tips; each has its place from
    the planned pivot's centre line.
    """
    return min(range(len(supports)), key=lambda i: math.hypot(supports[i].along_m, supports[i].up_m))


def _near_balance(supports: Sequence[SupportLine], phi: float, phi_sd: float) -> list[SupportLine]:
    """Support lines over which the body may turn at the balance angle, within the errors of the shape.

    Args:
        supports: Support lines, ordered by the tipping angle at which each takes over.
        phi: Balance angle [rad], or the largest angle reached if that is less.
        phi_sd: Its standard deviation [rad].
    """
    found: list[SupportLine] = []
    for i, line in enumerate(supports):
        margin = _ANGLE_MARGIN_RAD + CLEAR_SIGMAS * math.hypot(line.takes_over_sd_rad, phi_sd)
        begins = line.takes_over_rad - margin if i else -math.inf
        ends = math.inf
        if i + 1 < len(supports):
            after = supports[i + 1]
            ends = after.takes_over_rad + _ANGLE_MARGIN_RAD
            ends += CLEAR_SIGMAS * math.hypot(after.takes_over_sd_rad, phi_sd)
        if begins < phi < ends:
            found.append(line)
    return found


def matters(line: SupportLine, planned: SupportLine, task: StrikeTask, *, measured: bool = False) -> bool:
    """True if two support lines are so far apart that strikes over them are different measurements.

    Support lines are the edges over which the body turns in succession as it tips. The distance must exceed
    0.2 mm and two standard deviations of the planned edge's place; on a scan, whose edges err by more, those
    of `task.edge_sd` if the place at balance was measured, as the estimate then uses that.

    Args:
        line: one of the lines.
        planned: the other line, usually the one that is the planned pivot.
        task: the strike as planned, with the standard deviation of its edge's place.
        measured: True if the place of the line at balance was measured.
    """
    apart = math.hypot(line.along_m - planned.along_m, line.up_m - planned.up_m)
    sd = max(task.planned.pivot.sd_m, task.edge_sd if measured else 0.0)
    return apart > max(_MIN_SHIFT_M, _SHIFT_SIGMAS * sd)
