"""Warnings on single strikes of an estimate: their fits, contacts that roll, and the tracking of markers.

Warnings on their number and choice are in warnings.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.contact import ContactErrors
from analyze.result.agreements import disagreement_texts
from analyze.result.warning_text import names_text, warning
from schemas.result import ResultWarning, WarningCode
from schemas.strike_result import Verdict
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from analyze.pipeline.estimate import Estimate
    from analyze.pipeline.evidence import Evidence
    from analyze.types import TipMotion


MIN_STRIKES_FOR_OUTLIERS = 6
"""least number of strikes used among which an outlier can be recognised"""
MAX_FIT_RESIDUAL = np.radians(0.3)
"""rms residual [rad] of the tipping angle theta above which a fit is reported as poor"""
MIN_ROBUST_WEIGHT = 0.5
"""robust weight (1 for a strike within its sd, towards 0 for an outlier) below which a strike is reported"""
MAX_RADIUS_SD = 0.1
"""1 sigma of a flank's radius of curvature over the radius, above which the flank is reported as uneven"""


def fit_warnings(estimate: Estimate) -> Iterator[ResultWarning]:
    """Yield warnings of strikes used: outliers, poor fits, rocked back; then of answers that disagree.

    Answers that disagree are those of two estimators of one strike, and the centres of mass by the paper's
    method (VISAPP 2013) and by the joint estimate.
    """
    for plane, robust in zip(estimate.fitted_planes, estimate.com.robust, strict=True):
        if robust < MIN_ROBUST_WEIGHT:
            text = f"strike {plane.strike_id} disagrees with the others; its robust weight is {robust:.0%}"
            yield warning(WarningCode.POOR_FIT, text)
    used = {plane.strike_id for plane in estimate.fitted_planes}
    motions = [each for each in estimate.evidence.motions if each.strike_id in used]
    fitted = [(each, each.fit) for each in motions if each.fit is not None]
    for motion, fit in fitted:
        rms = float(np.sqrt(np.mean(fit.residual**2)))
        if rms > MAX_FIT_RESIDUAL:
            yield warning(
                WarningCode.POOR_FIT,
                f"strike {motion.strike_id}: the residual of θ is {np.degrees(rms):.2f}° rms, more than"
                f" {np.degrees(MAX_FIT_RESIDUAL):.1f}°: look at its plot in the report",
            )
    if turned := [motion.strike_id for motion, _ in fitted if motion.verdict is Verdict.ROCKED_BACK]:
        text = (
            f"strike{'s' * (len(turned) > 1)} {names_text(turned)} rocked back before the balance point: φ is"
            " extrapolated"
        )
        yield warning(WarningCode.POOR_FIT, text)
    for text in disagreement_texts(estimate.agreements):
        yield warning(WarningCode.ESTIMATORS_DISAGREE, text)


def rolling_warnings(estimate: Estimate) -> Iterator[ResultWarning]:
    """Yield warnings of objects that roll on the table while they tip.

    Reasons: a round rim, an uneven flank (curved side), or an estimator that takes the contact as fixed.
    """
    evidence, planes = estimate.evidence, estimate.fitted_planes
    on_rim = {strike.axis_id for strike in evidence.plan.strikes if strike.rolls}
    if rims := sorted({plane.axis_id for plane in planes if plane.axis_id in on_rim}):
        wander = np.degrees(ContactErrors().rim_phi_sd)
        text = (
            f"about {names_text(rims)} the object stands on a round rim and may turn aside: the intervals "
            f"include ±{wander:.2f}° for it"
        )
        yield warning(WarningCode.ROLLING_CONTACT, text)
    motions = {motion.strike_id: motion for motion in evidence.motions}
    flanks = [plane for plane in planes if _rolled_on_flank(motions[plane.strike_id])]
    if rough := [plane for plane in flanks if plane.radius_sd > MAX_RADIUS_SD * plane.edge_radius > 0]:
        share = max(plane.radius_sd / plane.edge_radius for plane in rough)
        names = names_text(sorted({plane.axis_id for plane in rough}))
        text = (
            f"about {names} the object rolls on an uneven flank, whose radius of curvature is known to"
            f" ±{share:.0%}; the moments' intervals"
        )
        yield warning(
            WarningCode.ROLLING_CONTACT,
            f"{text} include this: a finer scan, or the designer's mesh, narrows them",
        )
    estimator = estimate.options.estimator
    if hinged := {
        plane.axis_id for plane in planes if _rolls_unmodelled(estimator, motions[plane.strike_id])
    }:
        text = (
            f"about {names_text(sorted(hinged))} the contact rolls, which {estimator} does not model: errors "
            "of k, and on a flank of φ,"
        )
        yield warning(WarningCode.ROLLING_CONTACT, f"{text} are larger than stated")


def _rolled_on_flank(motion: TipMotion) -> bool:
    """True if the contact with the table rolled on a curve of the shape itself."""
    return motion.fit is not None and motion.fit.rolling is not None and motion.fit.rolling.of_shape


def _rolls_unmodelled(estimator: str | None, motion: TipMotion) -> bool:
    """True if the contact with the table rolls, but the estimator that the user chose takes it as fixed.

    False if the user chose none (`estimator` is None), or if the one chosen has no fit of the motion.
    """
    fit = motion.fit
    return (
        fit is not None
        and fit.rolling is not None
        and fit.estimator != estimator
        and any(other.estimator == estimator for other in motion.alternatives)
    )


def tracking_warnings(evidence: Evidence) -> Iterator[ResultWarning]:
    """Yield warnings of the tracking of the strikes' markers, each with its code and sentence.

    They are of markers seen that the object file does not have, of tracked markers without a pose in it, and
    of strikes with lost frames.
    """
    for strike_id, report in evidence.tracking.items():
        if report.unknown_ids:
            text = (
                f"strike {strike_id}: marker {report.unknown_ids[0]} was detected, but is not in the object"
                " file: add it there, or remove it from view"
            )
            yield warning(WarningCode.UNKNOWN_MARKER, text)
    placed = {marker.name for marker in evidence.spec.marker if marker.T_object_marker is not None}
    unplaced = {
        str(track.marker_id)
        for report in evidence.tracking.values()
        for track in report.tracks
        if track.marker_id not in placed
    }
    if unplaced:
        yield warning(
            WarningCode.MARKERS_UNPLACED,
            f"the object file does not give T_object_marker of {names_text(sorted(unplaced))}: φ and k do not"
            " need it, slip and the placement check do: `analyze register` estimates it from this recording",
        )
    for strike_id, lost in evidence.frames_lost.items():
        if lost:
            yield warning(
                WarningCode.FRAMES_LOST,
                f"strike {strike_id}: {counted(lost, 'frame', 'was')} lost during its recording",
            )
