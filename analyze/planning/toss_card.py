"""Text of a toss card: how to hold the object, which way to spin it, where and how high to throw it.

The printed page with its drawing is made in analyze/cards.
"""

from __future__ import annotations

import numpy as np

from analyze.planning.toss_hold import Hold
from analyze.types import Array
from schemas.object_spec import ObjectSpec


def toss_card(
    spec: ObjectSpec, hold: Hold, flight_s: float, apex: Array, gravity: float, turns_per_s: float
) -> str:
    """Text of a toss card.

    Args:
        spec: name of the object.
        hold: how the object is held, and its spin axis.
        flight_s: time in the air [s].
        apex: (3,) place of c at the top of the flight, in W [m].
        gravity: gravity [m/s^2].
        turns_per_s: spin [turns/s].
    """
    rise = gravity * flight_s**2 / 8
    height = float(apex[2]) - rise
    turns = turns_per_s * flight_s
    place = f"{abs(height) * 1000:.0f} mm {'above' if height >= 0 else 'below'} the table's top"
    return (
        f"Lay a cushion {apex[1] * 1000:.0f} mm behind the line, away from the camera, and stand behind it, "
        f"facing the camera. Hold {spec.name} there in both hands, its middle {place}, {hold.facing} "
        "towards the camera, a finger of each hand where the spin axis leaves it. Hold it still until the "
        f"camera records. Throw it straight up by {rise * 1000:.0f} mm with a spin whose top moves towards "
        f"the camera: about {turns:.1f} turns until it falls on the cushion, {flight_s:.2f} s later. Take "
        "your hands away at once."
    )


def axis_angle_text(angle_rad: float) -> str:
    """Text on the angle between spin axis and nearest principal axis of inertia [rad]."""
    return f"{np.degrees(angle_rad):.0f}° from the nearest principal axis"
