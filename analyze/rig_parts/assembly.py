"""Assembled rigs [mm]: printed and bought parts in their places, to test fits and to draw.

Frame of the hinge: its axis is y, away from the camera; x is along the strike, z up; the origin lies in the
middle of the arm. The arm's angle is 0 where its pad is exactly below the hinge, and positive beyond.
"""

# manifold3d is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

import math
from dataclasses import dataclass

import manifold3d
import numpy as np

from analyze.fixture.solid import Mesh, printed_surface
from analyze.rig_parts import bought
from analyze.rig_parts.arm_part import ARM_HEIGHT, BACK, arm, switch_places
from analyze.rig_parts.ballast import Ballast
from analyze.rig_parts.hinge_parts import (
    ADAPTER_HEIGHT,
    HUB_HEIGHT,
    LONG_SPACER,
    PLATE,
    PLATE_POST,
    SHORT_SPACER,
    axle_grip,
    axle_plate,
    bearing_hub,
    bolt_length,
    horn_adapter,
    hub_to_plate,
    post_beside_arm,
    spacer,
)
from analyze.rig_parts.solids import RigPart, Solid, slab
from analyze.rig_parts.stand_parts import (
    GRIP_SETBACK,
    STOP,
    STOP_MIDDLE,
    STOP_RECESS,
    SWITCH_ROWS,
    servo_holder,
    servo_holder_length,
    servo_post,
    solenoid_holder,
)
from analyze.types import Array

REST_DEPTH = 51.0
"""Distance of the arm's rest below the hinge, where a solenoid drives it [mm]."""
POST = 400.0
"""Length of the striker's post [mm]."""

LYING_ARM: Array = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""Turn from a part that lies like the arm (x down, y along the strike) to the frame of the hinge."""
PLATE_TURN: Array = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turn of a part whose z is along the hinge, away from the arm, and whose y is down."""
FACING: Array = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Turn of a part whose z is along the hinge, towards the arm, and whose y is up."""


@dataclass(frozen=True)
class Placed:
    """Part in its place."""

    name: str
    """Name of the part."""
    solid: Solid
    """Solid in the frame of the hinge [mm]."""
    swings: bool
    """Whether it moves with the arm."""
    printed: bool = True
    """Whether it is printed; otherwise it is bought."""

    def at(self, angle: float) -> Solid:
        """Solid [mm] with the arm at an angle [rad]."""
        return self.solid.rotate((0.0, -math.degrees(angle), 0.0)) if self.swings else self.solid

    def mesh_at(self, angle: float) -> Mesh:
        """Surface [mm] with the arm at an angle [rad]."""
        return printed_surface(self.at(angle))


def solid_of(mesh: Mesh) -> Solid:
    """Solid that a printed part's surface encloses [mm]."""
    return Solid(
        manifold3d.Mesh64(
            np.ascontiguousarray(mesh.vertices, dtype=np.float64),
            np.ascontiguousarray(mesh.faces, dtype=np.uint64),
        )
    )


def _moved(solid: Solid, turn: Array, shift: tuple[float, float, float]) -> Solid:
    """Solid turned by a rotation (3, 3), then shifted [mm]."""
    return solid.transform(np.column_stack([turn, np.array(shift)]))


def _print(part: RigPart, turn: Array, shift: tuple[float, float, float], swings: bool) -> Placed:
    return Placed(part.name, _moved(solid_of(part.mesh), turn, shift), swings)


def _bought(name: str, solid: Solid, turn: Array, shift: tuple[float, float, float], swings: bool) -> Placed:
    return Placed(name, _moved(solid, turn, shift), swings, printed=False)


def swinging_arm(length: float, ballast: Ballast) -> list[Placed]:
    """Arm with pad and ballast.

    Args:
        length: Length of the arm [mm].
        ballast: Washers and bolt at its tip.
    """
    half, each = ARM_HEIGHT / 2, bought.WASHER_THICKNESS
    made = [_print(arm(length), LYING_ARM, (0.0, half, 0.0), True)]
    forward = np.array(
        [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    )  # z of the pad is along the strike
    made.append(_bought("pad", bought.pad(), forward, (-bought.PAD_HEIGHT, 0.0, -length), True))
    if ballast.washers:
        stack = bought.washer(bought.WASHER, each * ballast.washers / 2)
        far = half + each * ballast.washers / 2
        tip = -BACK, -length
        for name, y in (("ballast, near", -far), ("ballast, far", half)):
            made.append(_bought(name, stack, PLATE_TURN, (tip[0], y, tip[1]), True))
        # Its head is on the side of the post, which its end would touch.
        bolt, nut = bought.m8_bolt(ballast.bolt_mm), bought.m8_nut()
        made.append(_bought("ballast's bolt", bolt, LYING_ARM, (tip[0], far, tip[1]), True))
        made.append(_bought("ballast's nut", nut, LYING_ARM, (tip[0], -far, tip[1]), True))
    return made


def _post(x: float, y: float, height: float) -> Placed:
    """Post whose axis is at (x, y), from a height of the hinge over the table down to its foot [mm]."""
    return Placed("post", bought.profile(POST).translate((x, y, -height)), swings=False, printed=False)


def servo_striker(servo: bought.Servo, length: float, ballast: Ballast) -> list[Placed]:
    """Arm on a servo, with adapter, servo, holder and post.

    Args:
        servo: The servo.
        length: Length of the arm [mm].
        ballast: Washers and bolt at its tip.
    """
    horn = ARM_HEIGHT / 2 + ADAPTER_HEIGHT
    far = horn + servo.horn + GRIP_SETBACK + servo_holder_length(servo)
    return [
        *swinging_arm(length, ballast),
        _print(horn_adapter(servo), LYING_ARM, (0.0, horn, 0.0), True),
        _bought("servo", bought.servo_body(servo), FACING, (0.0, horn, 0.0), False),
        _print(servo_holder(servo), FACING, (0.0, far, 0.0), False),
        _post(-servo_post(servo), far + bought.PROFILE / 2, 250.0),
    ]


def pendulum(length: float, ballast: Ballast) -> list[Placed]:
    """Arm on ball bearings, with hub, spacers, axle, plate and post.

    Args:
        length: Length of the arm [mm].
        ballast: Washers and bolt at its tip.
    """
    face, middle = ARM_HEIGHT / 2, ARM_HEIGHT / 2 + HUB_HEIGHT / 2
    plate = face + hub_to_plate()
    near, long = spacer(SHORT_SPACER, "spacer-short", 2), spacer(LONG_SPACER, "spacer-long", 1)
    inner, outer = LONG_SPACER / 2, LONG_SPACER / 2 + bought.BEARING_WIDTH
    head = middle - outer - SHORT_SPACER
    small = bought.washer(16.0, 1.6)
    return [
        *swinging_arm(length, ballast),
        _print(bearing_hub(), LYING_ARM, (0.0, face + HUB_HEIGHT, 0.0), True),
        _bought("bearing, near", bought.bearing(), PLATE_TURN, (0.0, middle - outer, 0.0), False),
        _bought("bearing, far", bought.bearing(), PLATE_TURN, (0.0, middle + inner, 0.0), False),
        _print(near, PLATE_TURN, (0.0, head, 0.0), False),
        _print(long, PLATE_TURN, (0.0, middle - inner, 0.0), False),
        _print(near, PLATE_TURN, (0.0, middle + outer, 0.0), False),
        _bought("washer, near", small, PLATE_TURN, (0.0, head - 1.6, 0.0), False),
        _bought("axle", bought.m8_bolt(bolt_length(axle_grip())), PLATE_TURN, (0.0, head - 1.6, 0.0), False),
        _print(axle_plate(), PLATE_TURN, (0.0, plate, 0.0), False),
        _bought("washer, far", small, PLATE_TURN, (0.0, plate + PLATE, 0.0), False),
        _bought("nut", bought.m8_nut(), PLATE_TURN, (0.0, plate + PLATE + 1.6, 0.0), False),
        _post(-PLATE_POST, post_beside_arm(), 250.0),
    ]


def solenoid_striker(length: float, ballast: Ballast) -> list[Placed]:
    """Pendulum that a solenoid drives, with its rest, and switches at rest and tip.

    Args:
        length: Length of the arm [mm].
        ballast: Washers and bolt at its tip.
    """
    x, floor = -PLATE_POST - bought.PROFILE / 2, -REST_DEPTH - STOP_MIDDLE
    upright = np.eye(3)
    forward = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    thick, wide, deep = bought.SWITCH
    front = deep - bought.SWITCH_HOLE_EDGE
    switch = slab(-bought.SWITCH_HOLE_EDGE, front, -wide / 2, wide / 2, 0.0, thick)
    long, broad, high = bought.SOLENOID
    frame = slab(-long, 0.0, -broad / 2, broad / 2, -high, 0.0)
    made = [
        *pendulum(length, ballast),
        _print(solenoid_holder(), upright, (x, 0.0, floor), False),
        _bought("rest", bought.pad(), forward, (x - STOP_RECESS, 0.0, -REST_DEPTH), False),
        _bought("limit switch", switch, upright, (x + SWITCH_ROWS[0], 0.0, floor + STOP[1]), False),
        _bought("solenoid", frame, upright, (x - 16.0, 0.0, floor), False),
    ]
    if places := switch_places(length):
        middle = (places[0][0] + places[1][0]) / 2
        at_tip = slab(-wide / 2, wide / 2, -bought.SWITCH_HOLE_EDGE, front, 0.0, thick)
        at_tip = at_tip.translate((middle, places[0][1], ARM_HEIGHT))
        made.append(_bought("contact switch", at_tip, LYING_ARM, (0.0, ARM_HEIGHT / 2, 0.0), True))
    return made
