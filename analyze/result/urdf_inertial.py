"""URDF's <inertial> element: mass, centre of mass and inertia tensor, as exports write and answers show it.

`<origin>` is the centre of mass in the link's frame, which is O, that of the object's shape file; the tensor
is about it, along the link's axes for rpy = 0 (wiki.ros.org/urdf/XML/link).
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np

from analyze.types import TENSOR_ENTRIES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from analyze.types import Array
    from schemas.result import Result

SHOWN_DIGITS = 6
"""significant digits of the numbers in the block shown with an answer; far finer than their intervals"""


def inertial_element(mass: float, com: Array, inertia: Array) -> ET.Element:
    """XML element `<inertial>` of a URDF link.

    Args:
        mass: mass [kg].
        com: (3,) centre of mass in O [m].
        inertia: (3, 3) inertia tensor about it, along the axes of O [kg m²].
    """
    own = ET.Element("inertial")
    ET.SubElement(own, "origin", xyz=numbers(com), rpy="0 0 0")
    ET.SubElement(own, "mass", value=numbers([mass]))
    ET.SubElement(own, "inertia", tensor_entries(inertia))
    return own


def inertial_block(result: Result) -> str | None:
    """Text of a result's `<inertial>` element for a URDF file; None if a value is missing or impossible.

    Comments name entries of the tensor that strikes did not measure, and say if this is so for the centre of
    mass in one direction. Lines are short enough for a phone: at most 50 characters.
    """
    if result.mass.value is None or result.centre_of_mass.value is None or result.inertia.value is None:
        return None
    mass, com = float(np.asarray(result.mass.value)), np.array(result.centre_of_mass.value)
    inertia = np.array(result.inertia.value)
    short = _short(inertia)
    if not is_possible(mass, short):
        short = inertia  # At a limit of what bodies can be, as a thin plate: rounding may cross it.
    if not is_possible(mass, short):
        return None
    entries = tensor_entries(short)
    rows = ("ixx", "iyy"), ("izz", "ixy"), ("ixz", "iyz")
    tensor = [" ".join(f'{name}="{entries[name]}"' for name in row) for row in rows]
    return "\n".join(
        [
            "<inertial>",
            *(f"  <!-- {text} -->" for text in _unmeasured(result)),
            '  <origin rpy="0 0 0"',
            f'    xyz="{numbers(_short(com))}"/>',
            f'  <mass value="{numbers(_short(np.array([mass])))}"/>',
            "  <inertia",
            *(f"    {row}" for row in tensor[:-1]),
            f"    {tensor[-1]}/>",
            "</inertial>",
        ]
    )


def is_possible(mass: float, inertia: Array) -> bool:
    """True if a rigid body can have this mass [kg] and inertia tensor (3, 3) [kg m²]; simulators ask for it.

    Mass and principal moments are above 0, and no moment exceeds the sum of the other two.
    """
    least, middle, most = np.linalg.eigvalsh(inertia)
    return bool(mass > 0 and least > 0 and least + middle >= most)


def tensor_entries(inertia: Array) -> dict[str, str]:
    """Entries of `inertia` (3, 3) on and above its diagonal as text, by name: ixx, ixy and so on."""
    return {f"i{'xyz'[i]}{'xyz'[j]}": numbers([inertia[i, j]]) for i in range(3) for j in range(i, 3)}


def numbers(values: Iterable[float]) -> str:
    """Text of numbers separated by blanks, with enough digits to be read back exactly; -0 becomes 0."""
    # Adding 0.0 turns -0 into 0, which readers treat alike.
    return " ".join(repr(float(value) + 0.0) for value in values)


def _short(values: Array) -> Array:
    """Copy of an array with its numbers rounded to `SHOWN_DIGITS` significant digits."""
    return np.array([float(f"{value:.{SHOWN_DIGITS}g}") for value in values.ravel()]).reshape(values.shape)


def _unmeasured(result: Result) -> list[str]:
    """Comments that name what strikes did not measure: entries of the tensor, a direction of c."""
    found: list[str] = []
    measured = result.inertia_measured or [[result.inertia.observed] * 3] * 3
    names = [f"i{'xyz'[i]}{'xyz'[j]}" for i, j in TENSOR_ENTRIES if not measured[i][j]]
    found += [f"from the shape: {', '.join(names[i : i + 3])}" for i in range(0, len(names), 3)]
    if not result.centre_of_mass.observed:
        found.append("xyz not measured in one direction")
    return found
