"""Toys and games."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import Built, filled, made_of, world_shape
from tests.world.solids import (
    ball,
    box,
    chamfered,
    cylinder,
    joined,
    lathe,
    prism,
    rod,
    rounded_box,
    rounded_rectangle,
    smooth_loft,
)


@world_shape("toy", 2.3)
def lego_brick(rng: np.random.Generator) -> Manifold:
    """Brick of 2 x 4 studs, hollow below with three tubes."""
    brick = box(31.8, 15.8, 9.6) - box(28.8, 12.8, 8.1, (0, 0, 0))
    studs = [cylinder(2.4, 1.8, (8 * i - 12, 8 * j - 4, 9.5)) for i in range(4) for j in range(2)]
    tubes = [cylinder(3.25, 8.2, (8 * i - 8, 0, 0)) - cylinder(2.4, 8.0, (8 * i - 8, 0, 0)) for i in range(3)]
    return joined(brick, *studs, *tubes)


@world_shape("toy", 5.2)
def dice(rng: np.random.Generator) -> Manifold:
    """Die of 16 mm with pips and corners cut by a sphere."""
    cube = rounded_box(16, 16, 16, 1, (0, 0, -8)) ^ Manifold.sphere(11.4, 64)
    pips = {1: [(0, 0)], 2: [(-4, -4), (4, 4)], 3: [(-4, -4), (0, 0), (4, 4)]}
    pips[4] = [(a, b) for a in (-4, 4) for b in (-4, 4)]
    pips[5], pips[6] = [*pips[4], (0, 0)], [*pips[4], (-4, 0), (4, 0)]
    turns = {1: (0, 0, 0), 6: (180, 0, 0), 2: (90, 0, 0), 5: (-90, 0, 0), 3: (0, 90, 0), 4: (0, -90, 0)}
    for value, turn in turns.items():
        for a, b in pips[value]:
            cube -= Manifold.sphere(1.5, 16).translate((a, b, 8.6)).rotate(turn)
    return cube


@world_shape("toy", 94)
def rubiks_cube(rng: np.random.Generator) -> Manifold:
    """Twenty-seven cubelets with gaps."""
    core = box(52, 52, 52, (0, 0, -26))
    cubelets = [
        rounded_box(18.6, 18.6, 18.6, 1.2, (19 * i, 19 * j, 19 * k - 9.3))
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        for k in (-1, 0, 1)
        if (i, j, k) != (0, 0, 0)
    ]
    return joined(core, *cubelets)


@world_shape("toy", 1435)
def nine_hole_peg(rng: np.random.Generator) -> Manifold:
    board = box(127, 127, 28)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            board -= cylinder(5, 20, (32 * i, 32 * j, 14))
    return board


@world_shape("toy", 570)
def toy_plane(rng: np.random.Generator) -> Manifold:
    """Propeller plane on two wheels and a tail skid."""
    fuselage = (
        smooth_loft([-110, -80, 0, 70, 105], [6, 14, 22, 22, 12], [8, 15, 24, 24, 12], 2.4)
        .rotate((0, 90, 0))
        .translate((0, 0, 45))
    )
    wing = chamfered(rounded_rectangle(52, 230, 18), 9, 3).translate((25, 0, 52))
    tail = chamfered(rounded_rectangle(32, 86, 10), 7, 2).translate((-92, 0, 45)) + box(
        30, 6, 40, (-92, 0, 50)
    )
    wheels = joined(*[cylinder(14, 10).rotate((90, 0, 0)).translate((45, 40 * s + 5, 14)) for s in (-1, 1)])
    legs = joined(*[rod([[40, 14 * s, 38], [45, 40 * s, 14]], 4) for s in (-1, 1)])
    nose = box(5, 12, 90, (106, 0, 0)) + cylinder(9, 16).rotate((0, 90, 0)).translate((100, 0, 45))
    return joined(fuselage, wing, tail, wheels, legs, rod([[-92, 0, 40], [-96, 0, 16]], 4), nose)


@world_shape("toy", 64)
def toy_car(rng: np.random.Generator) -> Built:
    profile = [(-37, 7), (37, 7), (38, 18), (18, 21), (8, 31), (-18, 31), (-28, 21), (-38, 20)]
    body = prism(profile, 30, 3).rotate((90, 0, 0)).translate((0, 15, 0))
    wheels = joined(
        *[
            cylinder(8, 6).rotate((90, 0, 0)).translate((23 * a, 16.5 * b + 3, 8))
            for a in (-1, 1)
            for b in (-1, 1)
        ]
    )
    return made_of(("body", 0.75, body), ("wheels", 0.25, wheels))


@world_shape("toy", 380)
def toy_truck(rng: np.random.Generator) -> Manifold:
    """Tipper with a cab, an open bed and six wheels."""
    chassis = box(180, 50, 12, (0, 0, 18))
    cab = chamfered(rounded_rectangle(48, 66, 6), 58, 4).translate((62, 0, 26))
    bed = Manifold.batch_hull(
        [box(104, 60, 1, (-32, 0, 32)), box(122, 78, 1, (-30, 0, 72))]
    ) - Manifold.batch_hull([box(96, 52, 1, (-32, 0, 37)), box(116, 72, 1, (-30, 0, 73))])
    wheels = joined(
        *[
            cylinder(19, 16).rotate((90, 0, 0)).translate((x, 30 * s + 8, 19))
            for x in (-66, -22, 62)
            for s in (-1, 1)
        ]
    )
    return joined(chassis, cab, bed, wheels)


@world_shape("toy", 55)
def rubber_duck(rng: np.random.Generator) -> Built:
    body = ball(1, (0, 0, 26), (42, 32, 28)).trim_by_plane((0, 0, 1), 4)
    head = ball(22, (22, 0, 62))
    beak = ball(1, (46, 0, 58), (12, 10, 4))
    tail = Manifold.batch_hull([ball(4, (-48, 0, 48)), ball(14, (-26, 0, 30))])
    wings = joined(*[ball(1, (-4, 28 * s, 30), (24, 8, 14)) for s in (-1, 1)])
    solid = joined(body, head, beak, tail, wings)
    return filled(solid, 0.95)


@world_shape("toy", 42)
def chess_king(rng: np.random.Generator) -> Manifold:
    body = lathe(
        [
            (0, 1),
            (15, 1),
            (16, 0),
            (19, 0),
            (19, 8),
            (15, 13),
            (10, 18),
            (7, 50),
            (12, 56),
            (9, 60),
            (12, 78),
            (8, 82),
            (0, 84),
        ],
        1.2,
    )
    return body + rounded_box(4, 4, 14, 1, (0, 0, 82)) + rounded_box(11, 4, 4, 1, (0, 0, 88))


@world_shape("toy", 24)
def chess_knight(rng: np.random.Generator) -> Manifold:
    base = lathe([(0, 0), (16, 0), (16, 7), (12, 12), (10, 18), (0, 18)], 1.2)
    head = (
        prism(
            [(-10, 16), (9, 16), (6, 30), (18, 38), (16, 46), (2, 54), (-6, 60), (-8, 52), (-13, 40)], 15, 3
        )
        .rotate((90, 0, 0))
        .translate((0, 7.5, 0))
    )
    return base + head


@world_shape("toy", 30)
def spinning_top(rng: np.random.Generator) -> Manifold:
    return lathe(
        [(0, 0), (3, 4), (10, 14), (28, 24), (30, 28), (26, 33), (8, 36), (4, 42), (4, 62), (5, 66), (0, 67)],
        1.5,
    )


@world_shape("toy", 150)
def arch_block(rng: np.random.Generator) -> Manifold:
    """Wooden bridge: stands on two legs under a half-round opening."""
    return rounded_box(120, 35, 60, 1.5) - cylinder(32, 60).rotate((90, 0, 0)).translate((0, 30, 0))


@world_shape("toy", 85)
def prism_block(rng: np.random.Generator) -> Manifold:
    return chamfered(np.array([(0.0, 0.0), (70, 0), (0, 70)]), 35, 1.2)


@world_shape("toy", 26)
def robot_figure(rng: np.random.Generator) -> Manifold:
    """Figure with two flat feet, arms that reach forward, an antenna."""
    feet = joined(*[rounded_box(22, 15, 8, 2, (3, 11 * s, 0)) for s in (-1, 1)])
    legs = joined(*[rounded_box(11, 11, 30, 2, (0, 11 * s, 6)) for s in (-1, 1)])
    trunk, head = rounded_box(22, 38, 40, 3, (0, 0, 33)), rounded_box(20, 24, 22, 3, (0, 0, 75))
    arms = joined(*[rod([[0, 22 * s, 66], [6, 25 * s, 48], [26, 25 * s, 46]], 5) for s in (-1, 1)])
    return joined(
        feet, legs, trunk, head, arms, box(8, 8, 6, (0, 0, 71)), rod([[0, 0, 95], [0, 0, 112]], 1.5)
    )


@world_shape("toy", 48)
def dinosaur(rng: np.random.Generator) -> Manifold:
    """Sauropod on four legs with rounded soles, long neck and tail."""
    trunk = ball(1, (0, 0, 40), (38, 20, 20))
    neck = rod([[25, 0, 45], [48, 0, 72], [60, 0, 96], [76, 0, 98]], [14, 9, 7, 8])
    tail = rod([[-28, 0, 42], [-60, 4, 30], [-92, 14, 18], [-115, 26, 12]], [14, 9, 5, 2.5])
    legs = joined(
        *[rod([[22 * a, 12 * b, 32], [24 * a, 15 * b, 7]], [9, 7.5]) for a in (-1, 1) for b in (-1, 1)]
    )
    return joined(trunk, neck, tail, legs).trim_by_plane((0, 0, 1), 1.5)


@world_shape("toy", 120)
def teddy_bear(rng: np.random.Generator) -> Manifold:
    """Seated soft toy: rests on a bulge and two outstretched legs."""
    parts = [ball(1, (0, 0, 42), (36, 38, 44)), ball(30, (4, 0, 104))]
    parts += [ball(1, (-4, 24 * s, 132), (5, 11, 11)) for s in (-1, 1)]
    parts += [rod([[12, 22 * s, 15], [58, 34 * s, 14]], [15, 14]) for s in (-1, 1)]
    parts += [rod([[6, 32 * s, 74], [34, 46 * s, 52]], [12, 11]) for s in (-1, 1)]
    return joined(*parts, ball(1, (32, 0, 98), (11, 13, 10)))


@world_shape("toy", 58)
def tennis_ball(rng: np.random.Generator) -> Manifold:
    return ball(33.5, (0, 0, 33.5))


@world_shape("toy", 46)
def golf_ball(rng: np.random.Generator) -> Manifold:
    solid = ball(21.4, (0, 0, 0))
    for i in range(80):
        z = 1 - (2 * i + 1) / 80
        turn, r = 2.39996 * i, np.sqrt(1 - z * z)
        solid -= Manifold.sphere(2.4, 12).translate(
            (22.9 * r * np.cos(turn), 22.9 * r * np.sin(turn), 22.9 * z)
        )
    return solid


@world_shape("toy", 410)
def football(rng: np.random.Generator) -> Manifold:
    return ball(1, (0, 0, 0), (140, 85, 85))


@world_shape("toy", 35)
def cup_stack_toy(rng: np.random.Generator) -> Manifold:
    """Stacking cup, upside down on its rim with four notches."""
    cup = lathe(
        [(33, 0), (36, 0), (36, 4), (34, 5), (28, 55), (26, 58), (0, 58), (0, 55.5), (25, 55.5), (31, 5)], 0.6
    )
    return cup - joined(*[box(90, 8, 3, (0, 0, -0.1)).rotate((0, 0, 90 * i)) for i in range(2)])


@world_shape("toy", 88)
def train_engine(rng: np.random.Generator) -> Manifold:
    boiler = cylinder(19, 76).rotate((0, 90, 0)).translate((-28, 0, 38))
    cab = rounded_box(36, 44, 60, 2, (-46, 0, 14)) - box(14, 60, 20, (-46, 0, 46))
    frame = box(118, 40, 12, (-4, 0, 10))
    wheels = joined(
        *[
            cylinder(11, 7).rotate((90, 0, 0)).translate((x, 20 * s + 3.5, 11))
            for x in (-48, -14, 18, 44)
            for s in (-1, 1)
        ]
    )
    return joined(boiler, cab, frame, wheels, cylinder(6, 34, (36, 0, 50), 9), ball(8, (8, 0, 56)))


@world_shape("toy", 260)
def abacus(rng: np.random.Generator) -> Manifold:
    """Wooden frame on two cross feet, with beads on wires."""
    frame = joined(*[box(8, 16, 150, (90 * s, 0, 6)) for s in (-1, 1)], box(188, 16, 8, (0, 0, 150)))
    feet = joined(*[rounded_box(14, 80, 10, 2, (90 * s, 0, 0)) for s in (-1, 1)])
    rows = []
    for row in range(5):
        z = 30 + 25 * row
        rows.append(rod([[-92, 0, z], [92, 0, z]], 1.5, 10))
        rows += [ball(10, (x, 0, z), (0.8, 1, 1)) for x in rng.permutation(np.arange(-72, 73, 18.0))[:6]]
    return joined(frame, feet, *rows)


@world_shape("toy", 21)
def domino(rng: np.random.Generator) -> Manifold:
    return rounded_box(24, 7.5, 48, 0.8)
