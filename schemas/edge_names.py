"""Names of edges that a person can point at, as "bottom edge, +x side", by the object file's axes."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from schemas.strike_plan import PlannedStrike

SIDE_COMPONENT = 0.5
"""component of a unit normal along an axis of the object file above which a face counts as on that side"""
UPRIGHT_COMPONENT = 0.7
"""component of an edge's direction along z above which the edge is called upright"""


def edge_names(strikes: Iterable[PlannedStrike]) -> dict[str, str]:
    """Names of the pivot edges of planned strikes, by axis id; no two are the same.

    An edge lies between the face underneath and the side towards which the object tips, and is named by both:
    top and bottom are +z and -z of the object file. If several edges have one name, each also gets the side
    underneath; if that is not enough, its position [mm] in the object file's frame, or its axis id.

    Args:
        strikes: planned strikes; several may be about one edge.
    """
    edges = {strike.axis_id: strike for strike in reversed(list(strikes))}
    names = {axis_id: _bare_name(strike) for axis_id, strike in edges.items()}
    for more in (_side_underneath, _place, _axis_id):
        counts = Counter(names.values())
        names = {
            axis_id: name if counts[name] == 1 else f"{name}, {more(edges[axis_id])}"
            for axis_id, name in names.items()
        }
    return names


def signed_axes(direction: Sequence[float]) -> list[str]:
    """Axes of the object file, such as "+x", within 60 degrees of a unit vector (3,), in order x, y, z."""
    return [
        f"{'+' if component > 0 else '−'}{axis}"
        for axis, component in zip("xyz", direction, strict=True)
        if abs(component) > SIDE_COMPONENT
    ]


def _bare_name(strike: PlannedStrike) -> str:
    tip, along, up = strike.R_world_object
    axes = sorted({*signed_axes(_minus(up)), *signed_axes(tip)}, key=lambda name: "xyz".index(name[1]))
    sides = [axis for axis in axes if axis[1] != "z"]
    level = {"+z": "top ", "−z": "bottom "}.get(axes[-1] if axes else "", "")
    if not level and abs(along[2]) > UPRIGHT_COMPONENT:
        level = "upright "
    noun = "rim" if strike.rolls else "edge"
    return f"{level}{noun}, {'/'.join(sides)} side" if sides else f"{level}{noun}"


def _side_underneath(strike: PlannedStrike) -> str:
    return f"{'/'.join(signed_axes(_minus(strike.R_world_object[2]))) or strike.plane_id} underneath"


def _axis_id(strike: PlannedStrike) -> str:
    return strike.axis_id


def _place(strike: PlannedStrike) -> str:
    x, y, z = (1e3 * float(each) for each in strike.pivot.point)
    return f"at ({x:.0f}, {y:.0f}, {z:.0f}) mm".replace("-", "−")


def _minus(direction: Sequence[float]) -> list[float]:
    return [-component for component in direction]
