"""Verdict on a strike, with measured values and the advice to the user in one sentence.

The verdict `struck_twice` is decided in fit_choice.py, where fits with one and two impacts are compared. A
strike is one impact that should tip the object about an edge.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.strike_task import Judgement
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from analyze.motion.phases import Course
    from analyze.motion.settings import VerdictLimits
    from analyze.motion.strike_task import StrikeTask
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import Array, IntArray, MotionFit, TipAngle

ROLLED_REMEDY = (
    "turn its heavy side towards the striker or away from it, or stick on a foot with straight edges and "
    "scan both together"
)
"""remedy for an object that rolls aside on its rim: its centre of mass is beside the striker's line"""
_SEEN_PAST_PHI = math.radians(35.0)
"""angle past the predicted phi [rad] up to which the marker must be seen: the fitted window, and the error of
phi"""
_LOST_BELOW = math.radians(30.0)
"""last seen theta [rad] below which a tip without an end counts as lost"""
_MEDIAN_FRAMES = 5
"""width of the running median [frames]"""


def judge_motion(
    motion: PlanarMotion, course: Course, task: StrikeTask, limits: VerdictLimits
) -> Judgement | None:
    """Verdict on a motion that is not a tip, or was not seen completely; None if it looks like a tip.

    The verdict is one of not moved, slid, marker lost, unreadable.

    Args:
        motion: the motion through the whole window of the strike.
        course: its first motion, release and end.
        task: the strike as planned and as carried out.
        limits: limits of a clean tip.
    """
    angle = motion.angle
    if course.moved_frame is None or course.released_frame is None:
        return _not_moved(motion, float(np.max(angle.theta, initial=0.0)), limits)
    frame_ns = float(np.median(np.diff(angle.time_ns)))
    # With the frame before: a gap may hide the beginning of the motion.
    free = slice(max(course.moved_frame - 1, 0), course.end_frame)
    times = angle.time_ns[free]
    # The marker may turn away from the camera while the object lands: missing frames do not count there.
    times = times[: 1 + int(np.sum(angle.theta[free][:-1] < task.planned.phi_predicted_rad + _SEEN_PAST_PHI))]
    gaps = _gaps(angle, course, times, frame_ns, task, limits)
    if gaps is not None:
        return gaps
    peak = float(np.max(angle.theta[free]))
    return _not_moved(motion, peak, limits) if peak < limits.min_turn else None


def _gaps(
    angle: TipAngle, course: Course, times: IntArray, frame_ns: float, task: StrikeTask, limits: VerdictLimits
) -> Judgement | None:
    """Verdict on missing images or markers during a tip; None if enough were seen.

    "Marker lost" if too many frames in a row or in all lack a marker, or the tip is lost before its end;
    "unreadable" if the camera delivered no images for too long.

    Args:
        angle: tipping angle theta(t).
        course: events of the strike.
        times: (n,) times of the frames of the tip on the recording's clock (log_time) [ns].
        frame_ns: usual time between frames [ns].
        task: the strike, with the times of images without a marker.
        limits: limits of missing frames.
    """
    apart_ns = np.diff(times)
    if task.unmarked_ns is None:
        missed = np.rint(apart_ns / frame_ns) - 1.0
    else:
        missed = np.diff(np.searchsorted(task.unmarked_ns, times))
    longest = int(np.max(missed, initial=0.0))
    share = len(times) / (len(times) + float(np.sum(missed)))
    unseen_end = (task.images_end_ns - int(angle.time_ns[-1])) / frame_ns if task.images_end_ns else 0.0
    unfinished = (
        course.end_frame == len(angle.theta) and not course.came_back and angle.theta[-1] < _LOST_BELOW
    )
    lost_early = unseen_end > limits.max_marker_gap and unfinished
    if longest > limits.max_marker_gap or share < limits.min_marker_share or lost_early:
        gone = max(longest, round(unseen_end) if lost_early else 0)
        text = f"not seen for {gone} frames during the tip: light tag or print, or move the camera back"
        return Judgement(Verdict.MARKER_LOST, text)
    longest_ns = float(np.max(apart_ns, initial=0.0))
    if longest_ns > max(
        limits.max_image_gap_share * float(np.sum(apart_ns)), (limits.max_marker_gap + 1) * frame_ns
    ):
        missing = f"no images for {1e-6 * longest_ns:.0f} ms during the tip"
        return Judgement(Verdict.UNREADABLE, f"{missing}: the camera left frames out; strike again")
    return None


def _not_moved(motion: PlanarMotion, peak: float, limits: VerdictLimits) -> Judgement:
    """Verdict on an object that did not tip: slid, or not moved.

    Args:
        motion: motion through the whole window of the strike.
        peak: largest tipping angle theta [rad], for the message.
        limits: largest sliding that does not count.
    """
    slip = smooth_peak(np.abs(motion.angle.slip), motion.position_sd)
    turned = f"turned by {math.degrees(peak):.2f} deg at most"
    if slip > limits.slip:
        text = f"the object slid by {1e3 * slip:.1f} mm and {turned}: use a rougher table or strike higher"
        return Judgement(Verdict.SLID, text)
    return Judgement(Verdict.NOT_MOVED, f"the object {turned}: move the striker closer, or strike harder")


def judge_contact(
    motion: PlanarMotion, window: tuple[int, int], rolls: bool, limits: VerdictLimits
) -> Judgement | None:
    """Verdict on a contact that lifted, twisted or slid within a window; None if it held.

    The verdict is "airborne", "twisted" ("rolled" on a round rim) or "slid"; the first that applies is
    returned. On a rim "rolled" comes first: rolling along the rim lifts the planned point off the table.

    Args:
        motion: motion with slip and lift of the edge, and rotation about other axes (twist).
        window: frames [start, stop).
        rolls: True if the edge is a round rim.
        limits: limits of a clean tip.
    """
    used = slice(*window)
    sd = motion.position_sd[used]
    lift = smooth_peak(motion.lift[used], sd)
    twist = smooth_peak(motion.angle.off_axis[used], motion.off_axis_sd[used])
    rolled = rolls and twist > limits.twist
    if lift > limits.lift and not rolled:
        text = f"the edge left the table by {1e3 * lift:.1f} mm: strike lower or less hard"
        return Judgement(Verdict.AIRBORNE, text)
    if twist > limits.twist:
        by = f"by {math.degrees(twist):.1f} deg about other axes"
        if rolls:
            return Judgement(Verdict.ROLLED, f"the object rolled on its rim {by}: {ROLLED_REMEDY}")
        return Judgement(Verdict.TWISTED, f"the object twisted {by}: strike through its middle")
    slip = smooth_peak(np.abs(motion.angle.slip[used]), sd)
    if slip > limits.slip:
        text = f"the edge slid by {1e3 * slip:.1f} mm: use a rougher table or strike higher"
        return Judgement(Verdict.SLID, text)
    return None


def judge_hard(
    motion: PlanarMotion, course: Course, energy_ratio: float, limits: VerdictLimits
) -> Judgement | None:
    """Verdict "airborne" on a strike so hard that the object left the table; None if it did not.

    None also below the energy ratio `limits.hard_energy_ratio`, or if the object did not move. The verdict
    comes with a sentence for the user.

    Args:
        motion: motion with the height [m] of the pivot edge over its place at rest (lift).
        course: events of the strike; the free motion from release to end is checked.
        energy_ratio: energy of the strike over the energy needed to tip.
        limits: limits of energy ratio and lift.
    """
    if energy_ratio < limits.hard_energy_ratio or course.released_frame is None:
        return None
    free = slice(course.released_frame, course.end_frame)
    lift = smooth_peak(motion.lift[free], motion.position_sd[free])
    if lift <= limits.lift:
        return None
    height = f"{1e3 * lift:.1f} mm after the balance point"
    text = f"the edge left the table by {height}, energy ratio {energy_ratio:.1f}: strike less hard"
    return Judgement(Verdict.AIRBORNE, text)


def judge_vague(fit: MotionFit, course: Course, theta_max: float, limits: VerdictLimits) -> Judgement | None:
    """Verdict on a strike whose balance angle phi is too uncertain for use; None if phi is usable.

    "Rocked back" if the object came back or did not reach phi, otherwise "unreadable".

    Args:
        fit: the chosen fit, with phi and its variance.
        course: events of the strike.
        theta_max: largest tipping angle [rad].
        limits: largest standard deviation of phi.
    """
    sd = math.sqrt(float(fit.covariance[0, 0]))
    if sd <= limits.phi_sd:
        return None
    known = f"its balance point is known to {math.degrees(sd):.0f} deg only"
    if course.came_back or theta_max < fit.phi:
        return Judgement(
            Verdict.ROCKED_BACK, f"rocked back from {math.degrees(theta_max):.1f} deg, {known}: strike harder"
        )
    return Judgement(Verdict.UNREADABLE, f"{known}: strike less hard, or bring the marker nearer")


def judge_fit(fit: MotionFit, course: Course, energy_ratio: float, theta_max: float) -> Judgement:
    """Verdict on a strike in which nothing was found wrong: the object tipped over (good) or rocked back.

    Args:
        fit: the chosen fit of the tipping angle, with the balance angle phi [rad].
        course: events of the strike; they show whether the object came back to rest on its first face.
        energy_ratio: kinetic energy after the strike over the energy needed to reach balance.
        theta_max: largest tipping angle [rad].
    """
    phi = math.degrees(fit.phi)
    if course.came_back or (energy_ratio < 1.0 and theta_max < fit.phi):
        return Judgement(
            Verdict.ROCKED_BACK,
            f"rocked back from {math.degrees(theta_max):.1f} deg of {phi:.1f} deg,"
            f" energy ratio {energy_ratio:.2f}: strike harder",
        )
    return Judgement(Verdict.GOOD, f"tipped over at {phi:.2f} deg, energy ratio {energy_ratio:.2f}")


def smooth_peak(values: Array, sd: Array) -> float:
    """Largest running median over five values, less twice the mean of their sd; at least 0.

    In the unit of the values; 0 if there are none.

    Args:
        values: (n,) values, one per frame.
        sd: (n,) their standard deviations.
    """
    if not len(values):
        return 0.0
    size = min(_MEDIAN_FRAMES, len(values))
    windows = np.lib.stride_tricks.sliding_window_view(values, size)
    noise = np.lib.stride_tricks.sliding_window_view(sd, size).mean(axis=1)
    return float(np.max(np.median(windows, axis=1) - 2.0 * noise, initial=0.0))
