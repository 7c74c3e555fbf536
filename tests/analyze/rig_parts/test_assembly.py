"""Assembled rigs: the pad's way at contact, fits of bearings and screws, and parts that stay apart."""

from __future__ import annotations

from functools import cache
from itertools import combinations, pairwise

import numpy as np
import pytest
from manifold3d import OpType

from analyze.rig_parts import bought
from analyze.rig_parts.arm_part import AXLE_HOLE, BACK, HUB, PIN_STEP
from analyze.rig_parts.assembly import (
    Placed,
    pendulum,
    servo_striker,
    solenoid_striker,
)
from analyze.rig_parts.ballast import MOST_WASHERS, Ballast, ballast_of
from analyze.rig_parts.hinge_parts import (
    BEARING_FIT,
    LONG_SPACER,
    SEAT,
    SHOULDER,
    SHOULDER_HOLE,
    SPACER,
    SPACER_BORE,
    bolt_length,
)
from analyze.rig_parts.solids import Solid, bore_x, bore_y, slab

LENGTH = 120.0
HEAVIEST = Ballast(MOST_WASHERS, bolt_length(12.0 + 2.0 * MOST_WASHERS + 8.0))
SERVOS = {each.name: each for each in bought.SERVOS}
KINDS = (*SERVOS, "pendulum", "solenoid")
TOUCHING_MM3 = 0.05
"""volume that faces which lie on each other share by rounding"""


@cache
def made(kind: str, length: float = LENGTH) -> dict[str, Placed]:
    """Parts of a rig with the heaviest ballast."""
    if kind in SERVOS:
        parts = servo_striker(SERVOS[kind], length, HEAVIEST)
    else:
        parts = {"pendulum": pendulum, "solenoid": solenoid_striker}[kind](length, HEAVIEST)
    named = {}
    for each in parts:
        named[each.name if each.name not in named else f"{each.name}, second"] = each
    return named


def corners(solid: Solid) -> np.ndarray:
    return np.asarray(solid.to_mesh64().vert_properties)[:, :3]


def gap(one: Solid, other: Solid, reach: float = 2.0) -> float:
    return float(one.min_gap(other, reach))


@pytest.mark.parametrize("length", [60.0, 120.0, 180.0])
@pytest.mark.parametrize("kind", KINDS)
def test_the_pad_moves_horizontally_at_contact(kind: str, length: float) -> None:
    """At angle 0 the pad's foremost point is below the axis of horn or bearing, at the arm's length."""
    parts = made(kind, length)
    axis = parts["servo"].solid if kind in SERVOS else parts["bearing, near"].solid
    about = corners(axis)
    if kind in SERVOS:  # the horn is the part of the servo nearest the arm
        about = about[about[:, 1] < about[:, 1].min() + 0.01]
    hinge = (about.min(axis=0) + about.max(axis=0)) / 2
    pad = corners(parts["pad"].solid)
    apex = pad[pad[:, 0].argmax()]
    below = hinge[2] - apex[2], apex[0] - hinge[0]
    assert below[0] == pytest.approx(length, abs=0.01)
    # A point moves at right angles to the line from the hinge: its way is as steep as that line is off plumb.
    assert abs(np.degrees(np.arctan2(below[1], below[0]))) < 0.05
    # A bumper that is half a millimetre higher or lower, and glued on half a millimetre off: below a degree.
    worst = np.degrees(np.arctan2(abs(below[1]) + 0.5, length - 0.5))
    assert worst < 1.0
    before, after = (np.array(corners(parts["pad"].at(turn))[pad[:, 0].argmax()]) for turn in (-1e-3, 1e-3))
    moved = after - before
    assert abs(np.degrees(np.arctan2(moved[2], moved[0]))) < 0.1
    assert np.linalg.norm(moved) == pytest.approx(2e-3 * length, rel=1e-3)  # contact speed = omega * length


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_but_the_pad_is_ahead_of_the_tip(kind: str) -> None:
    """Below the hub all else stays 4 mm behind the pad at angle 0, as the planner takes the arm to be."""
    parts = made(kind)
    below_hub = slab(-500.0, 500.0, -500.0, 500.0, -500.0, -HUB / 2 - 3.0)
    for name, each in parts.items():
        if name not in ("pad", "contact switch"):
            kept = each.solid ^ below_hub
            assert kept.is_empty() or corners(kept)[:, 0].max() <= -4.0 + 1e-6, name
    # A square at the pad's apex stands half the hub's diameter behind the hub's foremost point.
    assert corners(parts["arm"].solid)[:, 0].max() == pytest.approx(HUB / 2, abs=0.02)


def overlaps(parts: dict[str, Placed], angles: tuple[float, ...]) -> list[tuple[float, str, str]]:
    """Angle and names of each two parts that reach into one another."""
    found: list[tuple[float, str, str]] = []
    for angle in angles:
        placed = {name: each.at(angle) for name, each in parts.items()}
        for (name, one), (other_name, other) in combinations(placed.items(), 2):
            moves = angle == angles[0] or parts[name].swings != parts[other_name].swings
            if moves and (one ^ other).volume() >= TOUCHING_MM3:
                found.append((angle, name, other_name))
    return found


@pytest.mark.parametrize(
    ("kind", "angles"),
    [
        ("xm430", (-0.9, -0.6, 0.0, 0.5)),
        ("xl330", (-0.9, 0.0, 0.5)),
        ("pendulum", (-1.05, -0.7, 0.0, 0.5)),
        ("solenoid", (-0.26, -0.12, 0.0)),
    ],
)
def test_no_part_reaches_into_another(kind: str, angles: tuple[float, ...]) -> None:
    assert overlaps(made(kind), angles) == []


@pytest.mark.slow
@pytest.mark.parametrize("length", [60.0, 72.0, 90.0, 150.0, 180.0])
@pytest.mark.parametrize("kind", [*SERVOS, "pendulum"])
def test_no_part_reaches_into_another_with_shorter_and_longer_arms(kind: str, length: float) -> None:
    assert overlaps(made(kind, length), (-0.9, 0.0, 0.5)) == []


def test_the_swinging_parts_clear_the_post() -> None:
    """From -0.9 to 0.5 rad arm and heaviest ballast stay 1 mm or more off post, plate and holder."""
    for kind in (*SERVOS, "pendulum"):
        parts = made(kind)
        stands = Solid.batch_boolean(
            [each.solid for each in parts.values() if each.name in ("post", "axle-plate", f"servo-{kind}")],
            OpType.Add,
        )
        for angle in (-0.9, -0.3, 0.0, 0.5):
            for name in ("arm", "ballast, far", "ballast's bolt"):
                for aside in ((0, 1, 0), (1, 0, 0), (-1, 0, 0)):
                    moved = parts[name].at(angle).translate(aside)
                    assert (moved ^ stands).volume() < TOUCHING_MM3, (kind, angle, name)


def test_bearings_are_held_along_the_axle_and_by_their_inner_rings_only() -> None:
    """Standard dimensions of a 608: bore 8, outer diameter 22, width 7, rings' shoulders 12.1 and 19.2 mm."""
    parts = made("pendulum")
    hub = parts["bearing-hub"].solid
    near, far = (parts[f"bearing, {side}"].solid for side in ("near", "far"))
    # Radially 0.05 mm all round; the seat's shoulder carries the outer ring, and is clear of the inner one.
    assert pytest.approx(0.1) == BEARING_FIT
    assert bought.INNER_RING + 1.0 < SHOULDER_HOLE < bought.OUTER_RING
    assert 10.0 < SPACER < bought.INNER_RING  # bears on the inner ring, rubs on nothing
    assert bought.BEARING_BORE < SPACER_BORE < SPACER - 2 * 1.2
    # Along the axle: 0.1 mm to each side of the shoulder, and the hub can leave in neither direction.
    assert pytest.approx(0.2) == LONG_SPACER - SHOULDER
    for bearing, sense in ((near, 1.0), (far, -1.0)):
        assert (hub ^ bearing.translate((0.0, 0.05 * sense, 0.0))).volume() < TOUCHING_MM3
        assert (hub ^ bearing.translate((0.0, 0.2 * sense, 0.0))).volume() > 1.0
    # Both lie below the hub's faces: what is screwed to them touches no ring.
    assert pytest.approx(0.4) == SEAT - bought.BEARING_WIDTH - (LONG_SPACER - SHOULDER) / 2
    rings = corners(near)[:, 1].min(), corners(far)[:, 1].max()
    assert rings[0] - corners(parts["arm"].solid)[:, 1].max() >= 0.35
    assert corners(parts["axle-plate"].solid)[:, 1].min() - rings[1] >= 0.35
    # The clamped stack lies end to end: head, washer, spacer, bearing, spacer, bearing, spacer, plate, nut.
    stack = (
        "axle",
        "washer, near",
        "spacer-short",
        "bearing, near",
        "spacer-long",
        "bearing, far",
        "spacer-short, second",
        "axle-plate",
        "washer, far",
        "nut",
    )
    for one, other in pairwise(stack[1:]):
        high, low = corners(parts[one].solid)[:, 1].max(), corners(parts[other].solid)[:, 1].min()
        assert high == pytest.approx(low, abs=0.01), (one, other)
    axle, nut = corners(parts["axle"].solid)[:, 1], corners(parts["nut"].solid)[:, 1]
    assert axle.max() >= nut.max() + 1.0
    # Head and washer stand still in the arm's hole, 1.5 mm or more from it.
    around = bore_y(AXLE_HOLE - 3.0, 0.0, 0.0, -20.0, corners(parts["arm"].solid)[:, 1].max())
    for name in ("washer, near", "axle"):
        inside = parts[name].solid ^ slab(-50.0, 50.0, -20.0, 6.0, -50.0, 50.0)
        assert (inside - around).volume() < TOUCHING_MM3, name
    assert (around ^ parts["arm"].solid).volume() < TOUCHING_MM3


@pytest.mark.parametrize("angle", [0, 10, 20, 30, 40, 50, 60])
def test_the_pin_locks_the_pendulum_at_every_step(angle: int) -> None:
    """A 3 mm pin passes arm, hub and plate at one of the arm's two holes, with 0.1 mm around it."""
    parts = made("pendulum")
    turned = [parts[name].at(-np.radians(angle)) for name in ("arm", "bearing-hub")]
    turned.append(parts["axle-plate"].solid)
    second = bool(angle % PIN_STEP)
    about = np.radians(angle + (70.0 if second else 0.0))
    pin = bore_y(bought.PIN, 15.5 * np.sin(about), 15.5 * np.cos(about), -20.0, 60.0)
    for each in turned:
        assert (pin ^ each).volume() < TOUCHING_MM3
        assert gap(pin, each, 1.0) == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize("kind", [*SERVOS, "pendulum"])
def test_four_screws_hold_the_arm(kind: str) -> None:
    """M3 screws pass through arm and adapter or hub; their nuts have flats to bear on, and end flush."""
    parts = made(kind)
    other = parts["bearing-hub" if kind == "pendulum" else f"horn-{kind}"].solid
    far = corners(other)[:, 1].max()
    assert far + 6.0 == pytest.approx(35.0 if kind == "pendulum" else 18.0, abs=0.01)  # lengths of the screws
    for x, z in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        place = 15.5 / np.sqrt(2) * x, 15.5 / np.sqrt(2) * z
        screw = bore_y(3.0, place[0], place[1], -10.0, far)
        assert (screw ^ parts["arm"].solid).volume() < TOUCHING_MM3
        assert (screw ^ other).volume() < TOUCHING_MM3
        nut = bore_y(5.5, place[0], place[1], far - 2.4, far)
        assert (nut ^ other).volume() < TOUCHING_MM3
        assert (bore_y(5.5, place[0], place[1], far - 3.5, far - 2.9) ^ other).volume() > 5.0


@pytest.mark.parametrize(
    ("kind", "name", "heights"),
    [
        ("xm430", "servo-xm430", (-8.0, 32.0)),
        ("xl330", "servo-xl330", (-12.5, 27.5)),
        ("pendulum", "axle-plate", (22.0, -22.0)),
    ],
)
def test_both_screws_of_a_plate_meet_one_slot_of_the_post(
    kind: str, name: str, heights: tuple[float, float]
) -> None:
    parts = made(kind)
    post = corners(parts["post"].solid)
    middle, face = (post[:, 0].min() + post[:, 0].max()) / 2, post[:, 1].min()
    plate = parts[name].solid
    assert corners(plate)[:, 1].max() == pytest.approx(face, abs=0.01)
    for z in heights:
        screw = bore_y(5.0, middle, z, face - 25.0, face + 4.0)  # 4 mm deep into the slot of 6 mm
        assert (screw ^ plate).volume() < TOUCHING_MM3
        assert (screw ^ parts["post"].solid).volume() < TOUCHING_MM3


def test_a_servos_case_slides_into_its_holder_and_is_clamped() -> None:
    for servo in bought.SERVOS:
        parts = made(servo.name)
        holder, body = parts[f"servo-{servo.name}"].solid, parts["servo"].solid
        assert 0.1 <= gap(holder, body) <= 0.2
        for shift in (-10.0, -3.0, 3.0):  # along the horn's axis: from the front, and to adjust
            assert (holder ^ body.translate((0.0, shift, 0.0))).volume() < TOUCHING_MM3
        # Two M3 x 25 draw the ears together: they pass both, the slit is wider than what is to be closed.
        ears = corners(holder)
        middle, top = (ears[:, 0].max() - servo.width / 2 - 4.15), ears[:, 2].max()
        assert middle == pytest.approx(0.0, abs=0.01)  # the horn's axis
        front = ears[:, 1].min()
        for y in (front + 8.0, front + servo.depth - 10.0):
            screw = bore_x(3.0, y, top - 5.0, -12.0, 12.0)
            assert (screw ^ holder).volume() < TOUCHING_MM3
            around = bore_x(6.0, y, top - 5.0, -9.0, 9.0) ^ holder
            assert around.volume() > 250.0  # both ears bear head and nut
            assert len((slab(-9.0, 9.0, y - 4.0, y + 4.0, top - 8.0, top) ^ holder).decompose()) == 2


def test_the_solenoids_holder_sits_on_the_slot_at_the_posts_rear() -> None:
    parts = made("solenoid")
    holder, post = parts["solenoid-holder"].solid, parts["post"].solid
    rear, middle = corners(post)[:, 0].min(), corners(post)[:, 1].min() + bought.PROFILE / 2
    low = corners(holder)[:, 2].min()
    for z in (low + 16.0, low + 38.0):
        screw = bore_x(5.0, middle, z, rear - 30.0, rear + 4.0)
        assert (screw ^ holder).volume() < TOUCHING_MM3
        assert (screw ^ post).volume() < TOUCHING_MM3
    assert low == pytest.approx(
        -58.0, abs=0.01
    )  # the guide: upper end 18 mm above the axle plate's lower end
    upper, lower = corners(holder)[:, 2].max(), corners(parts["axle-plate"].solid)[:, 2].min()
    assert upper - lower == pytest.approx(18.0, abs=0.01)
    # M3 screws or cable ties hold a frame of the stated size: slots in and beside its width.
    for y in (-10.0, 0.0, 10.0):
        hanging = Solid.cylinder(10.0, 1.5).translate((rear - 40.0, y, low - 2.0))
        assert (hanging ^ holder).volume() < TOUCHING_MM3
    for y in (-18.5, 18.5):
        tie = slab(rear - 36.0, rear - 32.0, y - 1.0, y + 1.0, low - 1.0, low + 8.0)
        assert (tie ^ holder).volume() < TOUCHING_MM3


def test_the_rest_stops_the_arm_and_closes_the_switch() -> None:
    parts = made("solenoid")
    arm, rest = parts["arm"], parts["rest"].solid
    behind, free = np.radians(-20.0), np.radians(-12.0)
    assert (arm.at(behind) ^ rest).volume() > 0.1
    assert (arm.at(free) ^ rest).volume() == 0.0
    while free - behind > 1e-3:
        middle = (free + behind) / 2
        behind, free = (middle, free) if (arm.at(middle) ^ rest).volume() > 1e-4 else (behind, middle)
    at_rest = free
    for name in ("solenoid-holder", "solenoid", "limit switch", "post"):
        assert (arm.at(at_rest) ^ parts[name].solid).volume() < TOUCHING_MM3, name
    # The rubber is met first, the holder's edge not at all.
    assert gap(arm.at(at_rest), parts["solenoid-holder"].solid, 1.0) >= 0.4
    # Ahead of the switch's case is room for the lever as it switches: 8.8 mm from its holes, 7.3 are case.
    assert gap(arm.at(at_rest), parts["limit switch"].solid, 4.0) == pytest.approx(1.5, abs=0.8)
    # The solenoid's stroke of 10 mm drives it, then it flies freely to the object.
    assert 5.0 < gap(arm.at(at_rest), parts["solenoid"].solid, 20.0) < 20.0  # its plunger bridges that


def test_the_contact_switch_closes_as_the_pad_touches() -> None:
    parts = made("solenoid")
    switch, pad = (corners(parts[name].solid) for name in ("contact switch", "pad"))
    # Its case ends 7.3 mm before its holes, its lever switches at 8.8 mm: in the plane of the pad's apex.
    assert switch[:, 0].max() + 8.8 - 7.3 == pytest.approx(pad[:, 0].max(), abs=0.05)
    assert switch[:, 1].max() == pytest.approx(-6.0, abs=0.01)  # beside the arm, towards the camera


def test_the_camera_stands_on_one_profile() -> None:
    from analyze.rig_parts.assembly import solid_of
    from analyze.rig_parts.stand_parts import camera_holder, lamp_holder

    holder = solid_of(camera_holder().mesh)
    post = bought.profile(200.0).translate((0.0, 52.0 + 10.0, -50.0))
    assert (holder ^ post).volume() < TOUCHING_MM3
    for z in (20.0, 44.0):  # both in the middle of the one slot on that side
        screw = bore_y(5.0, 0.0, z, 0.0, 56.0)
        assert (screw ^ holder).volume() < TOUCHING_MM3
        assert (screw ^ post).volume() < TOUCHING_MM3
        assert (bore_y(8.5, 0.0, z, 41.0, 46.0) ^ holder).volume() < TOUCHING_MM3  # the screw's head
    camera = slab(-20.0, 20.0, 2.0, 44.0, 6.0, 60.0)
    assert (holder ^ camera).volume() < TOUCHING_MM3
    lamp = solid_of(lamp_holder().mesh)
    bar = bought.profile(600.0).rotate((0.0, 90.0, 0.0)).translate((-300.0, 10.0, -10.0))
    screw = Solid.cylinder(30.0, 2.5).translate((0.0, 10.0, -4.0))
    for one, other in combinations((lamp, bar, screw), 2):
        assert (one ^ other).volume() < TOUCHING_MM3


def test_ballast_comes_near_to_the_wanted_mass() -> None:
    for wanted in (0.05, 0.1, 0.15, 0.2):
        found = ballast_of(wanted)
        assert found.mass_kg == pytest.approx(wanted, abs=0.009)
        assert found.washers % 2 == 0  # half of them on each side: the arm does not twist
    assert ballast_of(0.0) == Ballast(0, 0.0)
    assert ballast_of(5.0).washers == MOST_WASHERS
    assert pytest.approx(8.0) == BACK - bought.WASHER / 2  # behind the tip's sphere, as planned
