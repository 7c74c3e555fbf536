"""Remedies of a refusal, each tried on the planner itself before it is stated: what would give a plan.

A remedy changes the bench (mat, striker), the tags or the body. It counts if the axes that are then usable
determine the centre of mass; where they did before, if its error becomes smaller by `WORTHWHILE`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from analyze.planning.examine import Bench
from analyze.planning.glued_tags import with_glued_tags
from analyze.planning.impact import HAND
from analyze.planning.prepared import WORTHWHILE, PreparedObject, prepare_object
from analyze.planning.view import FAULT_CODES
from schemas.object_spec import ObjectSpec
from schemas.rig_limits import MIN_TAG_EDGE_PX

FRICTIONS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Friction coefficients of mats, in the order in which they are tried."""
FRICTIONS_WITH_MASS = (0.6, 0.8, 1.0)
"""Those that are tried together with another effective mass, besides the largest that a mat may have."""
HEAVIER_KG, LIGHTER_KG = (0.35, 0.5, 0.8, 1.2, 1.6), (0.1, 0.05)
"""Effective masses of the striker's arm [kg] that are tried, for strikes too fast and too slow for it."""
LARGER_TAG = 1.1
"""Margin of a larger tag over the smallest legible one."""
TAG_REMEDIES = {
    "tag_small": "print larger tags (a card may jut out over a narrow face), or bring the camera nearer",
    "out_of_image": (
        "move or turn the camera (camera.calibration in the rig file), or glue the tags where it sees the "
        "whole tip"
    ),
    "no_marker": "glue markers to the faces square to the edges",
    "hidden": "glue the tags where no part of the object stands before them",
}
"""Remedies by code of a marker's fault, the easiest first."""
GLUED_CODES = frozenset({"no_marker", "hidden"})
"""Codes whose remedy is tried with tags on all faces of the object; the others' with tags always in view."""
BY_HAND = "strike by hand (--camera), or change the striker: arm, servo, reach, speed limits (rig file)"
"""Remedy for strikes too slow, too fast, too low or too high for a striker."""
PLATE = (
    "glue on an upright plate that the striker can meet, its weight given as a marker's, and scan both "
    "together"
)
"""Remedy for objects without a place that the striker can meet."""


@dataclass(frozen=True)
class Remedy:
    """Change with which the object can be planned."""

    text: str
    """Instruction to the user."""
    prepared: PreparedObject
    """Object prepared with the change."""


@dataclass(frozen=True)
class _Change:
    """Change to be tried: instruction, object file and bench."""

    text: str
    spec: ObjectSpec
    bench: Bench


def bench_remedy(prepared: PreparedObject, frictions: Sequence[float] = FRICTIONS) -> Remedy | None:
    """Smallest change of mat and striker's effective mass with which an object can be planned.

    Tried are, as far as the rejections ask for them, a rougher mat, then a heavier or lighter arm, with a
    rougher mat if need be.

    Args:
        prepared: Object whose usable axes do not determine the centre of mass.
        frictions: Friction coefficients that a mat may have, ascending.
    """
    for changes in _bench_changes(prepared, frictions):
        # What the roughest mat does not free, the others do not either.
        roughest = _try(prepared, changes[-1])
        if roughest is not None:
            return next((found for each in changes[:-1] if (found := _try(prepared, each))), roughest)
    return None


def first_remedy(prepared: PreparedObject) -> Remedy | None:
    """Easiest remedy with which an object can be planned; None if none of those that are tried suffices.

    In this order: mat and striker's mass; tags; a hand in place of the striker; a plate to strike; tags or
    hand together with mat and mass.

    Args:
        prepared: Object whose usable axes do not determine the centre of mass.
    """
    if (found := bench_remedy(prepared)) is not None:
        return found
    others = [*_tag_changes(prepared), *_striker_changes(prepared)]
    for change in others:
        if (found := _try(prepared, change)) is not None:
            return found
    for change in others:
        changed = _prepared(prepared, change)
        if (found := bench_remedy(changed)) is not None:
            return replace(found, text=f"{change.text}, and {found.text}")
    return None


def _try(prepared: PreparedObject, change: _Change) -> Remedy | None:
    """Remedy if the object can be planned with a change, and clearly better if it can without; else None."""
    changed = _prepared(prepared, change)
    return Remedy(change.text, changed) if changed.com_error < WORTHWHILE * prepared.com_error else None


def _prepared(prepared: PreparedObject, change: _Change) -> PreparedObject:
    return prepare_object(
        prepared.model, change.spec, change.bench, prepared.information.errors, prepared.given
    )


def _bench_changes(prepared: PreparedObject, frictions: Sequence[float]) -> Iterator[list[_Change]]:
    """Rougher mats, in ascending order, for the own arm and then for each of another effective mass.

    They are yielded as far as the rejections ask for them: mats if edges slide, arms if speeds are out of the
    striker's range, or if mats do not help.

    Args:
        prepared: Object whose usable axes do not determine the centre of mass.
        frictions: Friction coefficients that a mat may have, ascending.
    """
    striker, own = prepared.bench.striker, prepared.bench.striker.effective_mass_kg
    numbers = {
        code: [each.number for each in prepared.rejected if each.code == code and each.number is not None]
        for code in ("slips", "speed")
    }
    least = min(numbers["slips"], default=max(frictions) + 1)
    mats = [mat for mat in frictions if mat > prepared.bench.friction and mat >= least]
    fastest, slowest = max(numbers["speed"], default=0.0), min(numbers["speed"], default=striker.fastest_m_s)
    masses = [mass for mass in HEAVIER_KG if mass > own and (fastest > striker.fastest_m_s or mats)]
    masses += [mass for mass in LIGHTER_KG if mass < own and slowest < striker.slowest_m_s]
    if mats:
        yield [_bench_change(prepared, mat, own) for mat in mats]
    rougher = [mat for mat in mats if mat in FRICTIONS_WITH_MASS or mat == mats[-1]]
    for mass in masses:
        yield [_bench_change(prepared, mat, mass) for mat in (prepared.bench.friction, *rougher)]


def _bench_change(prepared: PreparedObject, mat: float, mass: float) -> _Change:
    """Change to a mat of friction `mat` and an arm with the effective mass `mass` [kg]."""
    bench, own = prepared.bench, prepared.bench.striker.effective_mass_kg
    parts: list[str] = []
    if mat > bench.friction:
        parts.append(f"a mat with more friction, at least {mat:.1f} (rubber, fine sandpaper)")
    if mass != own:
        parts.append(f"an arm with an effective mass of {1000 * mass:.0f} g")
    sd = bench.striker.effective_mass_sd_kg * mass / own
    striker = replace(bench.striker, effective_mass_kg=mass, effective_mass_sd_kg=sd)
    changed = replace(bench, friction=mat, striker=striker)
    return _Change("use " + " and ".join(parts), prepared.spec, changed)


def _tag_changes(prepared: PreparedObject) -> Iterator[_Change]:
    """Changes of tags and camera, as far as rejections ask for them."""
    spec, bench = prepared.spec, prepared.bench
    small = [each.number for each in prepared.rejected if each.code == "tag_small" and each.number]
    if small:
        larger = LARGER_TAG * MIN_TAG_EDGE_PX / min(small)
        markers = [each.model_copy(update={"size_m": larger * each.size_m}) for each in spec.marker]
        yield _Change(TAG_REMEDIES["tag_small"], spec.model_copy(update={"marker": markers}), bench)
    codes = {each.code for each in prepared.rejected} & set(FAULT_CODES)
    anywhere = [each.model_copy(update={"T_object_marker": None}) for each in spec.marker]
    for code, text in TAG_REMEDIES.items():
        if code in codes & GLUED_CODES:
            yield _Change(text, with_glued_tags(prepared.model, spec), bench)
        elif code in codes:
            yield _Change(text, spec.model_copy(update={"marker": anywhere}), bench)


def _striker_changes(prepared: PreparedObject) -> Iterator[_Change]:
    """A hand in place of the striker, and a plate to strike, as far as rejections ask for them."""
    spec, bench = prepared.spec, prepared.bench
    codes = {each.code for each in prepared.rejected}
    if codes & {"speed", "impact_unreachable"}:
        yield _Change(BY_HAND, spec, replace(bench, striker=HAND))
    if "impact_unreachable" in codes:
        yield _Change(PLATE, spec, replace(bench, has_plate=True))
