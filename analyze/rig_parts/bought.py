"""Bought parts of a rig [mm]: dimensions for which the printed parts are made, and solids to test fits."""

from __future__ import annotations

import math
from dataclasses import dataclass

from analyze.rig_parts.solids import BEYOND, Solid, disc, slab

M2, M3, M4, M5, M8 = 2.4, 3.4, 4.5, 5.5, 8.4
"""Diameters of clearance holes for screws [mm] (ISO 273, medium; M2 to M5 with 0.1 mm for the print)."""
QUARTER_INCH = 6.8
"""Diameter of a hole for a tripod's screw, 1/4 inch [mm]."""
M3_NUT, M3_NUT_DEPTH = 5.7, 2.8
"""Width across flats and depth of a pocket for an M3 nut (ISO 4032: 5.5 x 2.4) [mm]."""

BEARING, BEARING_WIDTH, BEARING_BORE = 22.0, 7.0, 8.0
"""Outer diameter, width and bore of a ball bearing 608 (ISO 15) [mm]."""
INNER_RING, OUTER_RING = 12.1, 19.2
"""Outer diameter of its inner ring and inner diameter of its outer ring [mm], at the faces; a shoulder that
carries the outer ring has a hole of at most 20 mm, one that carries the inner ring at least 10 mm."""

WASHER, WASHER_BORE, WASHER_THICKNESS, WASHER_KG = 24.0, 8.4, 2.0, 0.0062
"""Diameters, thickness and mass of a large M8 washer (ISO 7093), of which the ballast is made."""
M8_HEAD_KG, M8_KG_PER_MM, M8_NUT_KG = 0.0077, 0.00033, 0.0058
"""Mass of the head of an M8 hexagon bolt, of its shank per millimetre, and of a self-locking nut [kg]."""
M8_HEAD, M8_HEAD_HEIGHT, M8_NUT_HEIGHT = 13.0, 5.3, 8.0
"""Width across flats and height of its head, and height of a self-locking nut (ISO 4017, ISO 7040) [mm]."""

PAD, PAD_HEIGHT = 11.0, 5.0
"""Diameter and height of the pad, a self-adhesive hemispherical rubber bumper [mm]."""
PROFILE, SLOT = 20.0, 6.0
"""Width of an aluminium profile, and of its slots, which take M5 slot nuts [mm]."""
PIN, PIN_HOLE = 3.0, 3.2
"""Diameters of the locking pin, a 3 mm drill bit, and of its holes [mm]."""

SWITCH = (6.4, 19.8, 10.2)
"""Thickness, length and depth of a micro switch of the class SS-5GL, without its lever [mm]."""
SWITCH_HOLES, SWITCH_HOLE_EDGE, SWITCH_OPERATES = 9.5, 2.9, 8.8
"""Distance of its two holes, of their line from its back, and from their line to the lever's end as it
switches (0.8 mm) [mm]."""
SOLENOID = (40.0, 30.0, 26.0)
"""Largest frame of a push solenoid: length along its stroke, width, height [mm]."""


@dataclass(frozen=True)
class Servo:
    """Servo as its maker draws it [mm]: horn and case."""

    name: str
    """Name in the names of the parts."""
    circle: float
    """Diameter of the circle of the horn's threaded holes, M2."""
    centre: float
    """Diameter of the hole that the horn's middle needs."""
    width: float
    """Width of the case, in the middle of which the horn's axis lies."""
    height: float
    """Height of the case."""
    depth: float
    """Depth of the case, along the horn's axis, without the horn."""
    axis_to_end: float
    """Distance of the horn's axis from the nearer end of the case; no part needs it exactly."""
    horn: float
    """Height of the horn over the case; no part needs it exactly."""


SERVOS = (
    # Circles of the HN12-N101 (2019-05-22) and of XL330 and XC330 (2020-05-28), cases and axes as ROBOTIS's
    # drawings give them and public repositories cite them; not measured here.
    Servo("xm430", 16.0, 8.2, 28.5, 46.5, 34.0, 11.25, 2.5),
    Servo("xl330", 12.0, 4.4, 20.0, 34.0, 23.0, 9.5, 2.8),
)


def bearing() -> Solid:
    """Ball bearing 608 about z, from z = 0 up: rings and what lies between them, recessed at the faces."""
    rings = disc(BEARING, 0.0, BEARING_WIDTH) - disc(BEARING_BORE, -BEYOND, BEARING_WIDTH + BEYOND)
    recess = disc(OUTER_RING, -BEYOND, 0.2) - disc(INNER_RING, -2 * BEYOND, 0.2 + BEYOND)
    return rings - recess - recess.translate((0.0, 0.0, BEARING_WIDTH + BEYOND - 0.2))


def washer(diameter: float, thickness: float) -> Solid:
    """Washer for M8 about z, from z = 0 up."""
    return disc(diameter, 0.0, thickness) - disc(M8, -BEYOND, thickness + BEYOND)


def m8_bolt(length: float) -> Solid:
    """M8 hexagon bolt about z: its head below z = 0, its shank of the given length above."""
    head = Solid.cylinder(M8_HEAD_HEIGHT, M8_HEAD / math.sqrt(3), -1.0, 6).translate((0, 0, -M8_HEAD_HEIGHT))
    return head + disc(8.0, -BEYOND, length)


def m8_nut() -> Solid:
    """Self-locking M8 nut about z, from z = 0 up."""
    body = Solid.cylinder(M8_NUT_HEIGHT, M8_HEAD / math.sqrt(3), -1.0, 6)
    return body - disc(8.0, -BEYOND, M8_NUT_HEIGHT + BEYOND)


def pad() -> Solid:
    """Pad: half of an ellipsoid about z, its flat side at z = 0, its apex at the pad's height."""
    ball = Solid.sphere(PAD / 2, 96).scale((1.0, 1.0, 2 * PAD_HEIGHT / PAD))
    return ball ^ slab(-PAD, PAD, -PAD, PAD, 0.0, PAD)


def profile(length: float) -> Solid:
    """Aluminium profile along z, from z = 0 up, about the middle of its section, with its four slots."""
    half = PROFILE / 2
    body = slab(-half, half, -half, half, 0.0, length)
    groove = slab(-SLOT / 2, SLOT / 2, half - 6.0, half + BEYOND, -BEYOND, length + BEYOND)
    for turn in range(4):
        body -= groove.rotate((0.0, 0.0, 90.0 * turn))
    return body


def servo_body(servo: Servo) -> Solid:
    """Servo with its horn: the horn's axis is z, its face at z = 0, the case below, its long end to +y."""
    half, end = servo.width / 2, servo.height - servo.axis_to_end
    case = slab(-half, half, -servo.axis_to_end, end, -servo.horn - servo.depth, -servo.horn)
    return case + disc(servo.circle + 4.0, -servo.horn - 0.1, 0.0)
