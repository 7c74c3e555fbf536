"""Arm of the striker: it hangs from the hinge, and its pad touches the object exactly below the hinge.

The arm lies on the bed: the hinge's axis is z through the origin, the tip is at x = arm length, and it
strikes along +y. The pad is glued on the nose; its apex is at (arm length, 0), so that at contact it moves
at right angles to the line from the hinge, horizontally. Arm and ballast are behind it.
"""

from __future__ import annotations

import math
from functools import cache

from analyze.errors import FixtureError
from analyze.rig_parts.bought import (
    M2,
    M3,
    M8,
    PAD_HEIGHT,
    PIN_HOLE,
    SWITCH_HOLES,
    SWITCH_OPERATES,
)
from analyze.rig_parts.solids import BEYOND, Dimension, RigPart, Solid, circle_of, cut, disc, rounded

SHORTEST_ARM, LONGEST_ARM = 60.0, 180.0
"""Range of arm lengths that can be printed in one piece [mm]: hub and tip apart, on a bed of 220 mm."""
HUB, HUB_CIRCLE = 40.0, 31.0
"""Diameter of the hub, and of the circle of its four M3 screws [mm]."""
ARM_HEIGHT, ARM_WIDTH, ROOT = 12.0, 14.0, 24.0
"""Height of the arm over the bed, which is along the hinge; its width, and that at the hub [mm]."""
AXLE_HOLE = 20.0
"""Diameter of the hole in the hub [mm]: for the horn's screw, or the axle's head with its washer (16 mm)."""
BACK = 20.0
"""Distance of the ballast's bolt behind the pad's apex [mm]."""
BOSS = 18.0
"""Diameter of the arm around the ballast's bolt [mm]."""
SHOULDER = (20.0, -13.0)
"""Place at which the beam has gone behind the hub's front, and is narrow [mm]."""
PIN_RADIUS, PIN_STEP, SECOND_PIN = 15.5, 20.0, 70.0
"""Distance of the pin's holes from the hinge [mm], angle between those of the stand, and between the two of
the arm, of which the second locks it half a step further [deg]."""
SWITCH_PLACE = 32.0
"""Distance of the contact switch's middle above the pad [mm]."""


@cache
def arm(length: float) -> RigPart:
    """Arm from the hinge to the tip, with nose, ballast's bolt, holes of the pin and of a contact switch.

    Args:
        length: Distance from the hinge's axis to the pad's apex [mm].

    Raises:
        FixtureError: the arm cannot be printed in one piece.
    """
    if not SHORTEST_ARM <= length <= LONGEST_ARM:
        raise FixtureError(
            f"an arm of {length:g} mm is not printed in one piece ({SHORTEST_ARM:g} to {LONGEST_ARM:g} mm): "
            "change arm_length_m, or screw the printed hub and tip to an aluminium bar"
        )
    high, half = ARM_HEIGHT, ARM_HEIGHT / 2
    shoulder, tip = disc(ARM_WIDTH, 0.0, high, *SHOULDER), disc(BOSS, 0.0, high, length, -BACK)
    body = disc(HUB, 0.0, high) + Solid.batch_hull([disc(ROOT, 0.0, high, 0.0, -4.0), shoulder])
    body += Solid.batch_hull([shoulder, disc(ARM_WIDTH, 0.0, high, length, 2.0 - BACK)]) + tip
    body += rounded(length - 7.0, length + 7.0, -BACK, -PAD_HEIGHT, 0.0, high, 1.5)
    if places := switch_places(length):
        seat = places[0][0] - 6.0, places[1][0] + 6.0
        body += rounded(*seat, -BACK, -SWITCH_OPERATES + 3.3, 0.0, high, 1.5)
    holes = [disc(AXLE_HOLE, -BEYOND, high + BEYOND), disc(M8, -BEYOND, high + BEYOND, length, -BACK)]
    holes += [disc(M3, -BEYOND, high + BEYOND, x, y) for x, y in circle_of(4, HUB_CIRCLE)]
    holes += [disc(PIN_HOLE, -BEYOND, high + BEYOND, x, y) for x, y in arm_pin_places()]
    holes += [disc(M2, -BEYOND, high + BEYOND, x, y) for x, y in places]
    mark = Solid.cylinder(3.0, 0.9, -1.0, 24).rotate((90.0, 0.0, 0.0))
    holes.append(mark.translate((length, -PAD_HEIGHT + 1.5, half)))
    end = length + BOSS / 2
    return RigPart(
        "arm",
        "arm from the hinge to the tip",
        cut(body, *holes, *_lightening(length)),
        (
            Dimension("top", (0.0, 0.0), (length, 0.0), 34.0),
            Dimension("top", (-HUB / 2, 0.0), (end, 0.0), 44.0),
            Dimension("top", (length, -PAD_HEIGHT), (length, 0.0), -24.0),
            Dimension("top", (length, -BACK), (length, 0.0), -36.0),
            Dimension("top", (-HUB / 2, HUB / 2), (-HUB / 2, -HUB / 2), -8.0, f"⌀ {HUB:g}"),
            Dimension("front", (-HUB / 2, 0.0), (-HUB / 2, high), 8.0),
            Dimension("front", (length, 0.0), (length, half), -BOSS / 2 - 6.0),
        ),
        f"4 M3 on a circle of {HUB_CIRCLE:g} mm; M8 bolt with washers; self-adhesive rubber bumper",
    )


def arm_pin_places() -> list[tuple[float, float]]:
    """Two points (x, y) [mm] of the arm at which the pin locks it."""
    angles = [math.radians(angle) for angle in (0.0, SECOND_PIN)]
    return [(-PIN_RADIUS * math.cos(angle), PIN_RADIUS * math.sin(angle)) for angle in angles]


def switch_places(length: float) -> list[tuple[float, float]]:
    """Points (x, y) [mm] of the two holes for a contact switch that closes as the pad touches."""
    half, middle = SWITCH_HOLES / 2, length - SWITCH_PLACE
    if middle - half < SHOULDER[0] + 4.0:
        return []
    return [(middle + side * half, -SWITCH_OPERATES) for side in (-1, 1)]


def _lightening(length: float) -> list[Solid]:
    """Slots through the beam [mm], so that the mass is at the tip and not along the arm."""
    last = length - SWITCH_PLACE - 12.0 if switch_places(length) else length - BOSS
    start, end, width = SHOULDER[0] + 4.0, last, ARM_WIDTH - 8.0
    if end - start < 16.0:
        return []
    count = max(1, round((end - start) / 34.0))
    pitch, bridge = (end - start) / count, 8.0
    slots: list[Solid] = []
    for i in range(count):
        low, high = start + i * pitch + bridge / 2, start + (i + 1) * pitch - bridge / 2
        ends = [
            disc(width, -BEYOND, ARM_HEIGHT + BEYOND, x, _beam_middle(x, length))
            for x in (low + width / 2, high - width / 2)
        ]
        slots.append(Solid.batch_hull(ends))
    return slots


def _beam_middle(x: float, length: float) -> float:
    """Middle of the beam across the arm, y [mm], at a distance from the hinge [mm]."""
    share = (x - SHOULDER[0]) / (length - SHOULDER[0])
    return SHOULDER[1] + share * (2.0 - BACK - SHOULDER[1])
