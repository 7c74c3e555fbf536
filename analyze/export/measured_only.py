"""Refuse to export a body that is not fully measured, and name the edges that would measure the rest."""

from __future__ import annotations

import numpy as np

from analyze.errors import ExportError
from analyze.export.measurable import AdditionalEdges, additional_edges
from analyze.export.provenance import prior_entries
from analyze.geometry.object_model import ObjectModel
from analyze.types import Array, tensor_entry_name
from schemas.object_spec import ObjectSpec
from schemas.result import Result
from schemas.wording import counted

MAX_NAMED = 3
"""largest number of edges named"""


def refuse_prior(result: Result, spec: ObjectSpec, model: ObjectModel, name: str) -> None:
    """Raise ExportError unless the centre of mass is observed and every inertia tensor entry is measured.

    Args:
        result: result to be exported.
        spec: object file.
        model: exterior of the object, in which edges are searched.
        name: name of the object, for messages.

    Raises:
        ExportError: the centre of mass is not determined in some direction, or an entry of the tensor comes
            from the shape; the message names it and, for entries, the edges that would measure them.
    """
    com, missing = result.centre_of_mass, prior_entries(result)
    if not com.observed:
        direction = com.unobserved_direction
        along = "" if direction is None else f" along {_along(np.array(direction, dtype=np.float64))}"
        raise ExportError(
            f"{name}: not fully measured: no strike determines the centre of mass{along}: tip it over an "
            "edge across that direction, or export without --measured-only"
        )
    if missing:
        where = np.array(com.value, dtype=np.float64)
        made = [np.array(moment.direction, dtype=np.float64) for moment in result.moments]
        entries = ", ".join(map(tensor_entry_name, missing))
        verb = "is" if len(missing) == 1 else "are"
        what = f"{name}: not fully measured: {entries} of the inertia {verb} from the shape"
        raise ExportError(
            f"{what}: {_remedy_text(additional_edges(model, spec, where, made, missing), len(missing))}"
        )


def _remedy_text(found: AdditionalEdges, missing: int) -> str:
    """Remedy, in words, for an inertia tensor that is not fully measured.

    It names the edges to tip over, the entries that no edge measures, and the option to export without full
    measurement.

    Args:
        found: edges to tip over, perhaps none, and the entries that stay unmeasured.
        missing: number of entries that are not measured so far.
    """
    otherwise = "export without --measured-only: the file then marks the entries from the shape"
    if not found.axes:
        return f"no edge of this object would measure them: {otherwise}"
    named = [f"{axis.id} (along {_along(axis.direction)})" for axis in found.axes[:MAX_NAMED]]
    many = f"; {counted(len(found.axes) - MAX_NAMED, 'edge')} more" if len(found.axes) > MAX_NAMED else ""
    edges = f"tips over {'edge' if len(named) == 1 else 'edges'} {', '.join(named)}{many}"
    if not found.unreachable:
        return f"{edges} would measure {'it' if missing == 1 else 'them'}: plan with --given, or {otherwise}"
    unreachable = ", ".join(map(tensor_entry_name, found.unreachable))
    if len(found.unreachable) == missing:
        return f"no edge of this object determines {unreachable} well enough; best are {edges}: {otherwise}"
    return f"{edges} would measure the rest, but no edge of this object determines {unreachable}: {otherwise}"


def _along(direction: Array) -> str:
    """Text of a unit direction (3,): "x" if it is a coordinate axis, else such as "(0.71, 0.71, 0.00)".

    Opposite directions give the same text: a direction is reversed if its largest component is negative.
    """
    direction = direction * (1 if direction[np.argmax(np.abs(direction))] > 0 else -1)
    for i, axis in enumerate("xyz"):
        if abs(direction[i]) > 0.9999:
            return axis
    return "(" + ", ".join(f"{component:.2f}" for component in direction + 0.0) + ")"
