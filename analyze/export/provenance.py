"""What an exported file says of its numbers: where they come from, which are measured and which the shape's prior, each with its sd."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

import numpy as np

from schemas.result import Quantity, Result

ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
UNPRINTABLE = re.compile(
    "[\x00-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff0-\uffff\ud800-\udfff]"
)
"""what XML forbids, and what a reader of the file would not see"""


def entry_name(entry: tuple[int, int]) -> str:
    """As Ixx or Ixy."""
    return "I" + "".join("xyz"[index] for index in entry)


def prior_entries(result: Result) -> list[tuple[int, int]]:
    """Entries of the tensor that come from the shape, not from strikes; all of them where an older result does not say."""
    if result.inertia.observed:
        return []
    if result.inertia_measured is None:
        return list(ENTRIES)
    return [entry for entry in ENTRIES if not result.inertia_measured[entry[0]][entry[1]]]


def provenance(result: Result, name: str, software: str) -> dict[str, object]:
    """What a file says of itself, as JSON values; the same for the same result and program.

    Args:
        result: what is exported.
        name: the object's, as its owner writes it.
        software: the program that writes the file.
    """
    inputs = result.inputs
    prior = prior_entries(result)
    value = np.array(result.inertia.value, dtype=np.float64)
    sd = _nine(result.inertia)
    tensor = {
        entry_name(entry): {
            "value": float(value[entry]),
            "sd": None if sd is None else float(sd[entry]),
            "source": "prior" if entry in prior else "measured",
        }
        for entry in ENTRIES
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
        "frame": "O, the object file's; metres, kilograms, kg m2; the inertia is about the centre of mass; sd is 1 sigma",
        "mass": {"value": result.mass.value, "sd": result.mass.sd, "source": result.mass.source},
        "centre_of_mass": {
            "value": com.value,
            "sd": com.sd,
            "source": com.source,
            "observed": com.observed,
            "unobserved_direction": com.unobserved_direction,
        },
        "inertia": tensor,
        "warnings": sorted({warning.code.value for warning in result.warnings}),
    }


def provenance_text(said: Mapping[str, object]) -> str:
    """`said` as JSON, an entry per line, such as an XML comment may hold: no two hyphens in a row, none at the end, nothing unprintable."""
    lines = [f"  {json.dumps(key)}: {_json(value)}" for key, value in said.items()]
    return " percuss\n{\n" + ",\n".join(lines) + "\n}\n"


def printable(text: str) -> str:
    """`text` with escapes, as JSON has them, for what XML forbids, USD cuts off at, and nobody would see."""
    return UNPRINTABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def parse_provenance(text: str) -> dict[str, object]:
    """What `provenance_text` wrote."""
    return json.loads(text.partition("\n")[2])


def _json(value: object) -> str:
    text = printable(json.dumps(value, ensure_ascii=False, allow_nan=False))
    # Inside a string only: no number and no bracket of JSON has two hyphens in a row.
    return re.sub("-(?=-)", r"\\u002d", text)


def _nine(quantity: Quantity) -> np.ndarray | None:
    if quantity.sd is None:
        return None
    return np.array(quantity.sd, dtype=np.float64).reshape(3, 3)
