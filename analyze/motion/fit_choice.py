"""Choice of the estimator for one strike: hinge, rolling contact, or moment balance, and its window.

The tipping angle theta(t) of a strike (one impact that tips the object about an edge) gives the balance angle
phi, at which the centre of mass stands above the edge, and the rate k [rad/s^2] of the tip. A hinge is an
edge that stays in place. The moment balance is a fit that allows for the edge's measured sliding and lifting.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from analyze.errors import EstimationError
from analyze.motion.balance_choice import balance_instead_of_hinge
from analyze.motion.edge_motion import edge_motion, lift_off_frame
from analyze.motion.free_motion import (
    LATEST_START,
    Estimator,
    holds_balance,
    is_jump,
    largest_jump,
    longest_clean_fit,
    settled_fit,
)
from analyze.motion.pendulum_fit import MIN_FRAMES, pivot_fit
from analyze.motion.phases import Course, free_window
from analyze.motion.rolling_choice import rolling_curve
from analyze.motion.rolling_fit import rolling_fit
from analyze.motion.strike_task import Judgement
from analyze.motion.two_impact_fit import fit_two_impacts
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from analyze.motion.settings import MotionSettings, VerdictLimits, WindowLimits
    from analyze.motion.support_function import SupportFunction
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import MotionFit, TipAngle
    from schemas.strike_plan import PlannedStrike

_FIRST_TOUCH_FRAMES = 4
"""number of frames at the window's start that may belong to a long first touch; the clean stretch leaves them
out"""


@dataclass(frozen=True)
class StrikeFits:
    """Fits of the motion of one strike (impact that tips the object), with the one chosen."""

    chosen: MotionFit | None
    """the fit to use; None if nothing fits"""
    others: tuple[MotionFit, ...]
    """fits that were rejected, for comparison"""
    motion: PlanarMotion
    """the motion, with the slip and lift of the true edge"""
    second_impact: Judgement | None = None
    """verdict on a second impact that splits the motion; None if there is none"""
    problem: str = ""
    """reason why nothing fits; empty if a fit was chosen"""


@dataclass(frozen=True)
class _WindowFit:
    """Outcome of one estimator's fit over one window of frames: the fit, or the reason for its failure."""

    fit: MotionFit | None
    """the fit; None if nothing fits"""
    window: tuple[int, int]
    """frames [start, stop)"""
    problem: str = ""
    """reason why there is no fit; empty if there is one"""


def fit_strike(
    motion: PlanarMotion,
    course: Course,
    planned: PlannedStrike,
    settings: MotionSettings,
    section: SupportFunction | None = None,
) -> StrikeFits:
    """Fit phi [rad] and k [rad/s^2] of a strike by the estimator that its contact requires.

    The tip is theta'' = -k sin(phi - theta), with theta the tipping angle and phi the balance angle. The
    estimators are a hinge (edge in place), a rolling contact, and the moment balance (with the edge's
    measured motion); if none fits, two impacts are tried. The window of the fit ends a fixed angle past phi
    (25 deg by default), so that it is found by iteration; earlier if the object lands, returns to rest or
    leaves the edge.

    Args:
        motion: the motion through the whole window of the strike.
        course: events of the strike, with the release (first frame in which only gravity acts).
        planned: the planned strike; its predicted phi gives the first window.
        settings: limits of the window, of a moved edge and of jumps in speed.
        section: the object's cross-section at the pivot axis; None if its shape is unknown.

    Returns:
        The chosen fit and the rejected ones; `chosen` is None, with the reason in `problem`, if nothing fits.
    """
    curve, rolls = rolling_curve(section, planned)
    radius = planned.pivot.radius_m
    if curve is None:
        return _fits(motion, course, planned, settings, partial(pivot_fit, radius=radius), radius)
    # The moment balance holds on a circle about the pivot as well, but on no other curve.
    balance_radius = None if curve is section else radius
    fits = _fits(motion, course, planned, settings, partial(rolling_fit, section=curve), balance_radius)
    return _explain_rolling(fits, motion.angle, rolls, settings.verdict)


def _fits(
    motion: PlanarMotion,
    course: Course,
    planned: PlannedStrike,
    settings: MotionSettings,
    estimator: Estimator,
    radius: float | None,
) -> StrikeFits:
    """Fits of a strike by the moment balance if it suits the motion better, else by `estimator`.

    The moment balance is a fit that allows for the edge's measured motion. It mostly suits better where the
    edge moved; the fit by `estimator` is kept if the moment balance fails. The window is the one found by
    iteration with `estimator`. If the edge leaves the table within it and does not come back, all fits end at
    that frame, provided the motion up to there can be fitted; the chosen fit's note then states so.

    Args:
        motion: the motion through the whole window of the strike.
        course: events of the strike.
        planned: the planned strike; its predicted balance angle gives the first window.
        settings: settings of the motion analysis, such as the bounds of the window.
        estimator: function that fits the tipping angle theta(t) over a window.
        radius: radius of the edge's rounding for the moment balance [m]; None to leave the moment balance
            out.

    Returns:
        The fits with the chosen one; `chosen` is None if nothing fits.
    """
    whole = _fit_window(motion.angle, course, planned, settings.window, estimator)
    left = lift_off_frame(edge_motion(motion, whole.window).motion, whole.window)
    until = None if left is None else _fit_until(motion.angle, (whole.window[0], left), estimator)
    if left is None or until is None:
        return _fits_over(motion, whole, planned, settings, estimator, radius)
    fits = _fits_over(motion, until, planned, settings, estimator, radius)
    if fits.chosen is None:
        return fits
    turned = (
        f"ends at {math.degrees(float(motion.angle.theta[left])):.0f} deg, where the next edge takes over"
    )
    return replace(fits, chosen=replace(fits.chosen, note=_joined(fits.chosen.note, turned)))


def _joined(*notes: str) -> str:
    """Notes that are not empty, joined by "; " in one line; empty if there are none."""
    return "; ".join(note for note in notes if note)


def _fit_window(
    angle: TipAngle, course: Course, planned: PlannedStrike, limits: WindowLimits, estimator: Estimator
) -> _WindowFit:
    """Fit over the window that ends a fixed angle past the fit's own balance angle phi, by iteration.

    Args:
        angle: tipping angle theta(t) of the strike.
        course: events of the strike.
        planned: the planned strike; its predicted balance angle gives the first window.
        limits: bounds of the window.
        estimator: function that fits theta(t) over a window.

    Returns:
        The last fit with its window, frames [start, stop). The fit is None, with the reason, if any fit of
        the iteration fails.
    """
    window = free_window(angle, course, planned.phi_predicted_rad, limits, rolls=planned.rolls)
    try:
        fit = estimator(angle, window)
        for _ in range(3):
            again = free_window(angle, course, fit.phi, limits, rolls=planned.rolls)
            if again == window or again[1] - again[0] < MIN_FRAMES:
                break
            fit = estimator(angle, again)
            window = again
    except EstimationError as error:
        return _WindowFit(None, window, str(error))
    return _WindowFit(fit, window)


def _fit_until(angle: TipAngle, window: tuple[int, int], estimator: Estimator) -> _WindowFit | None:
    """Fit of the tipping angle over one window of frames, with that window; None if unusable.

    None if the window has fewer than 16 frames, if the fit fails, or if the angle in the window neither
    passes the balance point nor turns back below it.

    Args:
        angle: tipping angle theta(t) of the strike.
        window: frames [start, stop) to fit; it ends where the edge leaves the table.
        estimator: function that fits theta(t) over a window.
    """
    if window[1] - window[0] < 2 * MIN_FRAMES:
        return None
    try:
        fit = estimator(angle, window)
    except EstimationError:
        return None
    return _WindowFit(fit, window) if holds_balance(angle, fit) else None


def _fits_over(
    motion: PlanarMotion,
    found: _WindowFit,
    planned: PlannedStrike,
    settings: MotionSettings,
    estimator: Estimator,
    radius: float | None,
) -> StrikeFits:
    """Fits over one window: by the moment balance if it suits the motion better, else by the estimator.

    The moment balance is a fit that allows for the edge's measured motion; it is preferred if the edge moved,
    or if it clearly explains the motion better. Where the angular speed jumps, the estimator is applied to a
    part of the window without a jump. The jump is reported as a second impact, unless such a part was found
    and the jump is either a touch by the striker in the first frames, or a loss of speed at the table
    while the edge moved.

    Args:
        motion: the motion through the whole window of the strike.
        found: fit over the window by `estimator`.
        planned: the planned strike.
        settings: limits.
        estimator: function that fits the tipping angle theta(t) over a window.
        radius: radius of the edge's rounding for the moment balance [m]; None to leave the moment balance
            out.

    Returns:
        The chosen fit and the rejected ones, with a verdict on a second impact; `chosen` is None if nothing
        fits.
    """
    hinge, window = found.fit, found.window
    angle, limits = motion.angle, settings.verdict
    edge = edge_motion(motion, window)
    balanced, why = (
        balance_instead_of_hinge(edge, window, hinge, planned, limits) if radius is not None else (None, "")
    )
    if balanced is not None:
        others = () if hinge is None else (replace(hinge, violated=(why,)),)
        note = _joined(f"chosen because {why}", balanced.note)
        return StrikeFits(replace(balanced, note=note), others, edge.motion)
    if hinge is None:
        return _with_second_impact(edge.motion, window, limits, found.problem, radius or 0.0)
    index, size, gain = largest_jump(angle, hinge)
    if not is_jump(hinge, size, gain, limits):
        return StrikeFits(settled_fit(hinge, partial(estimator, angle)), (), edge.motion)
    clean = longest_clean_fit(angle, window, estimator)
    # The motion after a light touch soon after the first is a free tip, and so is the motion after the table
    # slowed the object, which cannot happen unless the edge moves. Any other jump is a second impact.
    early = index - window[0]
    weak = abs(size) < limits.second_impact_ratio * abs(hinge.omega0)
    light = early < _FIRST_TOUCH_FRAMES or (early <= LATEST_START and weak)
    slowed = size < 0 and max(edge.slide_range, edge.lift_range) >= limits.edge_moved
    if clean is not None and (slowed or light):
        return StrikeFits(clean, (), edge.motion)
    reason = _jump_reason(angle, index, size, window)
    rest = (index + settings.window.guard_frames, window[1])
    fit = clean or hinge
    if clean is None and rest[1] - rest[0] >= 2 * MIN_FRAMES:
        try:
            fit = estimator(angle, rest)
        except EstimationError:
            reason += " (no fit after it)"
    return StrikeFits(fit, (), edge.motion, Judgement(Verdict.STRUCK_TWICE, reason))


def _explain_rolling(fits: StrikeFits, angle: TipAngle, rolls: str, limits: VerdictLimits) -> StrikeFits:
    """Fits of a strike with the chosen rolling fit explained, and a hinge fit added for comparison.

    The chosen fit's note states why the contact rolls, and its `violated` whether the contact slid or rose
    against rolling by more than the limit. A hinge is an edge that stays in place.

    Args:
        fits: fits of the strike; returned as they are if none is chosen, or the chosen one is not of rolling.
        angle: tipping angle theta(t).
        rolls: reason in words why the contact rolls.
        limits: their `edge_moved` [m] is the limit above which the edge counts as moved.
    """
    fit = fits.chosen
    if fit is None or fit.rolling is None:
        return fits
    used = edge_motion(fits.motion, fit.window)
    slid_mm, rose_mm = 1e3 * used.slide_range, 1e3 * used.lift_range
    slid = f"the contact slid by {slid_mm:.1f} mm and rose by {rose_mm:.1f} mm against rolling"
    violated = (slid,) if max(used.slide_range, used.lift_range) >= limits.edge_moved else ()
    others = (*fits.others, *_as_hinge(angle, fit.window, rolls))
    note = _joined(f"chosen because {rolls}", fit.note)
    return replace(fits, chosen=replace(fit, note=note, violated=violated), others=others)


def _as_hinge(angle: TipAngle, window: tuple[int, int], violated: str) -> tuple[MotionFit, ...]:
    """Fit of the motion as a pendulum about a fixed edge (hinge), to compare with a better fit.

    Args:
        angle: tipping angle theta(t).
        window: frames [start, stop).
        violated: the hinge's assumption that the strike breaks, in words; stored in the fit.

    Returns:
        The one fit; empty if it fails.
    """
    try:
        return (replace(pivot_fit(angle, window), violated=(violated,)),)
    except EstimationError:
        return ()


def _with_second_impact(
    motion: PlanarMotion, window: tuple[int, int], limits: VerdictLimits, problem: str, radius: float
) -> StrikeFits:
    """Fits with a jump in speed by a second impact, for a motion that no hinge (edge in place) fits.

    Args:
        motion: the motion with slip and lift of the true edge.
        window: frames [start, stop).
        limits: limits of a jump.
        problem: reason why a hinge did not fit.
        radius: radius of the edge's rounding [m].

    Returns:
        The fit as chosen, with the verdict "struck twice"; if there is no such jump, no fit and no verdict,
        but `problem`.
    """
    found = fit_two_impacts(motion.angle, window, radius)
    if found is None or not is_jump(found.fit, found.size, found.gain, limits):
        return StrikeFits(None, (), motion, problem=problem)
    reason = _jump_reason(motion.angle, found.index, found.size, window)
    return StrikeFits(found.fit, (), motion, Judgement(Verdict.STRUCK_TWICE, reason))


def _jump_reason(angle: TipAngle, index: int, size: float, window: tuple[int, int]) -> str:
    """Message about a second impact: size and time of the jump in speed, and what the user should do.

    Args:
        angle: tipping angle theta(t), with the times of the frames.
        index: frame of the jump.
        size: jump in angular speed [rad/s].
        window: frames [start, stop); its first frame is the time of the strike.
    """
    after = 1e-6 * (angle.time_ns[index] - angle.time_ns[window[0]])
    jumped = f"its speed jumped by {size:+.2f} rad/s {after:.0f} ms after the strike"
    return f"{jumped}: catch the striker after the first contact"
