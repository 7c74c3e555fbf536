"""Warnings of an estimate in the Result document: each a code for programs and a sentence for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.markers import can_subtract
from analyze.pipeline.solved import MIN_STRIKES
from analyze.reading.file_series import missing_files_text
from analyze.reading.planned_strikes import planned_strikes
from analyze.result.assessment import MAX_OUTSIDE_SD, gravity_text, prediction_text
from analyze.result.contents import contents_text
from analyze.result.flight import flight_warnings, size_text, tosses_used
from analyze.result.frame_times import unchecked_text, wrong_text
from analyze.result.print_differences import print_text
from analyze.result.strike_warnings import (
    MIN_STRIKES_FOR_OUTLIERS,
    fit_warnings,
    rolling_warnings,
    tracking_warnings,
)
from analyze.result.tilt import TILT_REMEDY, assumed_tilt
from analyze.result.trust import scatter_text, singular_text
from analyze.result.warning_text import names_text, warning
from analyze.types import tensor_entry_name
from schemas.result import FrameTimes, ResultWarning, WarningCode
from schemas.session_manifest import TimeSource
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from analyze.estimation.mass_properties import InertialParameters, MassDistribution
    from analyze.estimation.part_masses import PartMasses
    from analyze.pipeline.estimate import Estimate
    from analyze.pipeline.evidence import Evidence
    from analyze.pipeline.surface_error import SurfaceError
    from schemas.object_spec import ObjectSpec


MAX_REGION_SD = 0.1
"""1 sigma of a region's mass over the object's mass, above which the region is reported as uncertain"""
REPORTED_REST_TURN = float(np.radians(0.05))
"""1 sigma [rad] of the object's turn at rest from strike to strike, above which it is reported"""


def result_warnings(estimate: Estimate, frame_times: Sequence[FrameTimes]) -> list[ResultWarning]:
    """All warnings of an estimate but those of its filling, in a fixed order; empty if there are none.

    A warning is a code with a sentence.

    Args:
        estimate: the estimate.
        frame_times: entries of the Result document on its recordings' frame times.
    """
    return [
        *_recording_warnings(estimate),
        *_contents_warnings(estimate),
        *_print_warnings(estimate),
        *_choice_warnings(estimate),
        *_centre_warnings(estimate),
        *_rate_warnings(estimate.evidence, frame_times),
        *_check_warnings(estimate, rates_possible=all(each.possible for each in frame_times)),
        *fit_warnings(estimate),
        *_scatter_warnings(estimate),
        *_tilt_warnings(estimate),
        *_shape_warnings(estimate.surface_error),
        *_prior_warnings(estimate.inertial),
        *_region_warnings(estimate.distribution, estimate.inertial.mass),
        *rolling_warnings(estimate),
        *tracking_warnings(estimate.evidence),
        *_marker_mass_warnings(estimate.evidence.spec),
        *_part_warnings(estimate.parts),
        *_time_source_warnings(estimate.evidence),
        *flight_warnings(estimate),
    ]


def _recording_warnings(estimate: Estimate) -> Iterator[ResultWarning]:
    """Yield warnings of files missing, rebuilt or compacted, of strikes not made, and of disagreement.

    Recordings disagree if one centre of mass does not explain them all.
    """
    evidence = estimate.evidence
    several = len(evidence.recordings) > 1
    for number, recording in enumerate(evidence.recordings, 1):
        if recording.missing_files:
            which = f"of recording {number}, " if several else ""
            text = (
                "not used, because missing from the folder of the others:"
                f" {which}{missing_files_text(recording.missing_files)}"
            )
            yield warning(WarningCode.RECORDING_INCOMPLETE, text)
        if recording.recovery_losses:
            which = f"recording {number}" if several else "the recording"
            text = f"{which} was rebuilt by `acquire recover`: {'; '.join(recording.recovery_losses)}"
            yield warning(WarningCode.RECORDING_RECOVERED, text)
        if recording.losses:
            which = f"recording {number}" if several else "the recording"
            text = f"images of {which} were compacted with loss: {'; '.join(recording.losses)}"
            yield warning(WarningCode.RECORDING_COMPACTED, text)
    done = planned_strikes(evidence.plan, (motion.plan_strike_id for motion in evidence.motions))
    if done.missing:
        yield warning(WarningCode.RECORDING_INCOMPLETE, done.text())
    agreement = estimate.agreements.recordings
    if not agreement.holds:
        yield warning(
            WarningCode.RECORDINGS_DISAGREE,
            f"the recordings' centres of mass lie {1e3 * agreement.largest_shift:.2g} mm apart, more than"
            " their errors allow: was the object opened, refilled or exchanged? Then estimate each recording"
            " by itself",
        )


def _contents_warnings(estimate: Estimate) -> Iterator[ResultWarning]:
    """Yield a warning that something moves inside the struck body, with the evidence."""
    if estimate.contents.not_rigid:
        yield warning(WarningCode.NOT_RIGID, contents_text(estimate.contents))


def _print_warnings(estimate: Estimate) -> Iterator[ResultWarning]:
    """Yield a warning for each pair of strikes that show different print on one face."""
    for each in estimate.print_differences:
        yield warning(WarningCode.PRINT_DIFFERS, print_text(each))


def _choice_warnings(estimate: Estimate) -> Iterator[ResultWarning]:
    """Yield warnings that an object file was replaced, strikes were excluded, or few strikes were used."""
    if estimate.evidence.object_path_used:
        text = (
            "the object file given replaces the recording's; the edges are the plan's, with the rounding of"
            " the file given"
        )
        yield warning(WarningCode.OBJECT_OVERRIDDEN, text)
    if estimate.options.exclude:
        yield warning(
            WarningCode.STRIKES_EXCLUDED,
            f"left out on request: {names_text(sorted(estimate.options.exclude))}",
        )
    used = len(estimate.fitted_planes)
    if used < MIN_STRIKES and tosses_used(estimate):
        yield warning(WarningCode.FEW_STRIKES, size_text(estimate))
    elif used < MIN_STRIKES_FOR_OUTLIERS:
        yield warning(
            WarningCode.FEW_STRIKES,
            f"{counted(used, 'strike', 'was')} used: an outlier among so few cannot be"
            f" recognised: make {MIN_STRIKES_FOR_OUTLIERS} or more",
        )


def _centre_warnings(estimate: Estimate) -> Iterator[ResultWarning]:
    """Yield warnings if the centre of mass has an unobserved direction, and if it lies outside the hull.

    The hull is that of the object's shape.
    """
    direction = estimate.com.unobserved_direction
    if direction is not None:
        x, y, z = direction
        yield warning(
            WarningCode.DIRECTION_UNOBSERVED,
            f"the strikes do not determine the centre of mass along ({x:.2f}, {y:.2f}, {z:.2f}):"
            f" {singular_text(estimate)}",
        )
    if estimate.checks.sigmas_outside_hull > MAX_OUTSIDE_SD:
        yield warning(
            WarningCode.CENTRE_OUTSIDE_SHAPE,
            f"the centre of mass lies outside the shape's hull, by {estimate.checks.sigmas_outside_hull:.1f}"
            " sd: check the shape's unit and how the object was placed",
        )


def _rate_warnings(evidence: Evidence, frame_times: Sequence[FrameTimes]) -> Iterator[ResultWarning]:
    """Yield warnings of recordings, then of strikes, whose stated frame rate is wrong or unchecked.

    A recording is reported if its strikes contradict the stated rate, or neither they nor a filmed drop
    measured it. A strike is reported if its motion cannot be that of a tip at the stated rate, but could be
    at another.
    """
    several = len(evidence.recordings) > 1
    for each in frame_times:
        recording = f"recording {each.recording}: " if several else ""
        if not each.possible:
            yield warning(WarningCode.FRAME_RATE_WRONG, recording + wrong_text(each))
        elif each.rate_ratio is None and each.frame_rate_sd_hz is None:
            yield warning(WarningCode.FRAME_RATE_UNCHECKED, recording + unchecked_text(each))
    for motion in evidence.motions:
        if motion.frame_rate_ratio is not None:
            yield warning(WarningCode.FRAME_RATE_WRONG, f"strike {motion.strike_id}: {motion.reason}")


def _check_warnings(estimate: Estimate, *, rates_possible: bool) -> Iterator[ResultWarning]:
    """Yield warnings of checks that failed: moments of inertia, gravity, strikes not as predicted.

    Moments may be impossible for the shape, gravity by the strikes may disagree with the stated one, a strike
    with its prediction from the others. If a stated frame rate is wrong (`rates_possible` is False), moments
    and gravity are not reported: the wrong rate explains them.
    """
    checks = estimate.checks
    if checks.impossible_axes and rates_possible:
        text = (
            f"no mass within the shape has the moments measured about {names_text(checks.impossible_axes)}:"
        )
        text += " check mass, unit and shape"
        yield warning(WarningCode.MOMENT_IMPOSSIBLE, text)
    if not checks.gravity.agrees and rates_possible:
        yield warning(WarningCode.GRAVITY_DISAGREES, gravity_text(checks))
    for each in estimate.predictions:
        if not each.consistent:
            yield warning(
                WarningCode.STRIKE_NOT_PREDICTED, f"strike {each.left_out.strike_id}: {prediction_text(each)}"
            )


def _scatter_warnings(estimate: Estimate) -> Iterator[ResultWarning]:
    """Yield warnings of balance angles that scatter from strike to strike, and of poses at rest that differ.

    Markers show the poses at rest; one that contradicts its stated pose on the object is named.
    """
    if estimate.scatter.exceeds:
        yield warning(WarningCode.STRIKES_SCATTER, scatter_text(estimate.scatter))
    rest = estimate.rest
    if rest is None:
        return
    if rest.sd > REPORTED_REST_TURN:
        angles = np.degrees(rest.mean)
        order = np.argsort(-np.abs(angles)).tolist()
        turned = [f"{estimate.fitted_planes[i].strike_id} by {angles[i]:+.2f}°" for i in order]
        yield warning(
            WarningCode.REST_TURNED,
            "at rest the object stood turned about the struck edge, as its markers show:"
            f" {names_text(turned)} (positive: towards the tip); this answer takes it into account: clean the"
            " table and the object's underside",
        )
    by_scan = "the object lies turned by more than the errors of the scan's slopes"
    for faces, markers in rest.either:
        text = f"on {names_text(faces)} {by_scan}, or marker {names_text(markers)} was moved on it"
        remedy = "determine the markers' poses anew with `analyze register`, or scan that side anew"
        yield warning(WarningCode.REST_TURNED, f"{text}: strikes there hardly count: {remedy}")
    unclear = {name for pair in rest.either for names in pair for name in names}
    for name in sorted({*rest.lying_askew} - unclear):
        yield warning(
            WarningCode.REST_TURNED,
            f"on {name} {by_scan}; this answer takes it into account: scan that side anew",
        )
    for name in sorted({*rest.moved} - unclear):
        yield warning(
            WarningCode.MARKER_MOVED,
            f"marker {name} at rest contradicts its pose in the object file, as if it had been moved on the"
            " object: determine the markers' poses anew with `analyze register`",
        )


def _tilt_warnings(estimate: Estimate) -> Iterator[ResultWarning]:
    """Yield a warning if a table's tilt towards the world's x was neither measured nor read from a level."""
    assumed = assumed_tilt(estimate.com, estimate.evidence)
    if assumed > 0 and estimate.fitted_planes:
        text = (
            f"the table is assumed level to {np.degrees(assumed):.2f}°, and the strikes do not determine it"
            " better"
        )
        yield warning(WarningCode.GRAVITY_ASSUMED, f"{text}; the intervals include this: {TILT_REMEDY}")


def _shape_warnings(found: SurfaceError | None) -> Iterator[ResultWarning]:
    """Yield a warning that the error of the shape's faces was assumed; nothing for None (it was stated)."""
    if found is None:
        return
    yield warning(
        WarningCode.SHAPE_ERROR_ASSUMED,
        f"surface_sd_m is not given: each face of the shape may be off by {1e3 * found.assumed:.1f} mm (1 sd)"
        f" before any strike, {1e3 * found.estimated:.2f} mm by how well the strikes agree; the intervals"
        " include this: measure an edge with a caliper and state surface_sd_m in [shape], or 0 if the shape"
        " is exact",
    )


def _prior_warnings(inertial: InertialParameters) -> Iterator[ResultWarning]:
    """Yield a warning that names the entries of the inertia tensor that come from the shape, not strikes.

    Nothing is yielded if strikes measured all entries.
    """
    if not inertial.measured.all():
        entries = [
            tensor_entry_name((i, j)) for i in range(3) for j in range(i, 3) if not inertial.measured[i, j]
        ]
        yield warning(
            WarningCode.INERTIA_FROM_PRIOR, f"from the shape, not from strikes: {', '.join(entries)}"
        )


def _region_warnings(distribution: MassDistribution, mass: float) -> Iterator[ResultWarning]:
    """Yield warnings of the masses of shell and interior parts.

    They are: shell thickness not given; that no uniform shell, with two uniform parts or with a lump inside,
    has the measured moments, or that only one with a lump has them. If any has them, a further warning names
    the region of least certain mass if its sd is above `MAX_REGION_SD` of `mass`, the object's mass [kg].
    """
    if distribution.shell is not None:
        shell = distribution.shell
        low, high = (f"{1e3 * end:.1f}" for end in shell.interval)
        found = f"the moments favour {low} to {high} mm" if shell.observed else "the moments favour none"
        yield warning(
            WarningCode.REGIONS_UNCERTAIN,
            f"shell_thickness_m is not given: of {1e3 * shell.swept[0]:.1f} to {1e3 * shell.swept[1]:.1f} mm"
            f" {found}; a measured thickness narrows the regions' masses",
        )
    share = np.sqrt(np.diag(distribution.covariance)) / mass
    if not distribution.explained:
        limits = zip(distribution.names, distribution.limits, strict=True)
        ends = " g, ".join(f"{name} {1e3 * low:.0f} to {1e3 * high:.0f}" for name, (low, high) in limits)
        yield warning(
            WarningCode.REGIONS_UNCERTAIN,
            "no uniform shell with two uniform parts, or with one lump, has these moments: the parts are"
            f" divided in the middle, and the intervals hold for any filling ({ends} g); label the parts, or"
            " look at the voxel map",
        )
        return
    if not distribution.two_parts_explain:
        yield warning(
            WarningCode.REGIONS_UNCERTAIN,
            "two uniform parts side by side do not have these moments, one lump (or void) in a uniform"
            " interior has: the parts are divided in the middle, and the intervals hold for such a lump",
        )
    if share.max() > MAX_REGION_SD:
        name = distribution.names[int(np.argmax(share))]
        text = (
            f"the mass of region {name} has an sd of {share.max():.0%} of the total: strike about more axes"
        )
        yield warning(WarningCode.REGIONS_UNCERTAIN, text)


def _marker_mass_warnings(spec: ObjectSpec) -> Iterator[ResultWarning]:
    """Yield a warning that the markers' (printed tags') mass is subtracted from the results, or included.

    Nothing is yielded if no marker has a mass.
    """
    mass = sum(marker.mass_kg for marker in spec.marker)
    if mass > 0 and can_subtract(spec.marker):
        text = (
            f"the markers' {1000 * mass:.2g} g are subtracted; φ, k and I_edge of single strikes include them"
        )
        yield warning(WarningCode.MARKERS_SUBTRACTED, text)
    elif mass > 0:
        yield warning(
            WarningCode.MARKERS_INCLUDED,
            f"the results are of the object with its markers ({1000 * mass:.2g} g): give T_object_marker of"
            " each to subtract them",
        )


def _part_warnings(parts: PartMasses | None) -> Iterator[ResultWarning]:
    """Yield warnings of labelled parts: masses that the moments do not determine, moments not explained.

    Nothing is yielded for None (the object file labels no parts).
    """
    if parts is None:
        return
    if not parts.explained:
        text = (
            f"the labelled parts do not explain the moments ({parts.misfit:.1f} times their sd, by chance in"
            f" {100 * parts.probability:.1g} % of sessions): a part is missing, not uniform, or its bodies"
            " are not those labelled; their masses are not determined"
        )
        yield warning(WarningCode.REGIONS_UNCERTAIN, text)
        return
    if unobserved := [
        name for name, observed in zip(parts.names, parts.observed, strict=True) if not observed
    ]:
        text = (
            f"the moments do not determine the mass of {names_text(unobserved)}: label fewer parts, or strike"
            " about more axes"
        )
        yield warning(WarningCode.REGIONS_UNCERTAIN, text)


def _time_source_warnings(evidence: Evidence) -> Iterator[ResultWarning]:
    """Yield a warning if the frame times of a recording are times of arrival at the host computer."""
    if any(recording.manifest.time_source is TimeSource.HOST_ARRIVAL for recording in evidence.recordings):
        text = (
            f"frame times are {TimeSource.HOST_ARRIVAL.value}, which drift and jitter: k is less certain than"
            " stated: record with the camera's own time stamps"
        )
        yield warning(WarningCode.POOR_FIT, text)
