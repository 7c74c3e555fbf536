"""The verdict in words: what of an answer to trust, what to doubt, which strikes to repeat."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.result.agreements import apart_text
from analyze.result.frame_times import wrong_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.agreement import EstimatorsApart
    from analyze.estimation.checks import Checks
    from analyze.pipeline.prediction import ForetoldStrike
    from analyze.types import Array, InertialParameters, MassDistribution
    from schemas.result import FrameTimes

ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
OUTSIDE = 2.0
"""sd outside the hull from which c cannot be believed"""
TRUSTED, DETERMINED = 0.1, 0.3
"""of the mass, half the 95 % interval of the least known region: up to which they are to be trusted, from which they are not determined"""


def assessment(
    inertial: InertialParameters,
    distribution: MassDistribution,
    checks: Checks,
    foretold: Sequence[ForetoldStrike],
    apart: Sequence[EstimatorsApart] = (),
    times: Sequence[FrameTimes] = (),
) -> list[str]:
    """Sentences, most important first; each begins with trust, doubt or repeat."""
    com = inertial.com
    missed = [each for each in foretold if not each.holds]
    wrong_rate = [each for each in times if not each.possible]
    # Times that are not true make impossible moments and another gravity: told by their cause, and the answer goes without them.
    told = not wrong_rate
    wrong = checks.outside > OUTSIDE or (told and (bool(checks.impossible) or not checks.gravity.agrees))
    found: list[str] = []
    if com.observed and not wrong:
        worst = 1.96e3 * float(np.sqrt(np.linalg.eigvalsh(com.covariance)[-1]))
        held = len(foretold) - len(missed)
        found.append(f"trust the centre of mass, to {worst:.1f} mm: {held} of {len(foretold)} strikes move as the others foretell")
    if not wrong and (measured := _entries(inertial, measured=True)):
        found.append(f"trust {measured} of the tensor: strikes measured them")
    regions = regions_text(distribution, inertial.mass)
    if com.observed and not wrong and regions.startswith("trust"):
        found.append(regions)
    found += [
        f"doubt the frame rate: {wrong_text(each)}; this answer goes without it, and is less sure than it could be" for each in wrong_rate
    ]
    if not com.observed:
        found.append("doubt the centre of mass along the direction that is named as open: it comes from the shape")
    if prior := _entries(inertial, measured=False):
        found.append(f"doubt {prior} of the tensor: they come from the shape")
    if regions.startswith("doubt"):
        found.append(regions)
    elif not com.observed:
        found.append("doubt the region masses: they rest on the centre of mass, part of which comes from the shape")
    if checks.outside > OUTSIDE:
        found.append(
            "doubt everything: the centre of mass lies outside the shape's hull; check the shape's unit and how the object was placed"
        )
    if checks.impossible and told:
        found.append(f"doubt the moments: no body of this shape has those about {', '.join(checks.impossible)}; check mass, unit and shape")
    if not checks.gravity.agrees and told:
        found.append(f"doubt everything: {gravity_text(checks)}")
    found += [f"doubt strike {each.strike_id}: {apart_text(each)}; look at its motion" for each in apart]
    found += [f"repeat strike {each.told.strike_id}: {missed_text(each)}" for each in missed]
    return found


def regions_text(distribution: MassDistribution, mass: float) -> str:
    """What the masses of wall and filling are worth."""
    if not distribution.explained:
        ends = _ranges(distribution.names, distribution.limits)
        return f"doubt the region masses: no even shell with two even parts has these moments; whatever fills it: {ends}"
    half = 0.5 * np.diff(distribution.intervals, axis=1)[:, 0]
    worst = int(np.argmax(half))
    share, name = float(half[worst]) / mass, distribution.names[worst]
    if share > DETERMINED:
        return f"doubt the region masses: the moments do not determine them: {_ranges(distribution.names, distribution.intervals)}"
    known = f"± {1e3 * half[worst]:.2g} g of the {name} at most, {100 * share:.0f} % of all"
    if share > TRUSTED:
        return f"doubt the region masses: they are known roughly only, {known}; more axes tell more"
    return f"trust the region masses, if it is an even shell with two even parts: {known}"


def _ranges(names: Sequence[str], ends: Array) -> str:
    return ", ".join(f"{name} {1e3 * low:.3g} to {1e3 * high:.3g} g" for name, (low, high) in zip(names, ends, strict=True))


def gravity_text(checks: Checks) -> str:
    """What the strikes say of g."""
    told = checks.gravity
    return (
        f"the strikes mean a gravity {100 * told.relative:+.0f} ± {196 * told.sd:.0f} % off what is stated: check the shape's unit and the "
        "frames' times"
    )


def missed_text(strike: ForetoldStrike) -> str:
    """How a strike is off what the others foretell."""
    each, motion, worst = strike.told, strike.motion, strike.motion.worst
    text = f"φ is {np.degrees(each.phi_off):+.2f}° off what the others foretell (± {np.degrees(1.96 * each.phi_sd):.2f}°)"
    if each.k_off is not None and each.k_sd is not None:
        text += f", k {100 * each.k_off:+.1f} % (± {196 * each.k_sd:.1f} %)"
    off, band = np.degrees(motion.offset[worst]), np.degrees(1.96 * motion.sd[worst])
    return f"{text}; its motion leaves theirs by {off:+.1f}° (± {band:.1f}°) within {motion.time[worst]:.2f} s"


def _entries(inertial: InertialParameters, measured: bool) -> str:
    return ", ".join(f"I{'xyz'[i]}{'xyz'[j]}" for i, j in ENTRIES if bool(inertial.measured[i, j]) == measured)
