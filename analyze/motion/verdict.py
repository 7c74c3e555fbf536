"""How a strike ended, with the numbers behind it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schemas.result import Verdict

if TYPE_CHECKING:
    from analyze.motion.phases import Course
    from analyze.motion.strike import StrikeTask
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import Array, MotionFit


@dataclass(frozen=True)
class VerdictLimits:
    """When a strike is no clean tip."""

    not_moved: float = math.radians(0.5)
    """rad"""
    slip: float = 0.004
    """m along the table, before the balance point"""
    lift: float = 0.002
    """m off the table"""
    edge_moved: float = 1.5e-4
    """m of sliding or lifting, beyond noise, from which on the edge is no longer taken for a hinge"""
    twist: float = math.radians(5.0)
    """rad about other axes than the pivot"""
    kick_ratio: float = 0.06
    """sudden change of speed over the speed at release"""
    second_blow: float = 0.12
    """the same, from which on it is a second blow however early it comes"""
    kick_chi2: float = 14.0
    """what a sudden change of speed must better the fit by: noise alone does that to one strike in some two hundred"""
    too_hard: float = 3.5
    """energy ratio from which on a lift at any time before the landing counts: 1.03 to 1.3 is planned, up to 3 may happen"""
    phi_sd: float = math.radians(1.0)
    """rad; a fit that knows phi worse than this is not used"""
    found: float = 0.8
    """share of frames with a marker between strike and landing"""
    gap: int = 5
    """frames in a row without one"""
    left_out: float = 0.4
    """share of the tip's time, in one piece, of which there are no images: what moves by gravity alone is foretold across less"""


_SEEN_PAST_PHI = math.radians(35.0)
"""of the predicted phi, until where the marker must be seen: the fitted window, and what phi may be off"""


@dataclass(frozen=True)
class Judgement:
    """A verdict with its reason."""

    code: Verdict
    reason: str


def _smooth_peak(values: Array, sd: Array) -> float:
    """Largest median of five neighbours (of all, where there are fewer) that is more than its own noise."""
    if not len(values):
        return 0.0
    size = min(5, len(values))
    windows = np.lib.stride_tricks.sliding_window_view(values, size)
    noise = np.lib.stride_tricks.sliding_window_view(sd, size).mean(axis=1)
    return float(np.max(np.median(windows, axis=1) - 2.0 * noise, initial=0.0))


def judge_motion(motion: PlanarMotion, course: Course, task: StrikeTask, limits: VerdictLimits) -> Judgement | None:
    """Verdicts that the raw motion gives, None where it looks like a tip."""
    angle = motion.angle
    if course.moved is None or course.released is None:
        return _not_moved(motion, float(np.max(angle.theta, initial=0.0)), limits)
    frame_ns = float(np.median(np.diff(angle.time_ns)))
    # With the frame before: a gap may hide how it began to move.
    free = slice(max(course.moved - 1, 0), course.ended)
    times = angle.time_ns[free]
    # Where it lies down the marker may turn away: nothing is missed then.
    times = times[: 1 + int(np.sum(angle.theta[free][:-1] < task.planned.phi_predicted_rad + _SEEN_PAST_PHI))]
    apart_ns = np.diff(times)
    missed = np.rint(apart_ns / frame_ns) - 1.0 if task.unmarked_ns is None else np.diff(np.searchsorted(task.unmarked_ns, times))
    longest = int(np.max(missed, initial=0.0))
    share = len(times) / (len(times) + float(np.sum(missed)))
    unseen_end = (task.images_end_ns - int(angle.time_ns[-1])) / frame_ns if task.images_end_ns else 0.0
    lost_early = (
        unseen_end > limits.gap and course.ended == len(angle.theta) and not course.came_back and angle.theta[-1] < math.radians(30.0)
    )
    if longest > limits.gap or share < limits.found or lost_early:
        gone = max(longest, round(unseen_end) if lost_early else 0)
        return Judgement(Verdict.MARKER_LOST, f"no marker for {gone} frames during the tip: light the marker, or move the camera back")
    left_out_ns = float(np.max(apart_ns, initial=0.0))
    if left_out_ns > max(limits.left_out * float(np.sum(apart_ns)), (limits.gap + 1) * frame_ns):
        text = f"no images for {1e-6 * left_out_ns:.0f} ms during the tip: the camera left frames out; strike again"
        return Judgement(Verdict.UNREADABLE, text)
    if float(np.max(angle.theta[free])) < limits.not_moved:
        return _not_moved(motion, float(np.max(angle.theta[free])), limits)
    return None


def _not_moved(motion: PlanarMotion, peak: float, limits: VerdictLimits) -> Judgement:
    slip = _smooth_peak(np.abs(motion.angle.slip), motion.position_sd)
    turned = f"turned by {math.degrees(peak):.2f} deg at most"
    if slip > limits.slip:
        return Judgement(Verdict.SLID, f"the object slid by {1e3 * slip:.1f} mm and {turned}: use a rougher table or strike higher")
    return Judgement(Verdict.NOT_MOVED, f"the object {turned}: move the striker closer, or strike harder")


def judge_contact(motion: PlanarMotion, window: tuple[int, int], rolls: bool, limits: VerdictLimits) -> Judgement | None:
    """Verdicts on what the contact did within the fitted window."""
    used = slice(*window)
    sd = motion.position_sd[used]
    lift = _smooth_peak(motion.lift[used], sd)
    if lift > limits.lift:
        return Judgement(Verdict.AIRBORNE, f"the edge left the table by {1e3 * lift:.1f} mm: strike lower or less hard")
    twist = _smooth_peak(motion.angle.off_axis[used], motion.off_axis_sd[used])
    if twist > limits.twist:
        code = Verdict.ROLLED if rolls else Verdict.TWISTED
        what = "rolled on its rim" if rolls else "twisted"
        return Judgement(code, f"the object {what} by {math.degrees(twist):.1f} deg about other axes: strike through its middle")
    slip = _smooth_peak(np.abs(motion.angle.slip[used]), sd)
    if slip > limits.slip:
        return Judgement(Verdict.SLID, f"the edge slid by {1e3 * slip:.1f} mm: use a rougher table or strike higher")
    return None


def judge_hard(motion: PlanarMotion, course: Course, energy_ratio: float, limits: VerdictLimits) -> Judgement | None:
    """Verdict on a strike so hard that the object flew, though only after its balance point; None where it did not."""
    if energy_ratio < limits.too_hard or course.released is None:
        return None
    free = slice(course.released, course.ended)
    lift = _smooth_peak(motion.lift[free], motion.position_sd[free])
    if lift <= limits.lift:
        return None
    text = f"the edge left the table by {1e3 * lift:.1f} mm after the balance point, energy ratio {energy_ratio:.1f}: strike less hard"
    return Judgement(Verdict.AIRBORNE, text)


def judge_vague(fit: MotionFit, course: Course, theta_max: float, limits: VerdictLimits) -> Judgement | None:
    """Verdict where the motion was fitted but says next to nothing of phi, None where it does."""
    sd = math.sqrt(float(fit.covariance[0, 0]))
    if sd <= limits.phi_sd:
        return None
    known = f"its balance point is known to {math.degrees(sd):.0f} deg only"
    if course.came_back or theta_max < fit.phi:
        return Judgement(Verdict.ROCKED_BACK, f"rocked back from {math.degrees(theta_max):.1f} deg, {known}: strike harder")
    return Judgement(Verdict.UNREADABLE, f"{known}: strike less hard, or bring the marker nearer")


def judge_fit(fit: MotionFit, course: Course, energy_ratio: float, theta_max: float) -> Judgement:
    """Verdict of a clean motion: over the top, or back."""
    phi = math.degrees(fit.phi)
    if course.came_back or (energy_ratio < 1.0 and theta_max < fit.phi):
        return Judgement(
            Verdict.ROCKED_BACK,
            f"rocked back from {math.degrees(theta_max):.1f} deg of {phi:.1f} deg, energy ratio {energy_ratio:.2f}: strike harder",
        )
    return Judgement(Verdict.GOOD, f"tipped over at {phi:.2f} deg, energy ratio {energy_ratio:.2f}")
