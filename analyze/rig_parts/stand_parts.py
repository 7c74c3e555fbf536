"""Parts on aluminium profiles of 20 mm: holders of servo, camera, lamp and solenoid."""

from __future__ import annotations

from functools import cache

from analyze.rig_parts.bought import (
    M3,
    M5,
    PAD,
    PROFILE,
    QUARTER_INCH,
    SWITCH_HOLES,
    Servo,
)
from analyze.rig_parts.hinge_parts import post_beside_arm
from analyze.rig_parts.solids import (
    BEYOND,
    Dimension,
    RigPart,
    Solid,
    bore_x,
    bore_y,
    cut,
    disc,
    rounded,
    slab,
    slot,
)

FIT, WALL = 0.3, 4.0
"""Clearance around a servo, in width, and thickness of the wall around it [mm]."""
PLATE, CABLE_ROOM, GRIP_SETBACK = 8.0, 16.0, 3.0
"""Thickness of the servo holder's plate, room for cables behind the servo, and length by which the case
stands out of the holder at the horn [mm]."""
SLIT, EAR = 2.0, 13.0
"""Width of the slit in the servo holder, and height of the ears that the clamp screws draw together [mm]."""
SERVO_SCREWS = 40.0
"""Distance of the servo holder's two M5 screws [mm]."""


def servo_post(servo: Servo) -> float:
    """Distance of the post's middle behind the hinge [mm], for the holder of a servo."""
    return (servo.width + FIT) / 2 + WALL + PROFILE / 2 + 4.0


def servo_holder_length(servo: Servo) -> float:
    """Length of a servo's holder along the horn's axis, with its plate [mm]."""
    return servo.depth - GRIP_SETBACK + CABLE_ROOM + PLATE


@cache
def servo_holder(servo: Servo) -> RigPart:
    """Split sleeve around a servo's case, on a plate for the post; two M3 screws clamp the case.

    The plate lies on the bed; x is along the strike, y up, the horn's axis in the origin.
    """
    half, low = (servo.width + FIT) / 2, -servo.axis_to_end - FIT / 2
    high, top, back = (
        servo.height - servo.axis_to_end + FIT / 2,
        servo_holder_length(servo),
        -servo_post(servo),
    )
    outer = half + WALL, low - WALL, high + WALL
    middle = (low + high) / 2
    ends = middle - SERVO_SCREWS / 2, middle + SERVO_SCREWS / 2
    plate = rounded(back - PROFILE / 2, back + PROFILE / 2, ends[0] - 8, ends[1] + 8, 0.0, PLATE, 3.0)
    plate += rounded(back - PROFILE / 2, outer[0], outer[1], outer[2], 0.0, PLATE, 2.0)
    sleeve = rounded(-outer[0], outer[0], outer[1], outer[2], 0.0, top, 2.0)
    ears = rounded(-9.0, 9.0, high, outer[2] + EAR, 0.0, top, 1.5)
    holes = [
        slab(-half, half, low, high, PLATE, top + BEYOND),
        slab(-SLIT / 2, SLIT / 2, high - BEYOND, outer[2] + EAR + BEYOND, PLATE, top + BEYOND),
        rounded(2.0 - half, half - 2.0, low + 2.0, high - 2.0, -BEYOND, PLATE + BEYOND, 2.0),
    ]
    holes += [bore_x(14.0, middle, PLATE + CABLE_ROOM / 2 + 1.0, -2 * half, 2 * half)]
    ear = outer[2] + EAR - 5.0
    holes += [bore_x(M3, ear, z, -20.0, 20.0) for z in (top - 8.0, top - servo.depth + 10.0)]
    holes += [disc(M5, -BEYOND, PLATE + BEYOND, back, y) for y in ends]
    front = -PROFILE / 2 + back
    return RigPart(
        f"servo-{servo.name}",
        f"holder of an {servo.name.upper()} on the post",
        cut(plate + sleeve + ears, *holes),
        (
            Dimension("top", (front, outer[1]), (outer[0], outer[1]), -14.0),
            Dimension("top", (-half, low), (half, low), -10.0 - WALL - 14.0),
            Dimension("top", (back, ends[0]), (back, ends[1]), 20.0),
            Dimension("top", (outer[0], low), (outer[0], high), -8.0),
            Dimension("front", (outer[0], 0.0), (outer[0], top), -8.0),
        ),
        "2 M3 x 25 with nuts and washers; 2 M5 x 12 with slot nuts",
    )


CAMERA_WIDTH, CAMERA_DEPTH, CAMERA_HEIGHT, CAMERA_PLATE, CAMERA_SCREWS = 50.0, 52.0, 52.0, 6.0, 24.0
"""Outer lengths of the camera's holder, thickness of its plates, and distance of its two M5 screws [mm]."""


def camera_holder() -> RigPart:
    """Shelf on which a camera stands, with a slot for its tripod screw, on one profile of 20 mm.

    The shelf lies on the bed, the plate for the post stands at its far end; both screws are in one line, as
    the profile has one slot on a side.
    """
    half, deep, high, thick = CAMERA_WIDTH / 2, CAMERA_DEPTH, CAMERA_HEIGHT, CAMERA_PLATE
    inner = deep - thick
    body = rounded(-half, half, 0.0, deep, 0.0, thick, 4.0) + slab(-half, half, deep - 8, deep, 0, thick)
    body += slab(-half, half, inner, deep, 0.0, high)
    for x in (-half, half - 5.0):
        low = slab(x, x + 5.0, 6.0, inner + BEYOND, 0.0, thick)
        body += Solid.batch_hull([low, slab(x, x + 5.0, inner, inner + BEYOND, 0.0, high)])
    low, top = high - 8.0 - CAMERA_SCREWS, high - 8.0
    holes = [bore_y(M5, 0.0, z, inner - BEYOND, deep + BEYOND) for z in (low, top)]
    ends = [disc(QUARTER_INCH, -BEYOND, thick + BEYOND, 0.0, y) for y in (12.0, 32.0)]
    return RigPart(
        "camera-holder",
        "holder of a camera with a tripod thread, on the camera's post",
        cut(body, *holes, Solid.batch_hull(ends)),
        (
            Dimension("top", (-half, 0.0), (half, 0.0), -8.0),
            Dimension("top", (half, 0.0), (half, deep), -8.0),
            Dimension("top", (-half, 12.0), (-half, 32.0), 8.0),
            Dimension("front", (half, 0.0), (half, high), -8.0),
            Dimension("front", (-half, low), (-half, top), 8.0),
        ),
        "1 tripod screw, 1/4 inch x 10 mm; 2 M5 x 10 with slot nuts",
    )


LAMP_WIDTH, LAMP_DEPTH, LAMP_HEIGHT, LAMP_PLATE = 20.0, 30.0, 36.0, 6.0
"""Outer lengths of a lamp's holder, and thickness of its plates [mm]."""


def lamp_holder() -> RigPart:
    """Angle that holds a lamp on the lamps' bar: it turns about its M5 screw, the lamp tilts on the other."""
    half, deep, high, thick = LAMP_WIDTH / 2, LAMP_DEPTH, LAMP_HEIGHT, LAMP_PLATE
    inner, eye = deep - thick, high - half
    body = rounded(-half, half, 0.0, deep, 0.0, thick, 4.0) + slab(-half, half, deep - 8, deep, 0, thick)
    body += Solid.batch_hull(
        [slab(-half, half, inner, deep, 0, thick), bore_y(2 * half, 0, eye, inner, deep)]
    )
    holes = [disc(M5, -BEYOND, thick + BEYOND, 0.0, 10.0)]
    holes.append(bore_y(QUARTER_INCH, 0.0, eye, inner - BEYOND, deep + BEYOND))
    return RigPart(
        "lamp-holder",
        "holder of a lamp on the bar of the lamps",
        cut(body, *holes),
        (
            Dimension("top", (-half, 0.0), (half, 0.0), -8.0),
            Dimension("top", (half, 0.0), (half, deep), -8.0),
            Dimension("front", (half, 0.0), (half, high), -8.0),
            Dimension("front", (-half, 0.0), (-half, eye), 8.0),
        ),
        "1 M5 x 10 with slot nut; 1/4 inch x 16 mm, or M6 x 20 with nut, for the lamp",
        count=2,
    )


SHELF, SHELF_HIGH, SHELF_SCREWS = 6.0, 46.0, 22.0
"""Thickness of the solenoid holder's plates, its height, and distance of its two M5 screws [mm]."""
STOP, STOP_MIDDLE, STOP_RECESS = (14.0, 20.0), 7.0, 2.0
"""Half the width and height of the block on which the arm rests, height of its rubber bumper's middle, and
depth of the recess for it [mm]."""
SWITCH_LEDGE = 2.2
"""Reach of the block's top before its front [mm]; the leaning arm leaves that room."""
SWITCH_ROWS = (-1.4, -5.4, -9.4)
"""Places of the limit switch's holes along the strike, of which one pair is used [mm]."""
REAR = 62.0
"""Length of the solenoid's shelf behind the post's rear face [mm]."""


@cache
def solenoid_holder() -> RigPart:
    """Shelf behind the post: a solenoid hangs below it, the arm rests on its front, on a limit switch.

    It stands on the bed with the shelf's underside; x is along the strike, y along the hinge from the arm
    (y = 0) to the post, z up; x = 0 is the post's rear face.
    """
    post, half, side = post_beside_arm(), PROFILE / 2, 24.0
    body = rounded(-REAR, -SHELF, -side, post + half, 0.0, SHELF, 3.0)
    body += slab(-2 * SHELF, 0.0, -8.0, post + half, 0.0, SHELF)
    body += rounded(-22.0, 0.0, -STOP[0], STOP[0], 0.0, STOP[1], 2.0)
    ledge = slab(-BEYOND, 0.0, -STOP[0], STOP[0], 13.5, STOP[1])
    body += Solid.batch_hull(
        [ledge, slab(0.0, SWITCH_LEDGE, -STOP[0], STOP[0], 14.0 + SWITCH_LEDGE, STOP[1])]
    )
    body += slab(-SHELF, 0.0, post - half, post + half, 0.0, SHELF_HIGH)
    low = slab(-REAR + 14.0, -SHELF + BEYOND, post - half, post - half + 5.0, 0.0, SHELF)
    rib = slab(-SHELF, -SHELF + BEYOND, post - half, post - half + 5.0, 0.0, SHELF_HIGH)
    body += Solid.batch_hull([low, rib])
    top = SHELF_HIGH - 8.0
    holes = [bore_x(M5, post, z, -SHELF - BEYOND, BEYOND) for z in (top - SHELF_SCREWS, top)]
    holes.append(bore_x(PAD + 0.6, 0.0, STOP_MIDDLE, -STOP_RECESS, BEYOND))
    holes += [slot(M3, 28.0, -BEYOND, SHELF + BEYOND, -40.0, y) for y in (-10.0, 0.0, 10.0)]
    for x in (-34.0, -54.0):
        holes += [slab(x - 2.5, x + 2.5, y - 1.5, y + 1.5, -BEYOND, SHELF + BEYOND) for y in (-18.5, 18.5)]
    for x in SWITCH_ROWS:
        holes += [
            disc(1.9, STOP[1] - 6.0, STOP[1] + BEYOND, x, y) for y in (-SWITCH_HOLES / 2, SWITCH_HOLES / 2)
        ]
    return RigPart(
        "solenoid-holder",
        "holder of solenoid, rest and limit switch, on the rear of the post",
        cut(body, *holes),
        (
            Dimension("top", (-REAR, -side), (SWITCH_LEDGE, -side), -8.0),
            Dimension("top", (0.0, 0.0), (0.0, post), -8.0),
            Dimension("top", (0.0, -side), (0.0, post + half), -18.0),
            Dimension("front", (0.0, 0.0), (0.0, SHELF_HIGH), -8.0),
            Dimension("front", (-REAR, 0.0), (-REAR, STOP[1]), 8.0),
        ),
        "2 M5 x 10 with slot nuts; solenoid with M3 x 10 or cable ties; micro switch with 2 M2.2 x 13 "
        "self-tapping; rubber bumper",
    )
