"""Provenance in an exported file: origin of each number (strikes or prior), with standard deviations.

The prior is the assumption on the inertia tensor from the shape alone. An exported file holds the provenance
as JSON.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

import numpy as np

from analyze.types import TENSOR_ENTRIES, tensor_entry_name
from schemas.result import Result

UNPRINTABLE = re.compile(
    "[\x00-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff0-\uffff\ud800-\udfff]"
)
"""characters that XML forbids, or that a reader of the file would not see"""


def prior_entries(result: Result) -> list[tuple[int, int]]:
    """Entries (i, j), i <= j, of a result's inertia tensor that come from the shape instead of strikes.

    The list is empty if all entries are measured; it has all six if an older result does not state which are.
    """
    if result.inertia.observed:
        return []
    if result.inertia_measured is None:
        return list(TENSOR_ENTRIES)
    return [entry for entry in TENSOR_ENTRIES if not result.inertia_measured[entry[0]][entry[1]]]


def provenance(
    result: Result, name: str, software: str, contact: Mapping[str, object] | None = None
) -> dict[str, object]:
    """Origin of a result's numbers, as a dict of JSON values for the exported file.

    It holds ids and hashes of the inputs; mass, centre of mass and inertia tensor in O (the frame of the
    object's shape file), each with standard deviation and source; and the codes of the warnings. The same
    result and program give the same values.

    Args:
        result: result that is exported; it must contain an inertia tensor.
        name: object name from the object file.
        software: name and version of the program that writes the file.
        contact: entries on friction and restitution (`export_contact`); None for none.
    """
    inputs = result.inputs
    prior = prior_entries(result)
    value = np.array(result.inertia.value, dtype=np.float64)
    sd = None if result.inertia.sd is None else np.array(result.inertia.sd, dtype=np.float64).reshape(3, 3)
    tensor = {
        tensor_entry_name(entry): {
            "value": float(value[entry]),
            "sd": None if sd is None else float(sd[entry]),
            "source": "prior" if entry in prior else "measured",
        }
        for entry in TENSOR_ENTRIES
    }
    com = result.centre_of_mass
    return {
        "object": name,
        "written_by": software,
        "estimated_by": inputs.software,
        "recording_id": inputs.recording_id,
        "content_id": inputs.content_id,
        "object_sha256": inputs.object_sha256,
        "plan_sha256": inputs.plan_sha256,
        "configuration_sha256": inputs.configuration_sha256,
        "frame": (
            "O, the object file's; metres, kilograms, kg m2; the inertia is about the centre of mass; sd is "
            "1 sigma"
        ),
        "mass": {"value": result.mass.value, "sd": result.mass.sd, "source": result.mass.source},
        "centre_of_mass": {
            "value": com.value,
            "sd": com.sd,
            "source": com.source,
            "observed": com.observed,
            "unobserved_direction": com.unobserved_direction,
        },
        "inertia": tensor,
        **(contact or {}),
        "warnings": sorted({warning.code.value for warning in result.warnings}),
    }


def provenance_text(provenance: Mapping[str, object]) -> str:
    """Provenance (origin of the exported numbers) as JSON text, an entry per line, for an XML comment.

    The text starts with the word "percuss". It contains no two hyphens in a row, none at its end, and no
    invisible characters but blanks and line ends.
    """
    lines = [f"  {json.dumps(key)}: {_json(value)}" for key, value in provenance.items()]
    return " percuss\n{\n" + ",\n".join(lines) + "\n}\n"


def printable(text: str) -> str:
    """Copy of `text` with JSON escapes for characters that are invisible or that XML or USD cannot hold.

    An escape is a backslash, "u" and four hexadecimal digits.
    """
    return UNPRINTABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def _json(value: object) -> str:
    text = printable(json.dumps(value, ensure_ascii=False, allow_nan=False))
    # Two hyphens in a row occur in strings only, not in JSON's numbers or brackets.
    return re.sub("-(?=-)", r"\\u002d", text)
