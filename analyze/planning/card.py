"""Text of a placement card: how to put the object down for one strike, and where the striker meets it.

The printed page with its drawing is made in analyze/cards.
"""

from __future__ import annotations

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.planning.footing import IF_IT_FALLS
from analyze.planning.pivots import PivotAxis
from analyze.types import Array
from schemas.object_spec import ObjectSpec

TURNED_CARD = (
    "This strike is turned by 180 degrees, {purpose}. Put the striker's stand on the other "
    "side of the line, at the mark, so that it swings back towards the line; the object then stands on that "
    "side too and tips the other way. Leave the camera where it is. "
)
"""Text that precedes the card of a turned strike, with its purpose."""


def placement_card(
    model: ObjectModel,
    spec: ObjectSpec,
    axis: PivotAxis,
    impact_height: float,
    markers: list[int | str],
    stands: bool = True,
    turned: bool = False,
) -> str:
    """Text of a placement card: which side goes down, which faces the camera, and the impact height.

    If the object may fall over on its resting face, the text adds this and the remedy. For a strike with the
    object turned by 180 degrees, the caller puts `TURNED_CARD`, the instruction to turn, before the text.

    Args:
        model: Shape of the object.
        spec: Name and markers.
        axis: Pivot axis of the strike.
        impact_height: Height of the impact point over the table [m].
        markers: Names of the visible markers, of which the text names the first; if empty, it names the side
            that faces the camera.
        stands: False if the object may fall over on the face.
        turned: True for a strike with the object turned by 180 degrees, at which the camera sees the other
            end of the edge.
    """
    down, right = _side(-axis.plane.up, spec), _side(axis.tip, spec)
    facing = (
        f"marker {markers[0]} towards the camera"
        if markers
        else f"its {_side(axis.direction if turned else -axis.direction, spec)} side towards the camera"
    )
    height = float(np.ptp(model.hull_vertices @ axis.plane.up))
    edge = "rim" if axis.rolls else "edge"
    return (
        f"Put {spec.name} on its {down} side, {facing}, its {right} side away from the striker with that "
        f"{edge} on the line. "
        f"It then stands {height * 1000:.0f} mm tall; the striker meets it {impact_height * 1000:.0f} mm "
        "above the table."
        + ("" if stands else f" It is expected to stay on this side, but this is not certain. {IF_IT_FALLS}.")
    )


def _side(direction: Array, spec: ObjectSpec) -> str:
    """Name of the side that faces along `direction` (3,): the nearest object axis, such as "+x".

    The first marker of `spec` whose normal is within 10 degrees of the direction is added: "+x (marker 3)".
    The unit direction is in the object frame.
    """
    for marker in spec.marker:
        if marker.T_object_marker is not None and np.array(marker.T_object_marker)[
            :3, 2
        ] @ direction > np.cos(np.radians(10)):
            return f"{_axis_name(direction)} (marker {marker.name})"
    return _axis_name(direction)


def _axis_name(direction: Array) -> str:
    best = int(np.argmax(np.abs(direction)))
    return f"{'+' if direction[best] > 0 else '-'}{'xyz'[best]}"
