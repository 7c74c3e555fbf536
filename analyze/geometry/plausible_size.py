"""Refuse a shape whose size or density no object has, mostly because of a wrong unit."""

from __future__ import annotations

from analyze.errors import ShapeError
from analyze.types import Array
from schemas.object_spec import LengthUnit

MIN_EXTENT = 0.005
"""Smallest length of an object's longest edge [m]."""
MAX_EXTENT = 1.5
"""Largest length of an object's longest edge [m]."""
DENSITIES = (2.0, 12_000.0)
"""Plausible densities [kg/m^3]; lead has 11 300."""


def refuse_implausible(name: str, extent: Array, volume: float, mass: float, unit: LengthUnit | None) -> None:
    """Raise ShapeError for a shape of implausible size or density, with a unit that would fit.

    Args:
        name: Name of the shape, for the message.
        extent: (3,) edges of its bounding box [m].
        volume: Its volume [m^3].
        mass: Mass of the object [kg].
        unit: Declared unit of the shape file; None for a primitive.
    """
    refuse_size(name, extent, unit)
    density = mass / volume
    if not DENSITIES[0] <= density <= DENSITIES[1]:
        other = _fitting_unit(float(extent.max()), unit, density)
        remedy = "correct mass_kg (in kilograms), or scale the shape to its true size"
        if other is not None:
            remedy = f'did you mean unit = "{other.value}"?, or correct mass_kg (in kilograms)'
        raise ShapeError(
            f"{name}: {_size(extent, unit)} at {mass:g} kg means {density:.3g} kg/m3, not "
            f"{DENSITIES[0]:g} to {DENSITIES[1]:g}: {remedy}"
        )


def refuse_size(name: str, extent: Array, unit: LengthUnit | None) -> None:
    """Raise ShapeError unless the bounding box's longest edge is from `MIN_EXTENT` to `MAX_EXTENT`.

    Args:
        name: Name of the shape, for the message.
        extent: (3,) edges of its bounding box [m].
        unit: Declared unit of the shape file; None for a primitive.
    """
    longest = float(extent.max())
    if not MIN_EXTENT <= longest <= MAX_EXTENT:
        raise ShapeError(
            f"{name}: {_size(extent, unit)} is no object to strike (its longest edge must be "
            f"{MIN_EXTENT:g} to {MAX_EXTENT:g} m): {_other_unit(longest, unit)}"
        )


def _size(extent: Array, unit: LengthUnit | None) -> str:
    """Text of the bounding box's edges `extent` (3,) [m], with the declared unit if any, for messages."""
    scale, word = (1.0, "m") if float(extent.max()) > MAX_EXTENT else (1000.0, "mm")
    given = "" if unit is None else f' with unit = "{unit.value}"'
    return " x ".join(f"{edge * scale:.4g}" for edge in extent) + f" {word}{given}"


def _other_unit(longest: float, unit: LengthUnit | None) -> str:
    """Remedy for an implausible size, as text: a unit in which the longest edge is plausible, or advice.

    Args:
        longest: Longest edge [m] with the declared unit.
        unit: Declared unit; None for a primitive.
    """
    if unit is None:
        return "give box and cylinder in metres"
    other = _fitting_unit(longest, unit)
    if other is None:
        return (
            "no unit gives it a plausible size: export it anew, or give a box or cylinder with its dimensions"
        )
    return f'did you mean unit = "{other.value}"?'


def _fitting_unit(longest: float, unit: LengthUnit | None, density: float | None = None) -> LengthUnit | None:
    """Another unit that gives a plausible size: 0.03 m to 0.6 m, or else any that can be struck; or None.

    Args:
        longest: Longest edge [m] with the declared unit.
        unit: Declared unit; None for a primitive.
        density: Density [kg/m^3] with the declared unit, which the other must make plausible; None if it does
            not matter.
    """
    if unit is None:
        return None
    plain = longest / unit.metres
    for low, high in ((0.03, 0.6), (MIN_EXTENT, MAX_EXTENT)):
        for other in LengthUnit:
            if other is unit or not low <= plain * other.metres <= high:
                continue
            if density is None or DENSITIES[0] <= density * (unit.metres / other.metres) ** 3 <= DENSITIES[1]:
                return other
    return None
