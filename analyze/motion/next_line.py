"""Strikes that balance over the next support line: their motion about it, from its take-over on.

Support lines are the edges over which an object turns in succession as it tips. An object with a foot or a
chamfer turns over the planned edge until the facet beside it lies on the table, then over that facet's other
edge, which thus takes over. Balance angle phi and rate k, in theta'' = -k sin(phi - theta) with theta the
tipping angle since rest, then belong to this next line. Seen from it, the rest of the motion is a tip like
any other: the same angle, another followed point, and a free motion that begins at the take-over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.phases import find_course, phases_of
from analyze.motion.pivot_place import (
    CLEAR_SIGMAS,
    matters,
    measure_pivot,
    nearest_to_planned,
)
from analyze.motion.supports import carrying_line
from analyze.types import PivotPlace
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.motion.phases import Course
    from analyze.motion.settings import WindowLimits
    from analyze.motion.strike_task import StrikeTask
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import SupportLine, TipMotion
    from schemas.strike_plan import PlannedStrike

_MARGIN_RAD = math.radians(1.0)
"""angle [rad] left out after the take-over of a line and before that of the next one, for unequal rounding
and for errors of the shape and of theta"""
_MIN_FRAMES = 16
"""least number of frames from the take-over on"""


@dataclass(frozen=True)
class LineMotion:
    """Motion of a strike about the support line that took over from the planned edge, to be analysed.

    Support lines are the edges over which the object turns in succession as it tips; the next one takes over
    where the face between the two comes to lie on the table.
    """

    line: SupportLine
    """the line, from the planned pivot's centre line"""
    motion: PlanarMotion
    """the motion, with slip and lift of a point on the line"""
    task: StrikeTask
    """the strike, with the line in place of the planned pivot"""
    course: Course
    """events of the strike; its free motion begins after the take-over"""
    moved_frame: int | None
    """first frame in which the object was clearly off rest"""
    begins_rad: float
    """tipping angle theta [rad] from which, by the shape, the object turns over this line alone"""


def carried_strike(planned: PlannedStrike, line: SupportLine) -> PlannedStrike:
    """Copy of a planned strike with its pivot edge replaced by the support line that took over from it.

    Such a line is the next edge over which the object turns as it tips. Rest pose and pivot direction stay;
    the pivot's point and radius become those of the line. No plan has a name for its axis: it is that of the
    planned one with the distance between the two, as p4e0+4.1mm.

    Args:
        planned: the strike as planned.
        line: the line, with its place from the planned pivot's centre line.
    """
    R_world_object = np.array(planned.R_world_object)
    point = np.array(planned.pivot.point) + R_world_object[[0, 2]].T @ np.array([line.along_m, line.up_m])
    pivot = planned.pivot.model_copy(update={"point": point.tolist(), "radius_m": line.radius_m})
    name = f"{planned.axis_id}+{1e3 * math.hypot(line.along_m, line.up_m):.1f}mm"
    return planned.model_copy(update={"pivot": pivot, "axis_id": name})


def planned_axis(axis_id: str) -> str:
    """Name of the planned pivot axis, from that of the axis about which a strike was analysed.

    The axis of an edge that took over from the planned one is named by this and their distance, which is cut
    off: p4e0+4.1mm gives p4e0. Any other name is returned as it is.
    """
    planned, _, distance = axis_id.rpartition("+")
    return planned if distance.endswith("mm") else axis_id


def next_take_over(found: TipMotion, task: StrikeTask) -> float | None:
    """Tipping angle [rad] at which a fit over the planned edge must end, before the next takes over.

    Support lines are the edges over which the object turns in succession as it tips. For an object that rolls
    on a curve of its shape it is the angle at which the next face may land. None if no line or face follows
    that is far enough from the planned edge to matter, if the lines are unknown, if there is no fit, if the
    verdict is a wrong edge, or if by the shape the object balanced over another line.

    Args:
        found: the motion as analysed for the planned edge.
        task: the strike as planned and as carried out, with its support lines.
    """
    supports, fit, angle = task.supports, found.fit, found.angle
    if fit is not None and fit.rolling is not None and fit.rolling.of_shape:
        return task.landing_angle_rad
    if not supports or fit is None or angle is None or found.verdict is Verdict.WRONG_EDGE:
        return None
    mine = nearest_to_planned(supports)
    top = float(np.max(angle.theta[slice(*fit.window)]))
    until = _carries_until(supports, mine, task)
    return until if carrying_line(supports, min(fit.phi, top)) == mine else None


def reaches(found: TipMotion, until: float) -> bool:
    """True if a motion was fitted beyond the tipping angle `until` [rad]."""
    if found.fit is None or found.angle is None:
        return False
    return float(np.max(found.angle.theta[slice(*found.fit.window)])) > until


def balanced_before(found: TipMotion, until: float) -> TipMotion:
    """Result of a strike fitted until the next edge may take over; a wrong edge if it balances later.

    The motion up to there does not show over which of the two edges such a strike balanced. An object that
    rocked back turned about the planned edge alone: its result stays as it is.

    Args:
        found: the motion as analysed up to that angle.
        until: tipping angle [rad] from which the object may turn over the next edge.
    """
    if found.fit is None or found.verdict is Verdict.ROCKED_BACK or found.fit.phi < until:
        return found
    at = math.degrees(until)
    reason = f"balanced where the next edge takes over, at {at:.0f} deg or later: leave this edge out"
    return replace(found, verdict=Verdict.WRONG_EDGE, reason=reason)


def _carries_until(supports: Sequence[SupportLine], index: int, task: StrikeTask) -> float | None:
    """Tipping angle [rad] up to which the object surely turns over a support line; None for no limit.

    Support lines are the edges over which the object turns in succession as it tips. The limit is the angle
    at which the next one takes over, less 1 deg and the angle's standard deviation. Later lines within 0.2
    mm, or within two standard deviations of the edge's place, are too near to matter and are skipped; None if
    no other line follows.

    Args:
        supports: support lines, ordered by the angle at which each takes over.
        index: index of the line.
        task: the strike, with the sd of the edge's place.
    """
    later = [other for other in supports[index + 1 :] if matters(other, supports[index], task)]
    return later[0].takes_over_rad - _MARGIN_RAD - later[0].takes_over_sd_rad if later else None


def about_next_line(
    motion: PlanarMotion, task: StrikeTask, found: TipMotion, limits: WindowLimits
) -> LineMotion | None:
    """Motion about the line over which, by the shape, the object balanced, after that line took over.

    The line is a support line, one of the edges over which the object turns in succession as it tips.

    Args:
        motion: the motion in the plane across the pivot axis, with slip and lift of the planned edge.
        task: the strike as planned and as carried out, with its support lines.
        found: the motion as analysed for the planned edge; the balance angle of its fit selects the line.
        limits: bounds of the free motion.

    Returns:
        The motion about the line. None if there is no fit, if the support lines are unknown, if the contact
        rolls on a curve or along a rim, if by the shape the object balanced over the planned edge, or if
        fewer than 16 frames of free motion follow the take-over.
    """
    supports, planned, angle = task.supports, task.planned, motion.angle
    if not supports or found.fit is None or found.fit.rolling is not None or planned.rolls:
        return None
    top = float(np.max(angle.theta[slice(*found.fit.window)]))
    index = carrying_line(supports, min(found.fit.phi, top))
    line = supports[index]
    if index == nearest_to_planned(supports) or line.is_curve or not line.takes_over_rad:
        return None
    begins = line.takes_over_rad + _MARGIN_RAD + line.takes_over_sd_rad
    ends = _carries_until(supports, index, task)
    whole = find_course(angle, task.contact_time_ns, limits, ends)
    course = _from_take_over(whole, motion, begins, limits)
    if course is None:
        return None
    carried = carried_strike(planned, line)
    phi = max(found.fit.phi, begins)
    moved_task = replace(
        task,
        planned=carried.model_copy(update={"phi_predicted_rad": phi}),
        supports=_seen_from(line, supports),
        landing_angle_rad=ends,
        section=None,
    )
    about = _followed_on(motion, planned, line)
    return LineMotion(line, about, moved_task, course, whole.moved_frame, begins)


def counted_for_line(motion: PlanarMotion, found: TipMotion, about: LineMotion) -> TipMotion | None:
    """Result of a strike that counts for the line which took over; None unless that line is certain.

    The line is a support line, one of the edges over which the object turns in succession as it tips. It is
    certain if by the shape the object turned over it alone at balance, and if the measured place of the line
    at balance agrees with it within 3 sd and excludes, by 3 sd, every other one that is far enough away to
    matter, the planned edge among them. None also if there is no such other line, if the place could not be
    measured, or if the verdict is neither good nor rocked back.

    Args:
        motion: the motion with slip and lift of the planned edge.
        found: the motion as analysed about the line.
        about: the line, with the motion about it.
    """
    fit, supports = found.fit, about.task.supports or ()
    if fit is None or found.angle is None or found.verdict not in (Verdict.GOOD, Verdict.ROCKED_BACK):
        return None
    mine = supports[nearest_to_planned(supports)]
    ends = about.task.landing_angle_rad or math.inf
    place = measure_pivot(about.motion, fit)
    if place is None or abs(place.ahead) > CLEAR_SIGMAS * place.sd or not about.begins_rad < fit.phi < ends:
        return None
    others = [line for line in supports if line is not mine and matters(line, mine, about.task)]
    off = [abs(line.ahead_m(fit.phi) - place.ahead) for line in others]
    if not off or min(off) < CLEAR_SIGMAS * place.sd:
        return None
    out_mm = 1e3 * math.hypot(about.line.along_m, about.line.up_m)
    return replace(
        found,
        reason=f"balanced over the next line, {out_mm:.1f} mm out: counted for it; {found.reason}",
        phases=phases_of(motion.angle, replace(about.course, moved_frame=about.moved_frame), fit.phi),
        angle=motion.angle,
        carried_by=about.line,
        pivot_place=PivotPlace(place.ahead + about.line.ahead_m(fit.phi), place.sd),
    )


def _from_take_over(
    course: Course, motion: PlanarMotion, begins: float, limits: WindowLimits
) -> Course | None:
    """Events of a strike whose free motion begins after the next edge took over; None if too short.

    The facet between the two edges lands on the table then, an impact after which as much time is left out as
    after that of the striker. An object that falls back ends its free motion where the facet lands again.
    None if the object did not move, or if fewer than 16 frames are left.

    Args:
        course: events of the strike about the planned edge.
        motion: the motion, with the tipping angle.
        begins: tipping angle [rad] from which the object turns over the next edge alone.
        limits: time left out after an impact.
    """
    angle, released = motion.angle, course.released_frame
    if released is None:
        return None
    theta, until = angle.theta, course.end_frame
    beyond = np.flatnonzero(theta[released:until] > begins)
    if not len(beyond):
        return None
    landed = released + int(beyond[0])
    after_ns = int(angle.time_ns[landed]) + round(1e9 * limits.guard_s)
    first = max(landed + limits.guard_frames, int(np.searchsorted(angle.time_ns, after_ns, side="left")))
    back = np.flatnonzero(theta[first:until] < begins)
    end = first + int(back[0]) if len(back) else until
    if end - first < _MIN_FRAMES:
        return None
    top = first + int(np.argmax(theta[first:end]))
    return replace(
        course,
        moved_frame=first,
        released_frame=first,
        top_frame=top,
        end_frame=end,
        came_back=course.came_back or len(back) > 0,
    )


def _seen_from(line: SupportLine, supports: Sequence[SupportLine]) -> tuple[SupportLine, ...]:
    """Support lines with their places [m] from one of them instead of the planned pivot's centre line.

    Support lines are the edges over which the object turns in succession as it tips.
    """
    return tuple(
        replace(each, along_m=each.along_m - line.along_m, up_m=each.up_m - line.up_m) for each in supports
    )


def _followed_on(motion: PlanarMotion, planned: PlannedStrike, line: SupportLine) -> PlanarMotion:
    """Copy of a motion with the slip and lift [m] of a support line instead of the planned edge's.

    The line is an edge that took over from the planned one. Both are 0 while the object turns over it without
    sliding: the lift is counted from the height of its rounding on the table, the slip from rolling on that
    rounding since the line took over.

    Args:
        motion: the motion with slip and lift of the planned edge.
        planned: the strike as planned, with the radius of its edge.
        line: the line, from the planned pivot's centre line.
    """
    theta, begins, radius = motion.angle.theta, line.takes_over_rad, planned.pivot.radius_m
    cos, sin = np.cos(theta), np.sin(theta)
    ahead, height = line.along_m * cos + line.up_m * sin, line.up_m * cos - line.along_m * sin
    rolled = radius * (theta - begins) - line.radius_m * (theta - begins)
    slip = motion.angle.slip + ahead - line.ahead_m(begins) + rolled
    lift = motion.lift + radius + height - line.radius_m
    by_theta = np.broadcast_to(np.eye(3), (len(theta), 3, 3)).copy()
    by_theta[:, 1, 0], by_theta[:, 2, 0] = height + radius - line.radius_m, -ahead
    lever = math.hypot(line.along_m, line.up_m)
    return replace(
        motion,
        angle=replace(motion.angle, slip=slip),
        lift=lift,
        position_sd=np.hypot(motion.position_sd, lever * motion.angle.sd),
        covariance=by_theta @ motion.covariance @ by_theta.swapaxes(1, 2),
    )
