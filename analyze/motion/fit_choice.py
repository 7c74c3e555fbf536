"""Which estimator suits what a strike shows, and why: hinge or rolling contact, over all or a clean stretch, or the moment balance."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.motion.balance_fit import moment_balance
from analyze.motion.contact import ContactErrors
from analyze.motion.edge_motion import edge_motion, left_table
from analyze.motion.free_motion import LATEST_START, Estimator, holds_balance, jump, longest_clean_fit, scatter, settled_fit
from analyze.motion.kicked_fit import kicked_fit
from analyze.motion.phases import Course, WindowLimits, free_window
from analyze.motion.pivot_fit import MIN_FRAMES, pivot_fit
from analyze.motion.rolling_choice import rolls_on
from analyze.motion.rolling_fit import rolling_fit
from analyze.motion.verdict import Judgement, VerdictLimits
from schemas.result import Verdict

if TYPE_CHECKING:
    from analyze.motion.edge_motion import EdgeMotion
    from analyze.motion.flank import Flank
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import MotionFit, TipAngle
    from schemas.strike_plan import PlannedStrike


_STILL_TOUCHED = 4
"""frames of the window that may still belong to a long first touch, whose end the clean stretch leaves out"""
_CLEAR_SIGHT = math.radians(0.2)
"""noise of a frame's angle, up to which a creeping edge can be told from it"""
_NOISIER = 1.5
"""scatter over the angle's own noise, up to which it is put down to where the edge was seen"""
_EXPLAINED = 0.25
"""share of a blow's evidence that may be left where the balance is to explain it"""
_SAME = 4.0
"""sd within which two values of phi are one"""
_APART, _APART_LEAST = 3.0, math.radians(0.02)
"""sd of the hinge's phi, and rad, that hinge and balance must differ by for that; less is within what the edge's place is known to"""


@dataclass(frozen=True)
class MotionSettings:
    """What a user may change; the defaults are the documented ones."""

    window: WindowLimits = field(default_factory=WindowLimits)
    verdict: VerdictLimits = field(default_factory=VerdictLimits)
    contact: ContactErrors = field(default_factory=ContactErrors)
    smoothing_points: int = 5
    """of the paper's sign_change"""


@dataclass(frozen=True)
class StrikeFits:
    """What the motion was fitted with."""

    chosen: MotionFit | None
    """None: nothing fits"""
    others: tuple[MotionFit, ...]
    motion: PlanarMotion
    """with what the edge itself did"""
    kick: Judgement | None = None
    """where a second kick splits the motion"""
    problem: str = ""
    """why nothing fits"""


@dataclass(frozen=True)
class _Hinge:
    """A fit that takes the edge for one that holds."""

    fit: MotionFit | None
    window: tuple[int, int]
    problem: str = ""
    """why there is no fit"""


def fit_strike(
    motion: PlanarMotion, course: Course, planned: PlannedStrike, settings: MotionSettings, section: Flank | None = None
) -> StrikeFits:
    """Fit the free motion over the window that phi itself bounds.

    Args:
        motion: through the whole window of the strike.
        course: what it did, with the release.
        planned: the strike; its phi says where to look first.
        settings: limits.
        section: of the object across the pivot axis, where its shape is known.
    """
    flank, rolls = rolls_on(section, planned)
    if flank is None:
        radius = planned.pivot.radius_m
        return _fits(motion, course, planned, settings, lambda angle, frames: pivot_fit(angle, frames, radius), radius)
    # On a circle about the pivot the moment balance is right as well; on any other flank it is not.
    bent = None if flank is section else planned.pivot.radius_m
    fits = _fits(motion, course, planned, settings, lambda angle, frames: rolling_fit(angle, frames, flank), bent)
    return _rolling(fits, motion.angle, rolls, settings.verdict) if fits.chosen is not None else fits


def _fits(
    motion: PlanarMotion, course: Course, planned: PlannedStrike, settings: MotionSettings, over: Estimator, radius: float | None
) -> StrikeFits:
    """The fit by `over`, or by the moment balance about a rounding of that radius (None: not by that)."""
    whole = _hinge(motion.angle, course, planned.phi_predicted_rad, settings.window, over)
    left = left_table(edge_motion(motion, whole.window).motion, whole.window)
    until = None if left is None else _until(motion.angle, (whole.window[0], left), over)
    if left is None or until is None:
        return _fits_over(motion, whole, planned, settings, over, radius)
    fits = _fits_over(motion, until, planned, settings, over, radius)
    if fits.chosen is None:
        return fits
    turned = f"ends at {math.degrees(float(motion.angle.theta[left])):.0f} deg, where it goes over to its next edge"
    return replace(fits, chosen=replace(fits.chosen, note="; ".join(part for part in (fits.chosen.note, turned) if part)))


def _until(angle: TipAngle, window: tuple[int, int], over: Estimator) -> _Hinge | None:
    """Over a window that ends where the edge leaves the table; None where too little is left of it to hold the balance point."""
    if window[1] - window[0] < 2 * MIN_FRAMES:
        return None
    try:
        fit = over(angle, window)
    except EstimationError:
        return None
    return _Hinge(fit, window) if holds_balance(angle, fit) else None


def _fits_over(
    motion: PlanarMotion, found: _Hinge, planned: PlannedStrike, settings: MotionSettings, over: Estimator, radius: float | None
) -> StrikeFits:
    hinge, window, problem = found.fit, found.window, found.problem
    angle, limits = motion.angle, settings.verdict
    edge = edge_motion(motion, window)
    balanced, why = _balanced(edge, window, hinge, planned, limits) if radius is not None else (None, "")
    if balanced is not None:
        others = () if hinge is None else (replace(hinge, violated=(why,)),)
        note = "; ".join(part for part in (f"chosen because {why}", balanced.note) if part)
        return StrikeFits(replace(balanced, note=note), others, edge.motion)
    if hinge is None:
        return _with_kick(edge.motion, window, limits, problem, radius or 0.0)
    index, size, gain = jump(angle, hinge)
    if not _kicked(hinge, size, gain, limits):
        return StrikeFits(settled_fit(hinge, lambda frames: over(angle, frames)), (), edge.motion)
    clean = longest_clean_fit(angle, window, over)
    # A light touch right after the first leaves all that follows as good, and so does the table where it slows the object down, which it
    # cannot do without moving the edge. Else it is a second blow.
    early = index - window[0]
    light = early < _STILL_TOUCHED or (early <= LATEST_START and abs(size) < limits.second_blow * abs(hinge.omega0))
    slowed = size < 0 and max(edge.slid, edge.lifted) >= limits.edge_moved
    if clean is not None and (slowed or light):
        return StrikeFits(clean, (), edge.motion)
    reason = _kick_reason(angle, index, size, window)
    rest = (index + settings.window.guard_frames, window[1])
    fit = clean or hinge
    if clean is None and rest[1] - rest[0] >= 2 * MIN_FRAMES:
        try:
            fit = over(angle, rest)
        except EstimationError:
            reason += " (no fit after it)"
    return StrikeFits(fit, (), edge.motion, Judgement(Verdict.STRUCK_TWICE, reason))


def _rolling(fits: StrikeFits, angle: TipAngle, rolls: str, limits: VerdictLimits) -> StrikeFits:
    """Says of a rolling fit why it was taken and what it assumed, and puts the hinge's beside it."""
    fit = fits.chosen
    if fit is None or fit.rolling is None:
        return fits
    used = edge_motion(fits.motion, fit.window)
    slid = f"the contact slid by {1e3 * used.slid:.1f} mm and rose by {1e3 * used.lifted:.1f} mm against rolling"
    violated = (slid,) if max(used.slid, used.lifted) >= limits.edge_moved else ()
    others = (*fits.others, *_as_hinge(angle, fit.window, rolls))
    note = "; ".join(part for part in (f"chosen because {rolls}", fit.note) if part)
    return replace(fits, chosen=replace(fit, note=note, violated=violated), others=others)


def _as_hinge(angle: TipAngle, window: tuple[int, int], violated: str) -> tuple[MotionFit, ...]:
    try:
        return (replace(pivot_fit(angle, window), violated=(violated,)),)
    except EstimationError:
        return ()


def _hinge(angle: TipAngle, course: Course, phi_predicted: float, limits: WindowLimits, over: Estimator) -> _Hinge:
    """pivot_fit, or another, over the window that its own phi bounds."""
    window = free_window(angle, course, phi_predicted, limits)
    try:
        fit = over(angle, window)
        for _ in range(3):
            again = free_window(angle, course, fit.phi, limits)
            if again == window or again[1] - again[0] < MIN_FRAMES:
                break
            fit = over(angle, again)
            window = again
    except EstimationError as error:
        return _Hinge(None, window, str(error))
    return _Hinge(fit, window)


def _kicked(fit: MotionFit, size: float, gain: float, limits: VerdictLimits) -> bool:
    return gain >= limits.kick_chi2 and abs(size) >= limits.kick_ratio * abs(fit.omega0)


def _balanced(
    edge: EdgeMotion, window: tuple[int, int], hinge: MotionFit | None, planned: PlannedStrike, limits: VerdictLimits
) -> tuple[MotionFit | None, str]:
    """The moment balance over the same window, where the edge moved and that explains the motion; and what says that it moved."""
    moved = max(edge.slid, edge.lifted) >= limits.edge_moved
    if not moved and (hinge is None or float(np.median(edge.motion.angle.sd[slice(*window)])) > _CLEAR_SIGHT):
        return None, ""
    phi = None if hinge is not None else planned.phi_predicted_rad

    def over(frames: tuple[int, int]) -> MotionFit:
        return moment_balance(edge.motion, frames, planned.pivot.radius_m, phi, edge.offset_covariance)

    try:
        fit = over(window)
    except EstimationError:
        return None, ""
    angle = edge.motion.angle
    _, size, left = jump(angle, fit)
    # The place of the edge is noisy too, which the angle's own sd does not hold; but a motion that does not fit is no noise.
    left /= min(max(1.0, scatter(fit.residual) / float(np.median(angle.sd[slice(*fit.window)]))), _NOISIER) ** 2
    if _kicked(fit, size, left, limits):
        return None, ""
    if moved or hinge is None:
        return settled_fit(fit, over), f"the edge slid by {1e3 * edge.slid:.1f} mm and rose by {1e3 * edge.lifted:.1f} mm"
    _, size, gain = jump(angle, hinge)
    if _kicked(hinge, size, gain, limits):
        if left < _EXPLAINED * gain and _confirmed(angle, window, fit, planned.pivot.radius_m):
            return fit, f"the edge moved at one end of the window, which a hinge takes for a blow of {size:+.2f} rad/s"
        return None, ""
    sd, other = math.sqrt(float(hinge.covariance[0, 0])), math.sqrt(float(fit.covariance[0, 0]))
    apart = abs(fit.phi - hinge.phi)
    if other < sd and apart > max(_APART * sd, _APART_LEAST):
        return fit, f"a hinge would put phi {math.degrees(apart):.2f} deg off, {apart / sd:.1f} of its sd: the edge crept"
    return None, ""


def _confirmed(angle: TipAngle, window: tuple[int, int], balanced: MotionFit, radius: float) -> bool:
    """Whether theta(t) bears out a balance that explains a blow: no hinge struck again comes closer, and phi is that of the clean part."""
    kicked = kicked_fit(angle, window, radius)
    if kicked is not None and scatter(kicked.fit.residual) < scatter(balanced.residual):
        return False
    clean = longest_clean_fit(angle, window, lambda angle, frames: pivot_fit(angle, frames, radius))
    if clean is None:
        return False
    return abs(clean.phi - balanced.phi) < _SAME * math.sqrt(float(clean.covariance[0, 0] + balanced.covariance[0, 0]))


def _with_kick(motion: PlanarMotion, window: tuple[int, int], limits: VerdictLimits, problem: str, radius: float) -> StrikeFits:
    """Where no hinge fits: perhaps two do, with a second blow between them."""
    found = kicked_fit(motion.angle, window, radius)
    if found is None or not _kicked(found.fit, found.size, found.gain, limits):
        return StrikeFits(None, (), motion, problem=problem)
    return StrikeFits(found.fit, (), motion, Judgement(Verdict.STRUCK_TWICE, _kick_reason(motion.angle, found.index, found.size, window)))


def _kick_reason(angle: TipAngle, index: int, size: float, window: tuple[int, int]) -> str:
    after = 1e-6 * (angle.time_ns[index] - angle.time_ns[window[0]])
    return f"its speed jumped by {size:+.2f} rad/s {after:.0f} ms after the strike: catch the striker after the first contact"
