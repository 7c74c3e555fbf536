"""Parts of the striker: arm, pad, adapters to servo horns, and a hub for a pendulum on ball bearings.

The arm lies on the bed: its hinge's axis is z through the origin, the tip is at x = arm length, and it
strikes along +y. It is screwed to an adapter or a hub with four M3 screws on a circle of 30 mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from analyze.errors import FixtureError
from analyze.rig_parts.solids import (
    BEYOND,
    Dimension,
    RigPart,
    Solid,
    bore_y,
    circle_of,
    cone,
    cut,
    disc,
    hexagon,
    rounded,
)

SHORTEST_ARM, LONGEST_ARM = 60.0, 180.0
"""Range of arm lengths that can be printed in one piece [mm]: hub and tip apart, on a bed of 220 mm."""
HUB, HUB_CIRCLE = 40.0, 30.0
"""Diameter of the hub, and of the circle of its four M3 screws [mm]."""
M2, M3, M4 = 2.4, 3.4, 4.4
"""Diameters of holes for screws [mm]."""
ARM_HEIGHT, ROOT, ARM_WIDTH = 12.0, 24.0, 14.0
"""Height of the arm over the bed, which is along its hinge, and its widths at hub and tip, along the strike
[mm]."""
TIP = 18.0
"""Edge of the block at the tip [mm]."""
AXLE_CLEARANCE = 12.0
"""Diameter of the hole in the hub, for the horn's screw or an axle [mm]."""
PAD, PAD_LENGTH, PAD_FLOOR = 18.0, 14.0, 4.0
"""Diameter and length of the pad's holder, and of its floor, on which the nut bears [mm]."""
FELT, FELT_RECESS = 13.0, 1.0
"""Diameter of the pad's disc of felt or rubber, and depth of its recess [mm]."""
ADAPTER_HEIGHT = 6.0
BEARING, BEARING_WIDTH, BEARING_SHOULDER = 22.0, 7.0, 16.0
"""Outer diameter and width of a 608 bearing, and hole between its seats, which frees its inner ring [mm]."""
BEARING_FIT = 0.1
"""Clearance of a seat around a bearing, in diameter [mm]."""


@dataclass(frozen=True)
class Horn:
    """Horn of a servo: circle of its screws."""

    name: str
    """Name of the servo."""
    circle: float
    """Diameter of the circle of its threaded holes [mm]."""
    centre: float
    """Diameter of the hole that its middle needs [mm]."""


HORNS = (
    # ROBOTIS's drawings of the HN12-N101 (2019-05-22) and of XL330 and XC330 (2020-05-28), as public
    # repositories cite them; not measured here.
    Horn("xm430", circle=16.0, centre=8.2),
    Horn("xl330", circle=12.0, centre=4.4),
)


def arm(length: float) -> RigPart:
    """Arm from the hinge to the tip, with the bolt of pad and ballast at the arm's length from the hinge.

    Args:
        length: Distance from the hinge's axis to the tip [mm].

    Raises:
        FixtureError: the arm cannot be printed in one piece.
    """
    if not SHORTEST_ARM <= length <= LONGEST_ARM:
        raise FixtureError(
            f"an arm of {length:g} mm is not printed in one piece ({SHORTEST_ARM:g} to {LONGEST_ARM:g} mm): "
            "change arm_length_m, or screw the printed hub and tip to an aluminium bar"
        )
    high = ARM_HEIGHT
    beam = Solid.batch_hull([disc(ROOT, 0.0, high), disc(ARM_WIDTH, 0.0, high, length)])
    body = (
        disc(HUB, 0.0, high)
        + beam
        + rounded(length - TIP / 2, length + TIP / 2, -TIP / 2, TIP / 2, 0.0, high, 2.0)
    )
    holes = [disc(AXLE_CLEARANCE, -BEYOND, high + BEYOND)]
    holes += [disc(M3, -BEYOND, high + BEYOND, x, y) for x, y in circle_of(4, HUB_CIRCLE)]
    holes.append(bore_y(M4, length, high / 2, -TIP, TIP))
    lightening = _lightening(length)
    end = length + TIP / 2
    return RigPart(
        "arm",
        "arm from the hinge to the tip",
        cut(body, *holes, *lightening),
        (
            Dimension("top", (0.0, 0.0), (length, 0.0), 34.0),
            Dimension("top", (-HUB / 2, 0.0), (end, 0.0), 44.0),
            Dimension("top", (end, -TIP / 2), (end, TIP / 2), -8.0),
            Dimension("top", (-HUB / 2, HUB / 2), (-HUB / 2, -HUB / 2), -8.0, f"⌀ {HUB:g}"),
            Dimension("front", (-HUB / 2, 0.0), (-HUB / 2, high), 8.0),
            Dimension("front", (length, 0.0), (length, high / 2), -TIP / 2 - 6.0),
            Dimension("front", (0.0, 0.0), (length, 0.0), -10.0),
        ),
        f"4 M3 x 18 on a circle of {HUB_CIRCLE:g} mm; M4 through the tip",
    )


def _lightening(length: float) -> list[Solid]:
    """Slots through the beam [mm], so that the mass is at the tip and not along the arm."""
    start, end = HUB / 2 + 6.0, length - TIP / 2 - 6.0
    if end - start < 16.0:
        return []
    count = max(1, round((end - start) / 34.0))
    pitch, bridge, width = (end - start) / count, 8.0, ARM_WIDTH - 8.0
    slots: list[Solid] = []
    for i in range(count):
        low, high = start + i * pitch + bridge / 2, start + (i + 1) * pitch - bridge / 2
        ends = [disc(width, -BEYOND, ARM_HEIGHT + BEYOND, x) for x in (low + width / 2, high - width / 2)]
        slots.append(Solid.batch_hull(ends))
    return slots


def pad() -> RigPart:
    """Holder of the pad: its back bears on the arm's tip, a nut in it takes the tip's bolt."""
    top = PAD_LENGTH
    body = disc(PAD, 0.0, top - 1.0) + cone(PAD, PAD - 2.0, top - 1.0, top)
    mesh = cut(
        body,
        disc(M4, -BEYOND, top),
        hexagon(7.2, PAD_FLOOR, top + BEYOND),
        disc(FELT, top - FELT_RECESS, top + BEYOND),
    )
    return RigPart(
        "pad",
        "holder of the pad of felt or rubber at the tip",
        mesh,
        (
            Dimension("top", (-PAD / 2, -PAD / 2), (PAD / 2, -PAD / 2), -8.0, f"⌀ {PAD:g}"),
            Dimension("top", (-FELT / 2, PAD / 2), (FELT / 2, PAD / 2), 8.0, f"⌀ {FELT:g}"),
            Dimension("front", (PAD / 2, 0.0), (PAD / 2, top), -8.0),
            Dimension("front", (-PAD / 2, 0.0), (-PAD / 2, PAD_FLOOR), 8.0),
        ),
        f"M4 nut; disc of felt or rubber, {FELT:g} mm wide and 3 mm thick",
    )


def horn_adapter(horn: Horn) -> RigPart:
    """Disc between a servo's horn and the arm's hub: M2 screws into the horn, M3 nuts for the arm."""
    high, head = ADAPTER_HEIGHT, 3.0
    holes = [disc(horn.centre, -BEYOND, high + BEYOND)]
    for x, y in circle_of(4, horn.circle, 0.0):
        holes += [disc(M2, -BEYOND, high + BEYOND, x, y), disc(4.4, high - head, high + BEYOND, x, y)]
    for x, y in circle_of(4, HUB_CIRCLE):
        turn = math.degrees(math.atan2(y, x)) + 30.0  # a flat towards the rim
        nut = hexagon(5.7, -BEYOND, 2.8).rotate((0.0, 0.0, turn)).translate((x, y, 0.0))
        holes += [disc(M3, -BEYOND, high + BEYOND, x, y), nut]
    half, ring = HUB / 2, horn.circle / 2
    return RigPart(
        f"horn-{horn.name}",
        f"adapter from the horn of an {horn.name.upper()} to the arm",
        cut(disc(HUB, 0.0, high), *holes),
        (
            Dimension("top", (-half, -half), (half, -half), -8.0, f"⌀ {HUB:g}"),
            Dimension("top", (-ring, half), (ring, half), 8.0, f"circle ⌀ {horn.circle:g}"),
            Dimension("front", (half, 0.0), (half, high), -8.0),
        ),
        "4 M2 x 6 into the horn; 4 M3 nuts in its underside",
    )


def bearing_hub() -> RigPart:
    """Hub of a pendulum: two 608 bearings on an 8 mm axle, and nuts for the arm's four screws."""
    high = 2 * BEARING_WIDTH + 2.0
    seat = BEARING + BEARING_FIT
    holes = [
        disc(seat, -BEYOND, BEARING_WIDTH),
        disc(BEARING_SHOULDER, 0.0, high),
        disc(seat, high - BEARING_WIDTH, high + BEYOND),
    ]
    for x, y in circle_of(4, HUB_CIRCLE):
        holes.append(disc(M3, -BEYOND, high + BEYOND, x, y))
    half = HUB / 2
    return RigPart(
        "bearing-hub",
        "hub of a pendulum, without a servo",
        cut(disc(HUB, 0.0, high), *holes),
        (
            Dimension("top", (-half, -half), (half, -half), -8.0, f"⌀ {HUB:g}"),
            Dimension("top", (-seat / 2, half), (seat / 2, half), 8.0, f"⌀ {seat:g}"),
            Dimension("front", (half, 0.0), (half, high), -8.0),
            Dimension("front", (-half, 0.0), (-half, BEARING_WIDTH), 8.0),
        ),
        "2 bearings 608, axle of 8 mm; 4 M3 x 35 through arm and hub, with nuts",
    )
