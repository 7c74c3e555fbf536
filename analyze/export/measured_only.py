"""The refusal of a body that is not measured throughout: what is the shape's, and what would measure it, in one line."""

from __future__ import annotations

import numpy as np

from analyze.errors import ExportError
from analyze.export.measurable import Remedy, remedy
from analyze.export.provenance import entry_name, prior_entries
from analyze.geometry.object_model import ObjectModel
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.result import Result

MOST_NAMED = 3
"""edges in one line"""


def refuse_prior(result: Result, spec: ObjectSpec, model: ObjectModel, name: str) -> None:
    """Let only a body pass whose centre of mass was observed and whose tensor was measured in every entry.

    Raises:
        ExportError: something is the shape's; says what, and which strikes would tell it.
    """
    com, missing = result.centre_of_mass, prior_entries(result)
    if not com.observed:
        direction = com.unobserved_direction
        along = "" if direction is None else f" along {_along(np.array(direction, dtype=np.float64))}"
        raise ExportError(
            f"{name}: not all is measured: no strike tells where the centre of mass lies{along}: "
            "tip it over an edge across that direction, or export without --measured-only"
        )
    if missing:
        where = np.array(com.value, dtype=np.float64)
        made = [np.array(moment.direction, dtype=np.float64) for moment in result.moments]
        entries = ", ".join(map(entry_name, missing))
        what = f"{name}: not all is measured: {entries} of the inertia {'is' if len(missing) == 1 else 'are'} from the shape"
        raise ExportError(f"{what}: {_remedy_text(remedy(model, spec, where, made, missing), len(missing))}")


def _remedy_text(found: Remedy, missing: int) -> str:
    otherwise = "export without --measured-only, the file then says which entries are from the shape"
    if not found.axes:
        return f"no edge of this object lies so that a tip over it would tell: {otherwise}"
    named = [f"{axis.id} (along {_along(axis.direction)})" for axis in found.axes[:MOST_NAMED]]
    many = f"; {len(found.axes) - MOST_NAMED} edges more" if len(found.axes) > MOST_NAMED else ""
    edges = f"tips over {'edge' if len(named) == 1 else 'edges'} {', '.join(named)}{many}"
    if not found.never:
        return f"{edges} would measure {'it' if missing == 1 else 'them'}: plan with --given, or {otherwise}"
    never = ", ".join(map(entry_name, found.never))
    if len(found.never) == missing:
        return f"no edge of this object tells {never} well enough, best would be {edges}: {otherwise}"
    return f"{edges} would measure the rest, but no edge of this object tells {never}: {otherwise}"


def _along(direction: Array) -> str:
    """A line's direction, as +x+y or in numbers; a line has no sign, so the largest component is positive."""
    direction = direction * (1 if direction[np.argmax(np.abs(direction))] > 0 else -1)
    for i, axis in enumerate("xyz"):
        if abs(direction[i]) > 0.9999:
            return axis
    return "(" + ", ".join(f"{component:.2f}" for component in direction + 0.0) + ")"
