"""What a reader of the result must know, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.markers import can_subtract
from analyze.motion.contact import ContactErrors
from analyze.reading.file_series import missing_text
from analyze.reading.planned_strikes import planned_strikes
from analyze.result.agreements import Agreements
from analyze.result.assessment import OUTSIDE, gravity_text, missed_text
from analyze.result.frame_times import unchecked_text, wrong_text
from analyze.result.tilt import TILT_REMEDY, assumed_tilt
from analyze.types import EquiPlane, InertialParameters, MassDistribution, TipMotion
from schemas.result import FrameTimes, ResultWarning, Verdict, WarningCode
from schemas.session_manifest import TimeSource

if TYPE_CHECKING:
    from analyze.estimation.checks import Checks
    from analyze.estimation.part_masses import PartMasses
    from analyze.pipeline.estimate import EstimateOptions
    from analyze.pipeline.evidence import Evidence
    from analyze.pipeline.prediction import ForetoldStrike

ENOUGH_STRIKES = 6
POOR_RESIDUAL = np.radians(0.3)
OUTLIER = 0.5
ROUGH_FLANK = 0.1
"""1 sigma of a flank's radius of curvature over itself"""
UNEXPLAINED = 2.5
"""rms of the parts' residuals over their sd"""
UNCERTAIN_SHARE = 0.1
"""of the mass, 1 sigma of a region"""


def result_warnings(
    evidence: Evidence,
    options: EstimateOptions,
    planes: Sequence[EquiPlane],
    inertial: InertialParameters,
    distribution: MassDistribution,
    agreed: Agreements,
    parts: PartMasses | None,
    checks: Checks,
    foretold: Sequence[ForetoldStrike],
    times: Sequence[FrameTimes] = (),
) -> list[ResultWarning]:
    """All warnings, in a fixed order."""
    found: list[ResultWarning] = []

    def warn(code: WarningCode, text: str) -> None:
        found.append(ResultWarning(code=code, text=text))

    com = inertial.com
    several = len(evidence.recordings) > 1
    for number, recording in enumerate(evidence.recordings, 1):
        if recording.missing_files:
            which = f"of recording {number}, " if several else ""
            text = f"not used, because it is not beside the others: {which}{missing_text(recording.missing_files)}"
            warn(WarningCode.RECORDING_INCOMPLETE, text)
    done = planned_strikes(evidence.plan, (motion.plan_strike_id for motion in evidence.motions))
    if done.missing:
        warn(WarningCode.RECORDING_INCOMPLETE, done.text())
    if not agreed.recordings.holds:
        apart = 1e3 * agreed.recordings.apart
        text = f"the recordings do not mean one centre of mass: theirs lie {apart:.2g} mm apart, more than their errors allow"
        warn(WarningCode.RECORDINGS_DISAGREE, f"{text}: was the object opened, refilled or exchanged? Then estimate each by itself")
    if evidence.object_path_used:
        warn(WarningCode.OBJECT_OVERRIDDEN, "the object file given replaces the recording's; the edges are the plan's, with its rounding")
    if options.exclude:
        warn(WarningCode.STRIKES_EXCLUDED, f"left out on request: {_names(sorted(options.exclude))}")
    if len(planes) < ENOUGH_STRIKES:
        warn(WarningCode.FEW_STRIKES, f"{len(planes)} strikes were used: an outlier among so few goes unnoticed")
    if com.unobserved_direction is not None:
        x, y, z = com.unobserved_direction
        warn(WarningCode.DIRECTION_UNOBSERVED, f"the strikes do not tell where c lies along ({x:.2f}, {y:.2f}, {z:.2f}): add an axis")
    if checks.outside > OUTSIDE:
        text = f"the centre of mass lies outside the shape's hull, by {checks.outside:.1f} sd: check the shape's unit and the placements"
        warn(WarningCode.CENTRE_OUTSIDE_SHAPE, text)
    wrong_rate = [each for each in times if not each.possible]
    for each in times:
        whose = f"recording {each.recording}: " if several else ""
        if not each.possible:
            warn(WarningCode.FRAME_RATE_WRONG, whose + wrong_text(each))
        elif each.rate_ratio is None and each.frame_rate_sd_hz is None:
            warn(WarningCode.FRAME_RATE_UNCHECKED, whose + unchecked_text(each))
    for motion in evidence.motions:
        if motion.faster is not None:
            warn(WarningCode.FRAME_RATE_WRONG, f"strike {motion.strike_id}: {motion.reason}")
    # Times that are not true make impossible moments and another gravity: told once, by their cause.
    if checks.impossible and not wrong_rate:
        warn(WarningCode.MOMENT_IMPOSSIBLE, f"no mass within the shape has the moments measured about {_names(checks.impossible)}")
    if not checks.gravity.agrees and not wrong_rate:
        warn(WarningCode.GRAVITY_DISAGREES, gravity_text(checks))
    for each in foretold:
        if not each.holds:
            warn(WarningCode.STRIKE_NOT_FORETOLD, f"strike {each.told.strike_id}: {missed_text(each)}")
    for plane, robust in zip(planes, com.robust, strict=True):
        if robust < OUTLIER:
            warn(WarningCode.POOR_FIT, f"strike {plane.strike_id} disagrees with the others and was given {robust:.0%} of its weight")
    for text in _poor_fits(evidence, planes):
        warn(WarningCode.POOR_FIT, text)
    for text in agreed.texts():
        warn(WarningCode.ESTIMATORS_DISAGREE, text)
    assumed = assumed_tilt(com, evidence)
    if assumed > 0:
        tilt = np.degrees(assumed)
        text = f"the table is taken for level to {tilt:.2f}°, and the strikes tell no better; this is in the intervals"
        warn(WarningCode.GRAVITY_ASSUMED, f"{text}: {TILT_REMEDY}")
    if not inertial.measured.all():
        entries = [f"I{'xyz'[i]}{'xyz'[j]}" for i in range(3) for j in range(i, 3) if not inertial.measured[i, j]]
        warn(WarningCode.INERTIA_FROM_PRIOR, f"from the shape, not from strikes: {', '.join(entries)}")
    if distribution.wall is not None:
        wall = distribution.wall
        low, high = (f"{1e3 * end:.1f}" for end in wall.interval)
        text = (
            f"shell_thickness_m is not given: of walls of {1e3 * wall.swept[0]:.1f} to {1e3 * wall.swept[1]:.1f} mm the moments speak for"
        )
        warn(WarningCode.REGIONS_UNCERTAIN, f"{text} {low} to {high} mm; measured, it narrows the regions' masses")
    share = np.sqrt(np.diag(distribution.covariance)) / inertial.mass
    if not distribution.explained:
        ends = " g, ".join(
            f"{n} {1e3 * low:.0f} to {1e3 * high:.0f}" for n, (low, high) in zip(distribution.names, distribution.limits, strict=True)
        )
        text = f"no even shell with two even parts has these moments: the sides are the middle's, the intervals any filling's ({ends} g)"
        warn(WarningCode.REGIONS_UNCERTAIN, f"{text}; label the parts, or look at the voxel map")
    elif share.max() > UNCERTAIN_SHARE:
        name = distribution.names[int(np.argmax(share))]
        warn(WarningCode.REGIONS_UNCERTAIN, f"the mass of region {name} is known to {share.max():.0%} of the total only")
    for text in _rolling(evidence, planes, options.estimator):
        warn(WarningCode.ROLLING_CONTACT, text)
    for strike_id, report in evidence.tracking.items():
        if report.unknown_ids:
            marker = report.unknown_ids[0]
            warn(WarningCode.UNKNOWN_MARKER, f"strike {strike_id}: marker {marker} was seen, but the object does not carry it")
    placed = {marker.name for marker in evidence.spec.marker if marker.T_object_marker is not None}
    unplaced = {str(track.marker_id) for report in evidence.tracking.values() for track in report.tracks if track.marker_id not in placed}
    if unplaced:
        warn(
            WarningCode.MARKERS_UNPLACED,
            f"nothing says where markers {_names(sorted(unplaced))} are glued: φ and k need it not, slip and the placement check do: "
            "`analyze register` finds it in this recording",
        )
    for strike_id, lost in evidence.frames_lost.items():
        if lost:
            warn(WarningCode.FRAMES_LOST, f"strike {strike_id}: {lost} frames were lost in its window")
    cards = sum(marker.mass_kg for marker in evidence.spec.marker)
    if cards > 0 and can_subtract(evidence.spec.marker):
        text = f"the markers' {1000 * cards:.2g} g are subtracted; φ, k and I_edge of single strikes are of the object with them"
        warn(WarningCode.MARKERS_SUBTRACTED, text)
    elif cards > 0:
        warn(
            WarningCode.MARKERS_INCLUDED,
            f"the results are of the object with its markers ({1000 * cards:.2g} g): give T_object_marker of each, and they are subtracted",
        )
    if parts is not None:
        if open_ones := [name for name, observed in zip(parts.names, parts.observed, strict=True) if not observed]:
            text = f"the moments leave the mass of {_names(open_ones)} open: label fewer parts, or strike about more axes"
            warn(WarningCode.REGIONS_UNCERTAIN, text)
        if parts.misfit > UNEXPLAINED:
            text = f"the labelled parts do not explain the moments ({parts.misfit:.1f} times their sd): a part is missing, or not uniform"
            warn(WarningCode.REGIONS_UNCERTAIN, text)
    for source in dict.fromkeys(recording.manifest.time_source for recording in evidence.recordings):
        if source is TimeSource.HOST_ARRIVAL:
            warn(WarningCode.POOR_FIT, f"frame times come from {source.value}: k is less certain than it looks")
    return found


def _rolling(evidence: Evidence, planes: Sequence[EquiPlane], estimator: str | None) -> Iterator[str]:
    """What rolling leaves open about the axes that were used."""
    on_rim = {strike.axis_id for strike in evidence.plan.strikes if strike.rolls}
    rims = sorted({plane.axis_id for plane in planes if plane.axis_id in on_rim})
    if rims:
        wander = np.degrees(ContactErrors().rim_phi_sd)
        yield f"about {_names(rims)} the object stands on a round rim and may turn aside: ±{wander:.2f}° of that is in the intervals"
    rough = [plane for plane in planes if plane.radius_sd > ROUGH_FLANK * plane.edge_radius]
    if rough:
        share = max(plane.radius_sd / plane.edge_radius for plane in rough)
        names = _names(sorted({plane.axis_id for plane in rough}))
        yield (
            f"about {names} it rolls on a flank that the shape has uneven: its radius of curvature is known to ±{share:.0%}, which is in "
            "the moments' intervals; a finer scan, or the designer's mesh, would know better"
        )
    motions = {motion.strike_id: motion for motion in evidence.motions}
    hinged = {plane.axis_id for plane in planes if _rolled_but_taken_for(estimator, motions[plane.strike_id])}
    if hinged:
        names = _names(sorted(hinged))
        yield f"about {names} the contact rolls, which {estimator} leaves out: k, and on a flank φ, are off by more than they say"


def _rolled_but_taken_for(estimator: str | None, motion: TipMotion) -> bool:
    fit = motion.fit
    return (
        fit is not None
        and fit.rolling is not None
        and fit.estimator != estimator
        and any(f.estimator == estimator for f in motion.alternatives)
    )


def _poor_fits(evidence: Evidence, planes: Sequence[EquiPlane]) -> Iterator[str]:
    used = {plane.strike_id for plane in planes}
    fitted = [(each, each.fit) for each in evidence.motions if each.strike_id in used and each.fit is not None and len(each.fit.residual)]
    for motion, fit in fitted:
        rms = float(np.sqrt(np.mean(fit.residual**2)))
        if rms > POOR_RESIDUAL:
            yield f"strike {motion.strike_id}: the fit misses θ by {np.degrees(rms):.2f}° on average"
    if turned := [motion.strike_id for motion, _ in fitted if motion.verdict is Verdict.ROCKED_BACK]:
        yield f"strike{'s' * (len(turned) > 1)} {_names(turned)} rocked back before the balance point: φ is extrapolated"


def _names(items: Sequence[str]) -> str:
    return ", ".join(items) if len(items) <= 6 else f"{', '.join(items[:6])} and {len(items) - 6} more"
