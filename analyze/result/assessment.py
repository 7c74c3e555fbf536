"""Verdict on an estimate in sentences: parts of it to trust, parts to doubt, strikes to repeat."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.result.agreements import estimator_difference_text
from analyze.result.contents import contents_text
from analyze.result.frame_times import wrong_text
from analyze.result.print_differences import print_text
from analyze.result.radius import refuted_radius_text
from analyze.result.trust import quantity_sentences
from analyze.result.unchecked import unchecked_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.checks import Checks
    from analyze.estimation.mass_properties import MassDistribution
    from analyze.pipeline.estimate import Estimate
    from analyze.pipeline.prediction import StrikePrediction
    from analyze.types import Array
    from schemas.result import FrameTimes

MAX_OUTSIDE_SD = 2.0
"""distance of the centre of mass outside the shape's hull, in sd, above which the result is doubted"""
MAX_TRUSTED_SHARE = 0.1
"""half width of the least certain region's 95 % interval over the object's mass, up to which the masses of
shell and interior parts are trusted"""
NOT_RIGID_ADVICE = (
    "the centre of mass of each pose is listed; fix or take out what moves, and strike again, for one of the"
    " whole"
)
"""what to do about a body with something that moves inside"""
WHOLE_RANGE_SHARE = 0.8
"""width of the range of a region's mass, over the object's mass, from which on the range restricts nothing"""


def assessment(estimate: Estimate, frame_times: Sequence[FrameTimes] = ()) -> list[str]:
    """Sentences on an estimate: what to trust, to doubt, what is not determined, which strikes to repeat.

    Each begins with trust, doubt, not determined, not checked or repeat. Nothing is to be trusted in three
    cases: something moves inside the body, or is suspected to; the centre of mass lies more than
    `MAX_OUTSIDE_SD` sd outside the shape's hull; or gravity by the strikes disagrees with the stated one, or
    a moment of inertia is impossible for the shape, although no stated frame rate is wrong (a wrong one would
    explain both). If one axis alone makes gravity disagree, only moments are doubted.

    Args:
        estimate: the estimate.
        frame_times: entries of the Result document on its recordings' frame times; empty if none come from a
            video file.
    """
    checks = estimate.checks
    wrong_rates = [each for each in frame_times if not each.possible]
    # A wrong frame rate causes impossible moments and a wrong gravity: then only the rate is reported, and
    # the estimate does not use it.
    gravity_doubted = not wrong_rates and not checks.gravity.agrees
    moments_doubted = not wrong_rates and bool(checks.impossible_axes)
    one_axis = gravity_doubted and checks.gravity.single_axis is not None
    outside = checks.sigmas_outside_hull > MAX_OUTSIDE_SD
    not_rigid, suspected = estimate.contents.not_rigid, estimate.contents.suspected
    by_quantity = quantity_sentences(
        estimate,
        regions_text(estimate.distribution, estimate.inertial.mass),
        sound=not (
            not_rigid
            or suspected
            or estimate.print_differences
            or outside
            or moments_doubted
            or (gravity_doubted and not one_axis)
        ),
        moments_sound=not one_axis,
    )
    found: list[str] = []
    if not_rigid or suspected:
        advice = f"; {NOT_RIGID_ADVICE}" if not_rigid else ""
        found.append(f"doubt everything: {contents_text(estimate.contents)}{advice}")
    found += [f"doubt everything: {print_text(each)}" for each in estimate.print_differences[:1]]
    found += [each for each in by_quantity if each.startswith("trust")]
    found += [
        f"doubt the frame rate: {wrong_text(each)}; this answer does not use it, and is less certain than"
        " it could be"
        for each in wrong_rates
    ]
    if (radius := refuted_radius_text(estimate.radius_check)) is not None:
        found.append(radius)
    found += [each for each in by_quantity if not each.startswith("trust")]
    if outside:
        found.append(
            "doubt everything: the centre of mass lies outside the shape's hull; check the shape's unit and"
            " how the object was placed"
        )
    if moments_doubted:
        axes = ", ".join(checks.impossible_axes)
        found.append(
            f"doubt the moments: no body of this shape can have the moments measured about {axes}; check"
            " mass, unit and shape"
        )
    if gravity_doubted:
        found.append(f"doubt {'the moments' if one_axis else 'everything'}: {gravity_text(checks)}")
    found += [
        f"doubt strike {each.strike_id}: {estimator_difference_text(each)}; look at its motion"
        for each in estimate.agreements.estimators
    ]
    # What moves inside explains strikes that the others do not predict: another strike would not be better.
    missed = [each for each in estimate.predictions if not each.consistent and not not_rigid]
    found += [f"repeat strike {each.left_out.strike_id}: {prediction_text(each)}" for each in missed]
    unchecked = unchecked_text(checks.left_out)
    return found if unchecked is None else [*found, unchecked]


def regions_text(distribution: MassDistribution, mass: float) -> str:
    """Sentence on how far the masses of shell (outer wall) and interior parts can be trusted.

    It begins with trust if the half width of the least certain region's 95 % interval is at most
    `MAX_TRUSTED_SHARE` of the mass and a body of uniform parts explains the moments, else with not
    determined. It names the kinds of body for which the intervals hold, or gives the limits under any filling
    if neither kind explains the moments.

    Args:
        distribution: masses of the shell and of the interior on either side of a plane, with intervals.
        mass: mass of the object [kg].
    """
    ends = distribution.intervals if distribution.explained else distribution.limits
    if _whole_range(ends, mass):
        return (
            "not determined: region masses: strikes leave open whether a region holds none or nearly"
            " all of the mass; label the parts, or strike about more axes"
        )
    ranges = _ranges(distribution.names, ends)
    if not distribution.explained:
        return (
            "not determined: region masses: no uniform shell with two uniform parts, or with one lump,"
            f" has these moments; under any filling: {ranges}"
        )
    kind = (
        "on either side of the dividing plane, if the object is a uniform shell with"
        f" {_kinds_text(distribution)}"
    )
    half = 0.5 * np.diff(ends, axis=1)[:, 0]
    worst = int(np.argmax(half))
    share = float(half[worst]) / mass
    known = f"{distribution.names[worst]}, to ± {1e3 * half[worst]:.2g} g, {100 * share:.0f} % of the total"
    if share <= MAX_TRUSTED_SHARE:
        return f"trust the region masses {kind}: the least certain, {known}"
    return f"not determined: region masses {kind}, more closely than {ranges}; strike about more axes"


def _kinds_text(distribution: MassDistribution) -> str:
    """Words for the interiors that have the measured moments: two uniform parts, one lump, or either."""
    kinds = {
        "two uniform parts": distribution.two_parts_explain,
        "one lump (or void)": distribution.lump_explains,
    }
    return " or ".join(kind for kind, explains in kinds.items() if explains)


def _whole_range(ends: Array, mass: float) -> bool:
    """True if the ranges (n, 2) [kg] of all regions' masses are nearly as wide as the `mass` [kg]."""
    return bool(np.all(np.diff(ends, axis=1)[:, 0] >= WHOLE_RANGE_SHARE * mass))


def _ranges(names: Sequence[str], ends: Array) -> str:
    """Text of the lower and upper ends `ends` (n, 2) [kg] of n named masses, in grams, with their names."""
    return ", ".join(
        f"{name} {1e3 * low:.3g} to {1e3 * high:.3g} g" for name, (low, high) in zip(names, ends, strict=True)
    )


def gravity_text(checks: Checks) -> str:
    """Clause on how much gravity, as it follows from the strikes, differs from the stated one [%].

    It gives the half width of the difference's 95 % interval, and what to check. If the strikes about one
    axis alone make the difference, by their rate k of theta'' = -k sin(phi - theta), the axis is named.
    """
    gravity = checks.gravity
    if gravity.single_axis is not None:
        return (
            f"k of the strikes about {gravity.single_axis} alone makes gravity differ by"
            f" {100 * gravity.relative:+.0f} ± {100 * SIGMAS_95 * gravity.sd:.0f} % from the stated one;"
            " without it gravity agrees: strike that edge again"
        )
    return (
        f"gravity by the strikes differs by {100 * gravity.relative:+.0f} ±"
        f" {100 * SIGMAS_95 * gravity.sd:.0f} % from the stated one: check the shape's unit and the frame"
        " rate"
    )


def prediction_text(prediction: StrikePrediction) -> str:
    """Clause on the difference of a strike from its prediction by all others, with 95 % ranges.

    It gives the differences, measured minus predicted, of the balance angle φ [°], of the rate constant k of
    the motion [%] if k was used, and of the tipping angle θ [°] at the frame where it is largest over its sd.
    """
    left_out, motion, worst = prediction.left_out, prediction.motion, prediction.motion.worst
    text = (
        f"φ differs by {np.degrees(left_out.phi_off):+.2f}° from the prediction by the others (±"
        f" {np.degrees(SIGMAS_95 * left_out.phi_sd):.2f}°)"
    )
    if left_out.k_off is not None and left_out.k_sd is not None:
        text += f", k by {100 * left_out.k_off:+.1f} % (± {100 * SIGMAS_95 * left_out.k_sd:.1f} %)"
    off, band = np.degrees(motion.offset[worst]), np.degrees(SIGMAS_95 * motion.sd[worst])
    return (
        f"{text}; θ leaves the predicted motion by {off:+.1f}° (± {band:.1f}°) within"
        f" {motion.time[worst]:.2f} s"
    )
