"""Differences between two object files of one object, entry by entry, with what each of them changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from schemas.object_spec import ObjectSpec

_NAMED_BY = {"marker": "name", "edge": "id", "labels": "name", "fixture": "name"}
"""lists of the object file whose entries are compared by a name of their own, not by their place"""
_SHAPE_ERRORS = ("shape.surface_sd_m", "shape.scale_sd")
SHAPE_FILE = "shape.file"
"""entry of the shape file, which differs if its bytes do"""

_EFFECTS = (
    (("name",), "the name alone"),
    (("mass_kg", "mass_sd_kg", "mass_includes_markers"), "mass, moments of inertia, masses of regions"),
    (_SHAPE_ERRORS, "errors of all edges"),
    (("shape",), "the shape: edges of the plan are checked"),
    (("edge_radius_m", "edge_radius_sd_m", "edge"), "pivot lines and their errors"),
    (("shell_thickness_m",), "masses of regions"),
    (("labels",), "masses of parts"),
    (("fixture", "held"), "what is subtracted for the fixture"),
    (("marker",), "tracking: strikes are read again"),
)
"""what an entry changes, by the beginning of its name; the first that fits counts"""
_MARKER_EFFECTS = {
    "T_object_marker": "slip, moment balance, checks of placement",
    "place_sd_m": "slip, moment balance, checks of placement",
    "turn_sd_rad": "slip, moment balance, checks of placement",
    "thickness_m": "analyze register",
    "mass_kg": "mass, if it was weighed without markers",
}


@dataclass(frozen=True)
class Change:
    """One entry in which two object files differ, with both values and what they change in the answer."""

    entry: str
    """name of the entry, such as mass_kg or marker 3: T_object_marker"""
    before: str
    """value in the recorded object file; "-" if it has none"""
    after: str
    """value in the other object file; "-" if it has none"""
    effect: str
    """quantities that the entry changes"""
    of_shape: bool
    """True if it changes the surface of the shape, on whose edges the strikes were made"""


def object_changes(
    before: ObjectSpec, after: ObjectSpec, *, shape_differs: bool, shape_names: tuple[str, str]
) -> list[Change]:
    """Entries in which two object files differ, in the order of the first file's keys.

    Markers, edges, parts and fixture bodies are compared by their names, so that their order does not count.

    Args:
        before: the recorded object file.
        after: the other object file.
        shape_differs: True if the contents of their shape files differ.
        shape_names: short hashes of both shape files, for the table.
    """
    old, new = _flat(before), _flat(after)
    if shape_differs:
        old[SHAPE_FILE], new[SHAPE_FILE] = shape_names
    elif before.shape.file is not None and after.shape.file is not None:
        old.pop(SHAPE_FILE)  # the file's name alone
        new.pop(SHAPE_FILE)
    found: list[Change] = []
    for entry in dict.fromkeys([*old, *new]):
        a, b = old.get(entry), new.get(entry)
        if a != b:
            found.append(Change(entry, _text(a), _text(b), _effect(entry), _is_of_shape(entry)))
    return _whole_entries(found)


def _flat(spec: ObjectSpec) -> dict[str, Any]:
    """Entries of an object file that are given, by dotted names; named lists by their entries' names."""
    return dict(_entries(spec.model_dump(mode="json"), "", spec))


def _entries(values: Mapping[str, Any], prefix: str, spec: ObjectSpec) -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if value is None:
            continue
        if not prefix and key in _NAMED_BY:
            names = [getattr(each, _NAMED_BY[key]) for each in getattr(spec, key)]
            for name, each in zip(names, value, strict=True):
                yield from _entries(each, f"{key} {name}: ", spec)
        elif isinstance(value, dict):
            yield from _entries(value, f"{prefix}{key}.", spec)
        else:
            yield prefix + key, value


def _whole_entries(changes: list[Change]) -> list[Change]:
    """Merge the changes of a marker, edge or part that only one of the files has into one change."""
    groups: dict[str, list[Change]] = {}
    for change in changes:
        groups.setdefault(change.entry.partition(": ")[0] if ": " in change.entry else "", []).append(change)
    found: list[Change] = []
    for change in changes:
        head, colon, _ = change.entry.partition(": ")
        group = groups[head] if colon else []
        required = {"marker": "id", "edge": "id", "labels": "name", "fixture": "name"}.get(head.split()[0])
        one_sided = colon and any(each.entry == f"{head}: {required}" for each in group)
        if not one_sided:
            found.append(change)
        elif change is group[0]:
            given = "given", "-"
            before, after = given if change.after == "-" else given[::-1]
            found.append(Change(head, before, after, _effect(f"{head}: "), of_shape=False))
    return found


def _effect(entry: str) -> str:
    head, colon, key = entry.partition(": ")
    if colon and head.startswith("marker ") and key in _MARKER_EFFECTS:
        return _MARKER_EFFECTS[key]
    name = head.split()[0] if colon else entry
    return next(
        text for starts, text in _EFFECTS if any(name == s or name.startswith(f"{s}.") for s in starts)
    )


def _is_of_shape(entry: str) -> bool:
    return entry.startswith("shape.") and entry not in _SHAPE_ERRORS


def _text(value: object) -> str:
    """Short text of a value: numbers with 9 digits, a pose as its centre in mm and its z axis."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, list):
        rows: list[Any] = value
        if len(rows) == 4 and all(isinstance(row, list) and len(row) == 4 for row in rows):
            centre = ", ".join(f"{1000 * row[3]:.2f}" for row in rows[:3])
            axes = "; ".join(", ".join(f"{rows[i][j]:.4g}" for i in range(3)) for j in (0, 2))
            return f"({centre}) mm, x and z axes ({axes})"
        return f"[{', '.join(_text(each) for each in rows)}]"
    return str(value)
