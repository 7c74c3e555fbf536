"""Parts of the hinge: adapters to servo horns; hub, spacers and axle plate of a pendulum on ball bearings.

Bearings are clamped by their inner rings: on an M8 bolt lie, from its head, washer, short spacer, bearing,
long spacer, bearing, short spacer, axle plate, washer, self-locking nut. The hub's shoulder between the
bearings' outer rings is 0.2 mm narrower than the long spacer, so that nothing is braced; the spacers are
thinner than the inner rings are wide, so that nothing rubs.
"""

from __future__ import annotations

import math
from functools import cache

from analyze.rig_parts.arm_part import (
    ARM_HEIGHT,
    HUB,
    HUB_CIRCLE,
    PIN_RADIUS,
    PIN_STEP,
    arm_pin_places,
)
from analyze.rig_parts.bought import (
    BEARING,
    BEARING_WIDTH,
    M2,
    M3,
    M3_NUT,
    M3_NUT_DEPTH,
    M5,
    M8,
    M8_NUT_HEIGHT,
    PIN_HOLE,
    PROFILE,
    Servo,
)
from analyze.rig_parts.solids import BEYOND, Dimension, RigPart, Solid, circle_of, cut, disc, hexagon, rounded

ADAPTER_HEIGHT = 6.0
"""Height of an adapter between horn and arm [mm]."""
BEARING_FIT, SEAT = 0.1, 7.5
"""Clearance of a seat around a bearing, in diameter, and depth of the seat [mm]: the bearing lies deeper than
the hub's face."""
SHOULDER, SHOULDER_HOLE = 8.0, 18.0
"""Width of the hub's shoulder between the bearings, and its hole [mm], which is narrower than the outer ring
and clear of the inner one."""
HUB_HEIGHT = 2 * SEAT + SHOULDER
"""Height of the hub [mm]."""
SPACER, SPACER_BORE = 11.6, 8.3
"""Diameters of the spacers [mm]: thinner than the inner ring."""
LONG_SPACER, SHORT_SPACER = SHOULDER + 0.2, 3.0
"""Lengths of the spacers between the bearings, and outside them [mm]."""
PLATE, PLATE_POST, PLATE_FRONT = 12.0, 30.0, 20.0
"""Thickness of the axle plate, distance of the post's middle behind the hinge, and reach of the plate before
it [mm]."""
POST_SCREWS = 44.0
"""Distance of the two M5 screws of a part on its post [mm]."""
LAST_PIN = 6
"""Number of the last hole of the axle plate, in steps of the pin's angle from the first."""
BOLT_LENGTHS = (16.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0, 80.0, 90.0, 100.0)
"""Lengths in which M8 bolts are sold [mm]."""


def hub_to_plate() -> float:
    """Distance from the hub's face at the arm to the axle plate, along the hinge [mm]."""
    return HUB_HEIGHT / 2 + LONG_SPACER / 2 + BEARING_WIDTH + SHORT_SPACER


def post_beside_arm() -> float:
    """Distance of the post's middle from the arm's middle, along the hinge [mm]."""
    return ARM_HEIGHT / 2 + hub_to_plate() + PLATE + PROFILE / 2


def axle_grip() -> float:
    """Length of the axle's bolt from its head to the nut's far side [mm]."""
    bearings = 2 * BEARING_WIDTH + LONG_SPACER + 2 * SHORT_SPACER
    return 2 * 1.6 + bearings + PLATE + M8_NUT_HEIGHT


def bolt_length(grip: float) -> float:
    """Shortest M8 bolt on sale [mm] that holds a grip [mm] and ends 1 mm or more beyond its nut."""
    return next(each for each in BOLT_LENGTHS if each >= grip + 1.0)


@cache
def horn_adapter(servo: Servo) -> RigPart:
    """Disc between a servo's horn and the arm's hub: M2 screws into the horn, M3 nuts for the arm."""
    high, head = ADAPTER_HEIGHT, 3.0
    holes = [disc(servo.centre, -BEYOND, high + BEYOND)]
    for x, y in circle_of(4, servo.circle, 0.0):
        holes += [disc(M2, -BEYOND, high + BEYOND, x, y), disc(4.4, high - head, high + BEYOND, x, y)]
    holes += _nut_pockets(high)
    half, ring = HUB / 2, servo.circle / 2
    return RigPart(
        f"horn-{servo.name}",
        f"adapter from the horn of an {servo.name.upper()} to the arm",
        cut(disc(HUB, 0.0, high), *holes),
        (
            Dimension("top", (-half, -half), (half, -half), -8.0, f"⌀ {HUB:g}"),
            Dimension("top", (-ring, half), (ring, half), 8.0, f"circle ⌀ {servo.circle:g}"),
            Dimension("front", (half, 0.0), (half, high), -8.0),
        ),
        "4 M2 x 6 into the horn; 4 M3 nuts in its underside, 4 M3 x 18 through the arm",
    )


def _nut_pockets(high: float) -> list[Solid]:
    """Holes of the arm's four screws, through a part of a height [mm], with nuts in its underside."""
    holes: list[Solid] = []
    for x, y in circle_of(4, HUB_CIRCLE):
        turn = math.degrees(math.atan2(y, x)) + 30.0  # a flat towards the rim
        nut = hexagon(M3_NUT, -BEYOND, M3_NUT_DEPTH).rotate((0.0, 0.0, turn)).translate((x, y, 0.0))
        holes += [disc(M3, -BEYOND, high + BEYOND, x, y), nut]
    return holes


@cache
def bearing_hub() -> RigPart:
    """Hub of a pendulum: two 608 bearings on a shoulder between them, nuts for the arm's four screws."""
    high, seat = HUB_HEIGHT, BEARING + BEARING_FIT
    holes = [
        disc(seat, -BEYOND, SEAT),
        disc(SHOULDER_HOLE, 0.0, high),
        disc(seat, high - SEAT, high + BEYOND),
        *_nut_pockets(high),
    ]
    holes += [disc(PIN_HOLE, -BEYOND, high + BEYOND, x, y) for x, y in arm_pin_places()]
    half = HUB / 2
    return RigPart(
        "bearing-hub",
        "hub of a pendulum, without a servo",
        cut(disc(HUB, 0.0, high), *holes),
        (
            Dimension("top", (-half, -half), (half, -half), -8.0, f"⌀ {HUB:g}"),
            Dimension("top", (-seat / 2, half), (seat / 2, half), 8.0, f"⌀ {seat:g}"),
            Dimension("front", (half, 0.0), (half, high), -8.0),
            Dimension("front", (-half, 0.0), (-half, SEAT), 8.0),
            Dimension("front", (-half, SEAT), (-half, SEAT + SHOULDER), 16.0),
        ),
        f"2 bearings 608; 4 M3 x {HUB_HEIGHT + ARM_HEIGHT:g} through arm and hub, with nuts in its underside",
    )


@cache
def spacer(length: float, name: str, count: int) -> RigPart:
    """Ring on the axle that bears on the bearings' inner rings only.

    Args:
        length: Its length [mm].
        name: Name of the part.
        count: Number of copies.
    """
    half = SPACER / 2
    return RigPart(
        name,
        "spacer on the axle",
        cut(disc(SPACER, 0.0, length), disc(SPACER_BORE, -BEYOND, length + BEYOND)),
        (
            Dimension("top", (-half, -half), (half, -half), -8.0, f"⌀ {SPACER:g}"),
            Dimension("top", (-SPACER_BORE / 2, half), (SPACER_BORE / 2, half), 8.0, f"⌀ {SPACER_BORE:g}"),
            Dimension("front", (half, 0.0), (half, length), -8.0),
        ),
        "on the M8 bolt",
        count=count,
    )


def plate_pin_places() -> list[tuple[float, float]]:
    """Points (x, y) [mm] of the axle plate's holes for the pin, the first straight above the hinge.

    The plate is seen from the post's side: x is along the strike, y down.
    """
    angles = [math.radians(PIN_STEP * step) for step in range(LAST_PIN + 1)]
    return [(PIN_RADIUS * math.sin(angle), -PIN_RADIUS * math.cos(angle)) for angle in angles]


@cache
def axle_plate() -> RigPart:
    """Plate on the striker's post that holds the axle, and the pin that locks the arm at known angles.

    It lies with the side of the hub on the bed; x is along the strike, y down, the axle in the origin.
    """
    back, half, tall = -PLATE_POST - PROFILE / 2, PROFILE, POST_SCREWS / 2 + 8.0
    post = rounded(back, back + PROFILE, -tall, tall, 0.0, PLATE, 3.0)
    body = Solid.batch_hull(
        [disc(2 * half, 0.0, PLATE), rounded(back, back + 8.0, -half, half, 0, PLATE, 3.0)]
    )
    holes = [disc(M8, -BEYOND, PLATE + BEYOND)]
    holes += [disc(PIN_HOLE, -BEYOND, PLATE + BEYOND, x, y) for x, y in plate_pin_places()]
    holes += [disc(M5, -BEYOND, PLATE + BEYOND, -PLATE_POST, side * POST_SCREWS / 2) for side in (-1, 1)]
    return RigPart(
        "axle-plate",
        "plate on the post that holds the pendulum's axle",
        cut(post + body, *holes),
        (
            Dimension("top", (back, tall), (half, tall), 8.0),
            Dimension("top", (-PLATE_POST, -tall), (0.0, -tall), -8.0),
            Dimension("top", (-PLATE_POST, -POST_SCREWS / 2), (-PLATE_POST, POST_SCREWS / 2), 20.0),
            Dimension("front", (half, 0.0), (half, PLATE), -8.0),
        ),
        f"M8 x {bolt_length(axle_grip()):g} bolt, 2 washers, self-locking nut; 2 M5 x 16 with slot nuts; "
        "3 mm drill bit as pin",
    )
