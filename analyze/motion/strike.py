"""Analysis of one strike: from marker tracks to balance angle phi, k and a verdict.

A strike is one impact that tips the object about an edge; phi is the tipping angle at which its centre of
mass stands above that edge, k = m g R / I_edge [rad/s^2] the rate of the tip (mass m, gravity g, R the
distance of the centre of mass from the edge, I_edge the moment of inertia about the edge).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError, TrackingError
from analyze.motion.axis_heading import judge_heading
from analyze.motion.contact import with_contact_errors
from analyze.motion.creep_error import creep_error
from analyze.motion.fit_choice import fit_strike
from analyze.motion.next_line import (
    about_next_line,
    balanced_before,
    counted_for_line,
    next_take_over,
    reaches,
)
from analyze.motion.pendulum_motion import energy_ratio
from analyze.motion.phases import Course, find_course, free_window, phases_of
from analyze.motion.pivot_place import judge_place, judge_support, measure_pivot
from analyze.motion.placement import judge_placement
from analyze.motion.rolling_choice import is_curved, relative_to_rolling
from analyze.motion.settings import MotionSettings
from analyze.motion.sign_change import sign_change_alternatives
from analyze.motion.slow_error import with_slow_error
from analyze.motion.strike_task import Judgement
from analyze.motion.tip_angle import Placement, PlanarMotion, tip_angle
from analyze.motion.verdict import judge_contact, judge_fit, judge_hard, judge_motion, judge_vague
from analyze.types import EdgePath, TipMotion
from schemas.strike_result import Verdict
from schemas.watch_lines import StrikeVerdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.motion.strike_task import StrikeTask
    from analyze.types import CameraModel, Marker, MarkerTrack, MotionFit, TipAngle
    from schemas.strike_plan import PlannedStrike

_REST_BEFORE_CONTACT_NS = 4_000_000
"""time before the contact [ns] by which a resting frame's exposure must have ended: half a frame at 120
fps"""
_STILL_PX = 0.15
"""largest motion of a corner [px] of a marker at rest"""
_MIN_SEEN_NS = 200_000_000
"""time after the contact [ns] that the images must cover to show whether the object moved"""


def placement_of(planned: PlannedStrike) -> Placement:
    """Planned pose of the object in the world frame W, with its pivot point and rounding, as a Placement.

    Positions and radius are in m; the pivot point is in the object frame O.
    """
    return Placement(
        R_world_object=np.array(planned.R_world_object, dtype=float),
        p_world_object=np.array(planned.p_world_object, dtype=float),
        p_object_pivot=np.array(planned.pivot.point, dtype=float),
        radius=planned.pivot.radius_m,
    )


def analyse_strike(
    tracks: Sequence[MarkerTrack],
    markers: Sequence[Marker],
    camera: CameraModel,
    task: StrikeTask,
    settings: MotionSettings | None = None,
) -> TipMotion:
    """Analyse one strike: motion, phases, fits and verdict, from the tracks of its markers.

    A bad strike raises no error: its verdict names the fault. Balance angle phi [rad] and rate constant k of
    the tip [rad/s^2] (theta'' = -k sin(phi - theta), theta the tipping angle) are given if the motion could
    be fitted and phi is certain enough.

    Args:
        tracks: the object's markers through the strike's window.
        markers: the object's markers.
        camera: camera with its pose in the world frame W.
        task: the strike as planned and as carried out.
        settings: limits; None for the defaults.

    Returns:
        The motion with its verdict; tipping angle, phases, fit and energy ratio (kinetic energy after the
        strike over that needed to reach balance) are None where they could not be determined.
    """
    settings = settings or MotionSettings()
    if (unseen := _judge_unseen(task)) is not None:
        return _without_motion(task, unseen)
    rest_end_ns = end_of_rest_ns(tracks, task.contact_time_ns)
    if (misplaced := judge_placement(tracks, markers, camera, task, rest_end_ns)) is not None:
        return _without_motion(task, misplaced)
    try:
        motion = tip_angle(tracks, markers, camera, placement_of(task.planned), rest_end_ns)
    except TrackingError as error:
        return _without_motion(task, Judgement(Verdict.MARKER_LOST, str(error)))
    except EstimationError as error:
        return _without_motion(task, Judgement(Verdict.UNREADABLE, str(error)))
    return analyse_motion(motion, task, settings)


def analyse_motion(motion: PlanarMotion, task: StrikeTask, settings: MotionSettings) -> TipMotion:
    """Analyse the motion of one strike: phases, fits and verdict, from its tipping angle.

    A strike that balanced over the next line of the shape instead of the planned edge, such as the body's
    edge behind a foot, counts for that line if the line is certain; else it is a wrong edge. Only the part of
    the motion in which the object turns over one line is fitted.

    Args:
        motion: the motion in the plane across the pivot axis.
        task: the strike as planned and as carried out.
        settings: limits of the fit's window, of a clean tip and of the contact.

    Returns:
        The motion with its verdict. Fit and energy ratio (kinetic energy after the strike over that needed to
        reach balance) are None if the object did not tip, nothing fits, or the balance angle is too
        uncertain; tipping angle and phases too if the images end too early.
    """
    path = EdgePath(motion.angle.slip, motion.lift, motion.covariance, motion.place_sd)
    return replace(_about_carrying_line(motion, task, settings), rest_turns=motion.rest_turns, edge_path=path)


def _about_carrying_line(motion: PlanarMotion, task: StrikeTask, settings: MotionSettings) -> TipMotion:
    """Result of a strike about the edge over which the object balanced: the planned or the next one.

    A fit about the planned edge ends where the next edge may take over; a strike that balances later is a
    wrong edge. One that by the shape balanced over the next edge counts for it if that edge is certain, else
    it keeps its result about the planned edge.

    Args:
        motion: the motion in the plane across the pivot axis.
        task: the strike as planned and as carried out, with the edges over which the object turns.
        settings: limits of the fit's window, of a clean tip and of the contact.
    """
    found = _analysed(motion, task, settings)
    if (until := next_take_over(found, task)) is not None:
        if reaches(found, until):
            found = _analysed(motion, replace(task, landing_angle_rad=until), settings)
        return balanced_before(found, until)
    about = about_next_line(motion, task, found, settings.window)
    if about is None:
        return found
    again = _analysed(about.motion, about.task, settings, about.course)
    return counted_for_line(motion, again, about) or found


def _analysed(
    motion: PlanarMotion, task: StrikeTask, settings: MotionSettings, course: Course | None = None
) -> TipMotion:
    """Analyse the motion of one strike as a tip about the planned pivot line.

    Args:
        motion: the motion in the plane across the pivot axis.
        task: the strike as planned and as carried out.
        settings: limits of the fit's window, of a clean tip and of the contact.
        course: events of the strike; None to find them in the motion. The paper's estimator is left out if
            they are given, as it needs the motion from the impact on.

    Returns:
        The motion with its verdict: a wrong edge if it balanced over another line. Fit and energy ratio are
        None if the object did not tip, nothing fits, or the balance angle is too uncertain; tipping angle and
        phases too if the images end too early.
    """
    if (unseen := _judge_unseen(task)) is not None:
        return _without_motion(task, unseen)
    tracked = motion
    if task.section is not None and is_curved(task.section, task.planned.phi_predicted_rad):
        motion = relative_to_rolling(motion, task.section, task.planned)
    angle = motion.angle
    whole = course is None
    course = course or find_course(angle, task.contact_time_ns, settings.window, task.landing_angle_rad)
    judgement = judge_motion(motion, course, task, settings.verdict)
    tipped = (
        float(np.max(angle.theta[course.moved_frame : course.end_frame], initial=0.0))
        >= settings.verdict.min_turn
    )
    if course.released_frame is None or not tipped:
        return _result(task, judgement or Judgement(Verdict.NOT_MOVED, "no tip"), angle, course, None, ())
    fits = fit_strike(motion, course, task.planned, settings, task.section)
    if fits.chosen is None:
        rolls = task.planned.rolls
        window = free_window(angle, course, task.planned.phi_predicted_rad, settings.window, rolls=rolls)
        contact = judge_contact(fits.motion, window, rolls, settings.verdict)
        judgement = judgement or fits.second_impact or contact or _judge_unfitted(angle, course, fits.problem)
        return _result(task, judgement, angle, course, None, ())
    fit, impact = _with_contact(fits.chosen, fits.motion, task, settings), fits.second_impact
    top = float(np.max(angle.theta[course.released_frame : course.end_frame]))
    place = measure_pivot(tracked, fit)
    vague = judge_vague(fit, course, top, settings.verdict)
    until_balance = _window_to_balance(angle, course.released_frame, fit)
    judgement = (
        judgement
        or judge_support(motion, fit, place, task)
        or impact
        or judge_contact(fits.motion, until_balance, task.planned.rolls, settings.verdict)
        or judge_heading(fits.motion, fit.window, task.planned.rolls)
        or judge_place(place, fit, task.edge_sd)
    )
    if vague is not None:
        # Rolling aside on a rim makes phi uncertain; balance has no certain frame then: judge the whole fit.
        seen = judge_contact(fits.motion, fit.window, task.planned.rolls, settings.verdict)
        rolled = seen if seen is not None and seen.code is Verdict.ROLLED else None
        return _result(task, judgement or rolled or vague, angle, course, None, ())
    ratio = _energy_ratio(fit)
    judgement = judgement or judge_hard(fits.motion, course, ratio, settings.verdict)
    found = _result(
        task,
        judgement or judge_fit(fit, course, ratio, top),
        angle,
        course,
        fit,
        (
            *fits.others,
            *(sign_change_alternatives(angle, course, fit, settings.smoothing_points) if whole else ()),
        ),
    )
    return replace(found, pivot_place=place)


def verdict_of(motion: TipMotion) -> StrikeVerdict:
    """Verdict on an analysed strike as a record for the user, the answer of `analyze watch`.

    It holds code and reason; balance angle phi and its sd [rad] and the energy ratio (kinetic energy after
    the strike over that needed to reach balance), None without a fit; and the largest tipping angle [rad] of
    an object that rocked back, None for other verdicts or if unknown.
    """
    fit, top = motion.fit, None
    if (
        motion.verdict is Verdict.ROCKED_BACK
        and motion.angle is not None
        and motion.phases is not None
        and motion.phases.stage_one
    ):
        top = float(np.max(motion.angle.theta[slice(*motion.phases.stage_one)]))
    return StrikeVerdict(
        strike_id=motion.strike_id,
        code=motion.verdict,
        reason=motion.reason,
        phi=fit.phi if fit else None,
        phi_sd=float(np.sqrt(fit.covariance[0, 0])) if fit else None,
        energy_ratio=motion.energy_ratio,
        theta_max_rad=top,
    )


def _judge_unseen(task: StrikeTask) -> Judgement | None:
    """Verdict "unreadable" if a strike's images end too early to show whether the object moved, else None.

    Too early is before 0.2 s after the contact, or no image at all. None also if it is unknown when the
    images end, or if there are images but no measured contact time.
    """
    end = task.images_end_ns
    if end is None or (end and not task.contact_time_ns) or end >= task.contact_time_ns + _MIN_SEEN_NS:
        return None
    after_ms = 1e-6 * (end - task.contact_time_ns)
    side = "after" if after_ms >= 0 else "before"
    where = "it has no images" if not end else f"its images end {abs(after_ms):.0f} ms {side} the contact"
    return Judgement(Verdict.UNREADABLE, f"{where}: the camera was lost, or came late; strike again")


def end_of_rest_ns(tracks: Sequence[MarkerTrack], contact_time_ns: int) -> int:
    """Time [ns] at which rest ends: 4 ms before the contact, or at a marker's earlier motion.

    It is on the recording's clock (log_time).

    Without a known contact time and without motion it is 1 ns after the last tracked frame; then 0 if there
    are no tracks either.

    Args:
        tracks: the object's markers.
        contact_time_ns: time of the contact on the recording's clock [ns], 0 if unknown.
    """
    ends = [contact_time_ns - _REST_BEFORE_CONTACT_NS] if contact_time_ns else []
    for track in tracks:
        if len(track.time_ns) < 6:
            continue
        first = np.median(track.corners_px[:5], axis=0)
        away = np.max(np.abs(track.corners_px - first), axis=(1, 2)) > np.maximum(
            _STILL_PX, 8.0 * track.corner_sd_px
        )
        moving = away[:-1] & away[1:]
        if np.any(moving):
            ends.append(int(track.time_ns[max(int(np.argmax(moving)) - 1, 1)]))
    return min(
        ends, default=max((int(track.time_ns[-1]) + 1 for track in tracks if len(track.time_ns)), default=0)
    )


def _judge_unfitted(angle: TipAngle, course: Course, reason: str) -> Judgement:
    """Verdict on a strike whose tipping angle theta(t) could not be fitted: rocked back, or unreadable.

    Args:
        angle: theta(t).
        course: events of the strike (first motion, release, top, end).
        reason: why no fit was possible; it becomes the reason of the verdict "unreadable".
    """
    if course.came_back and course.top_frame is not None:
        top = math.degrees(float(angle.theta[course.top_frame]))
        return Judgement(
            Verdict.ROCKED_BACK,
            f"rocked back from {top:.1f} deg, too small a turn to be fitted: strike harder",
        )
    return Judgement(Verdict.UNREADABLE, reason)


def _with_contact(
    fit: MotionFit, motion: PlanarMotion, task: StrikeTask, settings: MotionSettings
) -> MotionFit:
    """Copy of a fit whose covariance includes the errors of contact and camera.

    It is the (2, 2) covariance of balance angle phi [rad] and rate k [rad/s^2] of the tip.

    Args:
        fit: the chosen fit of the tipping angle.
        motion: the motion with slip and lift of the pivot edge; they give the error of a hinge fit, which
            takes the edge as staying in place.
        task: the strike as planned and as carried out.
        settings: errors of a usual contact.
    """
    planned = task.planned
    hinge = fit.estimator == "pivot_fit"
    creep = creep_error(fit, motion, planned.pivot.radius_m) if hinge else None
    fit = with_contact_errors(fit, planned.rolls, settings.contact, creep)
    return with_slow_error(fit, motion, planned.rolls, planned.pivot.radius_m)


def _window_to_balance(angle: TipAngle, released: int, fit: MotionFit) -> tuple[int, int]:
    """Frames [start, stop) from release to 5 deg past balance, in which the contact is judged.

    The balance angle phi depends little on what the contact does later.

    Args:
        angle: tipping angle of the strike.
        released: first frame in which only gravity and the table act.
        fit: fit with the balance angle phi; its window limits the result.
    """
    last = fit.window[1]
    past = np.flatnonzero(angle.theta[released:last] > fit.phi + 0.09)
    return released, (released + int(past[0]) if len(past) else last)


def _result(
    task: StrikeTask,
    judgement: Judgement,
    angle: TipAngle,
    course: Course,
    fit: MotionFit | None,
    alternatives: tuple[MotionFit, ...],
) -> TipMotion:
    """TipMotion (result) of an analysed strike, with its phases and energy ratio.

    The energy ratio is the kinetic energy after the strike over that needed to reach balance.

    Args:
        task: the strike as planned and as carried out.
        judgement: verdict on the motion, such as good or slid, with its reason.
        angle: tipping angle theta(t).
        course: frames of first motion, release, largest angle and end.
        fit: the chosen fit; None if there is none, then there is no energy ratio.
        alternatives: fits by other estimators, for comparison.
    """
    return TipMotion(
        strike_id=task.strike_id,
        plan_strike_id=task.planned.id,
        verdict=judgement.code,
        reason=judgement.reason,
        angle=angle,
        phases=phases_of(angle, course, fit.phi if fit else None),
        fit=fit,
        alternatives=alternatives,
        energy_ratio=_energy_ratio(fit) if fit else None,
    )


def _energy_ratio(fit: MotionFit) -> float:
    """Energy ratio of a fitted strike: its energy over that needed to reach balance; 1 just reaches it.

    It is that of the fit with a rolling contact if there is one, else that of the fit as a hinge (the edge
    stays in place).
    """
    return (
        fit.rolling.energy_ratio
        if fit.rolling
        else energy_ratio(fit.phi, fit.k or 1.0, fit.theta0, fit.omega0)
    )


def _without_motion(task: StrikeTask, judgement: Judgement) -> TipMotion:
    """TipMotion (result) of a strike without measured motion: ids, verdict and its reason, nothing else."""
    return TipMotion(task.strike_id, task.planned.id, judgement.code, judgement.reason)
