"""Sentences on centre of mass, inertia tensor and region masses: to trust, to doubt, or not determined."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.common_point import common_point
from analyze.estimation.fixture import CENTRE_CAUSE, INERTIA_CAUSE, MASS_CAUSE, PLACE_CAUSE, TURN_CAUSE
from analyze.estimation.what_ifs import WhatIf
from analyze.least_squares.intervals import SIGMAS_95
from analyze.pipeline.solved import MIN_STRIKES
from analyze.result.flight import size_text, tosses_used
from analyze.types import TENSOR_ENTRIES, tensor_entry_name
from schemas.robustness import AlternativeResult
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from analyze.estimation.scatter import ScatterRange
    from analyze.estimation.what_ifs import Alternative
    from analyze.pipeline.estimate import Estimate
    from analyze.types import Array

MAX_TRUSTED_COM_SHARE = 0.05
"""half width of the 95 % interval of the centre of mass in its least certain direction, over half the
object's extent along it, up to which the centre of mass is trusted"""
MAX_ROUGH_SHARE = 0.3
"""half width of the 95 % interval of a tensor entry over the geometric mean of the diagonal entries of its
row and column, above which the entry is not determined"""
NEAR_POINT_SHARE = 0.2
"""largest distance of the struck edges from one point, over half the object's largest extent, at which they
are said to meet there nearly"""
EXACT_POINT_M = 1e-3
"""largest distance [m] of the struck edges from one point at which they are said to meet there"""
RADIUS_MATTERS = 2.0
"""half width of the centre of mass's 95 % interval with the edge radius not given, over the stated one, from
which the sentence on it says that it rests on the stated radius"""
FIXTURE_REMEDIES = {
    MASS_CAUSE: "weigh the fixture by itself, with its tags, on a better scale",
    CENTRE_CAUSE: "state its com_m more closely, or use a lighter fixture",
    INERTIA_CAUSE: "state its unit_inertia_m2 more closely, or use a lighter fixture",
    PLACE_CAUSE: "measure where the object sits, and state place_sd_m in [held]",
    TURN_CAUSE: "measure how the object sits, and state turn_sd_rad in [held]",
}
"""what to do about each part of the error that a fixture causes"""
WORD = ("trust", "doubt", "not determined")
"""first words of the sentences on quantities, in the order of the sentences"""


def quantity_sentences(estimate: Estimate, regions: str, *, sound: bool, moments_sound: bool) -> list[str]:
    """Sentences on centre of mass, entries of the inertia tensor and region masses, what to trust first.

    The centre of mass is trusted if its 95 % interval is small, the strikes' balance angles do not scatter
    more than usual, and it stays in the interval under all alternatives of the robustness table; entries of
    the tensor if strikes measured them and the moments hold under these alternatives; the region masses if
    their own intervals are small, and the centre of mass and the moments can be trusted.

    Args:
        estimate: the estimate.
        regions: sentence on the region masses by their own intervals.
        sound: False if a check failed that puts everything in doubt; nothing is then trusted.
        moments_sound: False if a check failed that puts the moments of inertia in doubt.
    """
    com = _com_text(estimate)
    found = [com, *_tensor_texts(estimate, moments_sound)]
    if regions.startswith("trust") and not (com.startswith("trust") and moments_sound):
        regions = (
            "doubt the region masses: they depend on the centre of mass and the moments, which are not to be"
            " trusted"
        )
    found.append(regions)
    return [each for word in WORD for each in found if each.startswith(word) and (sound or word != "trust")]


def robustness_documents(estimate: Estimate) -> list[AlternativeResult]:
    """Entries of the Result document on how the answer changes under each alternative assumption.

    An alternative is another assumption, a strike left out or another estimator. Empty if none was computed.
    """
    return [
        AlternativeResult(
            what_if=each.what_if.value,
            strike=each.strike_id,
            com_shift_m=each.com_shift.tolist(),
            moment_changes=None if each.moment_changes is None else each.moment_changes.tolist(),
            com_holds=each.com_holds,
            moments_hold=each.moments_hold,
        )
        for each in estimate.alternatives
    ]


def singular_text(estimate: Estimate) -> str:
    """Clause on why the strikes leave a direction of the centre of mass open, and what to do."""
    shared = common_point(estimate.planes)
    lower, upper = (np.asarray(end) for end in estimate.evidence.model.bounds)
    if shared is None:
        return "the struck edges are parallel: strike about an edge across them"
    near = NEAR_POINT_SHARE * float((upper - lower).max()) / 2
    if shared.edges < 3 or shared.miss > near:
        return "strike about another edge"
    miss = (
        "meet at one point"
        if shared.miss < EXACT_POINT_M
        else (f"nearly meet at one point, {1e3 * shared.miss:.0f} mm from the farthest")
    )
    return f"the {shared.edges} struck edges {miss}: strike about an edge that does not lead there"


def fixture_text(estimate: Estimate) -> str:
    """Clause on the fixture's part of the error of the centre of mass, and what to do; "" if it is small."""
    if estimate.fixture is None:
        return ""
    strikes, *others = estimate.fixture.shares
    worst = max(others, key=lambda share: float(np.trace(share.com_covariance)))
    if float(np.trace(worst.com_covariance)) < float(np.trace(strikes.com_covariance)):
        return ""
    return f"most of it is the {worst.cause}: {FIXTURE_REMEDIES[worst.cause]}"


def scatter_text(scatter: ScatterRange) -> str:
    """Clause on balance angles that scatter from strike to strike more than usual [°], and what to do."""
    low, high, usual = np.degrees([scatter.low, scatter.high, scatter.stated])
    return (
        f"the strikes' balance angles scatter by {low:.2g} to {high:.2g}° (1 sd), {usual:.1g}° is usual: the"
        " pose at rest differed from strike to strike; clean the table and the object's underside, put it"
        " down as planned, and strike again"
    )


def _given_radius_text(estimate: Estimate, half: float) -> str:
    """Clause on a centre of mass that is as sure as that only with the stated edge radius; "" if it is not.

    Args:
        estimate: the estimate.
        half: half width [m] of the centre of mass's 95 % interval in its least certain direction.
    """
    without = next((each for each in estimate.alternatives if each.what_if is WhatIf.RADIUS), None)
    if without is None or without.com_half < RADIUS_MATTERS * half:
        return ""
    return f" if the edge radius is as stated, to {1e3 * without.com_half:.1f} mm without it"


def _com_text(estimate: Estimate) -> str:
    """Sentence on the centre of mass with its half width [mm]; begins with trust, doubt or not determined."""
    com = estimate.com
    values, vectors = np.linalg.eigh(com.covariance)
    half = SIGMAS_95 * float(np.sqrt(values[-1]))
    if com.unobserved_direction is not None:
        x, y, z = com.unobserved_direction
        return (
            f"not determined: the centre of mass along ({x:.2f}, {y:.2f}, {z:.2f}): there it comes from the"
            f" shape, to ± {1e3 * half:.0f} mm; {singular_text(estimate)}"
        )
    lower, upper = estimate.evidence.model.own.bounds
    extent = float(np.abs(vectors[:, -1]) @ (np.asarray(upper) - lower)) / 2
    if half > MAX_TRUSTED_COM_SHARE * extent:
        return (
            f"doubt the centre of mass: it is known only to {1e3 * half:.1f} mm along"
            f" {_direction_text(vectors[:, -1])}; {fixture_text(estimate) or singular_text(estimate)}"
        )
    if estimate.scatter.exceeds:
        return f"doubt the centre of mass, stated to {1e3 * half:.1f} mm: {scatter_text(estimate.scatter)}"
    broken = next((each for each in estimate.alternatives if not each.com_holds), None)
    if broken is not None and broken.unchecked:
        return (
            f"doubt the centre of mass, stated to {1e3 * half:.1f} mm: the strikes do not check the stated"
            f" edge radius, and without it the centre of mass is known only to {1e3 * broken.com_half:.1f}"
            " mm; strike about more edges"
        )
    if broken is not None:
        moved = 1e3 * float(np.linalg.norm(broken.com_shift))
        return (
            f"doubt the centre of mass, stated to {1e3 * half:.1f} mm: with {what_if_text(broken)} it moves"
            f" by {moved:.1f} mm"
        )
    return _checked_com_text(estimate, half)


def _checked_com_text(estimate: Estimate, half: float) -> str:
    """Sentence on a centre of mass that no what-if puts in doubt, to `half` [m], with what supports it."""
    tosses = tosses_used(estimate)
    if tosses and len(estimate.fitted_planes) < MIN_STRIKES:
        if len(tosses) == 1:
            return (
                f"doubt the centre of mass, stated to {1e3 * half:.1f} mm: it comes from one toss, which"
                " nothing checks: toss again"
            )
        return f"trust the centre of mass, to {1e3 * half:.1f} mm: {counted(len(tosses), 'toss')} agree on it"
    predicted = len(estimate.predictions)
    consistent = (
        f"{sum(each.consistent for each in estimate.predictions)} of {counted(predicted, 'strike')} move as"
    )
    return f"trust the centre of mass, to {1e3 * half:.1f} mm{_given_radius_text(estimate, half)}: " + (
        f"{consistent} predicted from the others" if predicted else "no strike can be checked by the others"
    )


def _tensor_texts(estimate: Estimate, moments_sound: bool) -> Iterator[str]:
    """Yield sentences on entries of the inertia tensor: measured, roughly known, not determined ones.

    Args:
        estimate: the estimate.
        moments_sound: False if a check failed that puts the moments of inertia in doubt.
    """
    inertial = estimate.inertial
    measured, informed = inertial.measured, inertial.informed
    trusted = [entry for entry in TENSOR_ENTRIES if measured[entry]]
    size = np.sqrt(np.outer(np.diag(inertial.inertia), np.diag(inertial.inertia)))
    share = SIGMAS_95 * inertial.inertia_sd / size
    known = informed & (share <= MAX_ROUGH_SHARE) & estimate.com.observed
    rough = [entry for entry in TENSOR_ENTRIES if known[entry] and not measured[entry]]
    prior = [entry for entry in TENSOR_ENTRIES if not known[entry] and not measured[entry]]
    broken = next((each for each in estimate.alternatives if not each.moments_hold), None)
    if trusted and broken is not None and broken.unchecked:
        yield (
            f"doubt {_names(trusted)} of the tensor: known only with the stated edge radius, which the"
            " strikes do not check"
        )
    elif trusted and broken is not None and broken.moment_changes is not None:
        change = float(np.max(np.abs(broken.moment_changes)))
        yield (
            f"doubt {_names(trusted)} of the tensor: with {what_if_text(broken)} a principal moment changes"
            f" by {100 * change:.0f} %, beyond its interval"
        )
    elif trusted and moments_sound and len(tosses_used(estimate)) != 1:
        sources = ["strikes"] * bool(estimate.fitted_planes) + ["tosses"] * bool(tosses_used(estimate))
        yield f"trust {_names(trusted)} of the tensor: {' and '.join(sources)} measured them"
    if rough:
        worst = max(float(share[entry]) for entry in rough)
        yield f"doubt {_names(rough)} of the tensor: known only to {100 * worst:.0f} % of the moments"
    if prior and not estimate.fitted_planes:
        yield f"not determined: {_names(prior)}: {size_text(estimate)}"
    elif prior:
        come = "it comes" if len(prior) == 1 else "they come"
        yield f"not determined: {_names(prior)} of the tensor: {come} from the shape"


def what_if_text(alternative: Alternative) -> str:
    """Name in words of an alternative to the estimate's assumptions; for a strike left out, with its id."""
    if alternative.what_if is WhatIf.STRIKE:
        return f"strike {alternative.strike_id} left out"
    return alternative.what_if.value


def _names(entries: list[tuple[int, int]]) -> str:
    """Names of entries of the tensor, separated by commas."""
    return ", ".join(tensor_entry_name(entry) for entry in entries)


def _direction_text(direction: Array) -> str:
    """Text "(x, y, z)" of a unit vector (3,) in the object frame O, its largest component made positive."""
    x, y, z = direction * np.sign(direction[np.argmax(np.abs(direction))])
    return f"({x:.2f}, {y:.2f}, {z:.2f})"
