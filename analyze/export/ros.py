"""Write a ROS 2 message `geometry_msgs/msg/InertiaStamped` as YAML or JSON.

Its `inertia` is a `geometry_msgs/msg/Inertia`; the header names the frame. The message's definition leaves
open to which point the tensor refers: here it is the centre of mass, as in URDF.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

from analyze.export.provenance import provenance_text
from analyze.result.urdf_inertial import tensor_entries

if TYPE_CHECKING:
    from analyze.export.body import ExportBody

MESSAGE = "geometry_msgs/msg/InertiaStamped"
"""type of the message"""


def ros_text(body: ExportBody, *, as_json: bool) -> str:
    """Text of the message with a body's mass [kg], centre of mass [m] and inertia tensor [kg m^2], in O.

    O is the frame of the object's shape file; the message calls it by the object's identifier, as the link
    of a URDF file. YAML begins with the provenance (origin of the numbers) as comments; JSON has no comments,
    and ROS refuses fields that the message lacks: there it is left out.

    Args:
        body: exported body.
        as_json: True for JSON, False for YAML.
    """
    inertial = body.inertial
    entries = {name: float(value) for name, value in tensor_entries(inertial.inertia).items()}
    com = dict(zip("xyz", (float(each) + 0.0 for each in inertial.com), strict=True))
    message = {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": body.identifier},
        "inertia": {"m": inertial.mass, "com": com, **entries},
    }
    if as_json:
        return json.dumps(message, indent=2, allow_nan=False) + "\n"
    notes = [
        f"{MESSAGE}; the inertia is about the centre of mass",
        *provenance_text(body.provenance).split("\n"),
    ]
    comment = "".join(f"# {line}".rstrip() + "\n" for line in notes)
    return comment + "\n".join(_yaml_lines(message, "")) + "\n"


def _yaml_lines(values: Mapping[str, object], indent: str) -> list[str]:
    """Lines of a YAML mapping of names to texts, numbers or further mappings."""
    lines = []
    for name, value in values.items():
        if isinstance(value, Mapping):
            lines += [f"{indent}{name}:", *_yaml_lines(value, f"{indent}  ")]
        else:
            # An identifier such as `yes` or `null` would not be a text without quotation marks.
            shown = json.dumps(value) if isinstance(value, str) else _yaml_number(value)
            lines.append(f"{indent}{name}: {shown}")
    return lines


def _yaml_number(value: object) -> str:
    """Text of a number that YAML 1.1 reads as one: ROS's reader takes 1e-05, without a point, for a text."""
    text = repr(value)
    if "e" in text and "." not in text:
        return text.replace("e", ".0e")
    return text
