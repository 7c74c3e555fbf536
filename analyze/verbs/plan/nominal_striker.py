"""Nominal striker and mat, where no rig file states them, for heavy, light and wide objects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from analyze.planning import design
from analyze.planning.impact import StrikerModel
from analyze.planning.prepared import PreparedObject
from analyze.planning.remedies import bench_remedy

HEAVIER, LIGHTER = (2.0, 4.0, 6.0), (0.5, 0.25)
"""multiples of the nominal effective mass that are tried in turn: up to 1.2 kg, and down to 50 g"""


FRICTIONS = (0.5, 0.6, 0.7)
"""friction coefficients that are tried in turn; a strip of fine sandpaper has 0.6 to 0.8"""


def prepared_for_mat(prepared: PreparedObject) -> tuple[PreparedObject, str]:
    """Object prepared for a rougher mat, and perhaps another striker, if its edges slide on the nominal one.

    Args:
        prepared: the object with the axes that it can be tipped over on the nominal mat.

    Returns:
        The object as it is to be planned, and a note on the mat; without a change the object as given, and an
        empty note.
    """
    if design.can_determine_com(prepared.information):
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
    slowest. If that is why its axes leave the centre of mass unknown, heavier or lighter strikers are tried.

    Args:
        prepared: the object with the axes that the nominal striker can tip it over.
        prepare: prepares the object anew, for another striker.

    Returns:
        The object as it is to be planned, and a note on the striker; without a change the object as given,
        and an empty note.
    """
    needed = [each.number for each in prepared.rejected if each.code == "speed" and each.number is not None]
    if not needed or design.can_determine_com(prepared.information):
        return prepared, ""
    nominal = prepared.bench.striker
    factors = (
        *(HEAVIER if max(needed) > nominal.fastest_m_s else ()),
        *(LIGHTER if min(needed) < nominal.slowest_m_s else ()),
    )
    for factor in factors:
        striker = multiplied(nominal, factor)
        other = prepare(striker)
        if design.can_determine_com(other.information):
            return other, _note(nominal, striker, needed)
    return prepared, ""


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
