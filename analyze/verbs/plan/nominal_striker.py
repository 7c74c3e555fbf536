"""Nominal striker and mat, where no rig file states them, for heavy, light and wide objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from analyze.planning.impact import StrikerModel
from analyze.planning.prepared import WORTHWHILE, PreparedObject
from analyze.planning.remedies import bench_remedy

HEAVIER, LIGHTER = (2.0, 4.0, 6.0, 8.0), (0.5, 0.25)
"""multiples of the nominal effective mass that are tried in turn: up to 1.6 kg, and down to 50 g

The heaviest takes 1.06 N m to hold in the cocked position; the servo gives 1.3 N m at its limit of 1 A.
"""


FRICTIONS = (0.5, 0.6, 0.7)
"""friction coefficients that are tried in turn; a strip of fine sandpaper has 0.6 to 0.8"""


def prepared_for_mat(prepared: PreparedObject) -> tuple[PreparedObject, str]:
    """Object prepared for a rougher mat, and perhaps another striker, if its edges slide on the nominal one.

    That is done if the centre of mass is otherwise unknown, or known only roughly.

    Args:
        prepared: the object with the axes that it can be tipped over on the nominal mat.

    Returns:
        The object as it is to be planned, and a note on the mat; without a change the object as given, and an
        empty note.
    """
    if prepared.is_accurate:
        return prepared, ""
    remedy = bench_remedy(prepared, FRICTIONS)
    if remedy is None:
        return prepared, ""
    return remedy.prepared, (
        f"the nominal rig does not suffice for this object: {remedy.text}. State yours in a rig file "
        "(table_friction, [striker] effective_mass_kg, and --rig)"
    )


def prepared_for_striker(
    prepared: PreparedObject, prepare: Callable[[StrikerModel], PreparedObject]
) -> tuple[PreparedObject, str]:
    """Object prepared for a striker whose speeds suffice, if the nominal one's do not.

    A heavy object needs a tip speed that the nominal striker does not reach, a light one less than its
    slowest. If that is why its axes leave the centre of mass unknown, or known only roughly, heavier and
    lighter strikers are tried. The first with which it is known well is taken, or else the one with which it
    is known best.

    Args:
        prepared: the object with the axes that the nominal striker can tip it over.
        prepare: prepares the object anew, for another striker.

    Returns:
        The object as it is to be planned, and a note on the striker; without a change the object as given,
        and an empty note.
    """
    needed = [each.number for each in prepared.rejected if each.code == "speed" and each.number is not None]
    if not needed or prepared.is_accurate:
        return prepared, ""
    nominal = prepared.bench.striker
    factors = (
        *(HEAVIER if max(needed) > nominal.fastest_m_s else ()),
        *(LIGHTER if min(needed) < nominal.slowest_m_s else ()),
    )
    best = prepared
    for factor in factors:
        other = prepare(multiplied(nominal, factor))
        if other.com_error < min(WORTHWHILE * prepared.com_error, best.com_error):
            best = other
        if best.is_accurate:
            break
    return best, "" if best is prepared else _note(nominal, best.bench.striker, needed)


def multiplied(striker: StrikerModel, factor: float) -> StrikerModel:
    """Striker with `factor` times the effective mass, as well known relative to it."""
    return replace(
        striker,
        effective_mass_kg=factor * striker.effective_mass_kg,
        effective_mass_sd_kg=factor * striker.effective_mass_sd_kg,
    )


def _note(nominal: StrikerModel, striker: StrikerModel, needed: list[float]) -> str:
    """Sentence: effective mass [g] of the striker that is planned for, and why the nominal one is not."""
    low, high = (f"{value:.2f}" for value in (min(needed), max(needed)))
    span = low if low == high else f"{low} to {high}"
    return (
        f"planned for a striker with an effective mass of {1000 * striker.effective_mass_kg:.0f} g: the "
        f"nominal {1000 * nominal.effective_mass_kg:.0f} g would have to strike at {span} m/s, and it gives "
        f"{nominal.slowest_m_s:.2f} to {nominal.fastest_m_s:.2f} m/s. State yours in a rig file "
        "([striker] effective_mass_kg, and --rig)"
    )
