"""Crockery, pans and cutlery."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import Built, made_of, with_insert, world_shape
from tests.world.solids import (
    ball,
    bent,
    box,
    chamfered,
    cylinder,
    joined,
    lathe,
    loft,
    prism,
    rod,
    rounded_box,
    superellipse,
    tube,
)


def _handle(centre: tuple[float, float], tall: float, wide: float, radius: float) -> Manifold:
    return rod(
        [
            [centre[0] + wide * np.cos(a), 0, centre[1] + tall * np.sin(a)]
            for a in np.radians(np.linspace(-105, 105, 13))
        ],
        radius,
    )


@world_shape("kitchen", 330)
def mug(rng: np.random.Generator) -> Manifold:
    """Mug on a narrow foot ring, with a handle."""
    outer = lathe([(0, 2), (27, 2), (29, 0), (33, 0), (39, 6), (40, 92), (0, 92)], 1.5)
    return (outer + _handle((38, 48), 28, 24, 5.5)) - lathe(
        [(0, 7), (33, 7), (36, 12), (36.5, 100), (0, 100)], 3
    )


@world_shape("kitchen", 118)
def ycb_mug(rng: np.random.Generator) -> Manifold:
    """Straight enamel mug whose base is rounded to the table, with a thin handle."""
    outer = lathe([(0, 0), (40, 0), (46, 5), (46.5, 81), (0, 81)], 5)
    return (outer + _handle((45, 42), 26, 24, 4)) - lathe([(0, 2), (42, 2), (44, 6), (44.5, 90), (0, 90)], 4)


@world_shape("kitchen", 180)
def tea_cup(rng: np.random.Generator) -> Manifold:
    """Hemispherical cup on a foot ring."""
    outer = lathe([(0, 3), (18, 3), (19, 0), (22, 0), (23, 4), (36, 20), (43, 42), (46, 60), (0, 60)], 1)
    inner = lathe([(0, 7), (20, 8), (33, 22), (40, 42), (43, 62), (0, 62)], 2)
    return (outer + _handle((42, 36), 15, 20, 3.5)) - inner


@world_shape("kitchen", 147)
def bowl(rng: np.random.Generator) -> Manifold:
    outer = lathe([(0, 3), (35, 3), (37, 0), (41, 0), (43, 4), (62, 22), (75, 44), (80, 55), (0, 55)], 1)
    return outer - lathe([(0, 7), (38, 8), (59, 24), (72, 46), (77, 58), (0, 58)], 2)


@world_shape("kitchen", 279)
def plate(rng: np.random.Generator) -> Manifold:
    return lathe(
        [(0, 3), (78, 3), (80, 0), (84, 0), (92, 5), (130, 22), (130, 25), (90, 10), (78, 7), (0, 7)], 0.8
    )


@world_shape("kitchen", 165)
def wine_glass(rng: np.random.Generator) -> Manifold:
    return lathe(
        [(0, 2), (20, 1.2), (34, 0), (35, 1), (20, 4), (6, 9), (3.5, 20), (3.5, 90), (8, 97), (30, 115),
         (37, 150), (30, 205), (28.6, 205), (35.5, 150), (29, 116.5), (6, 99), (0, 98)], 0.4
    )  # fmt: skip


@world_shape("kitchen", 285)
def tumbler(rng: np.random.Generator) -> Manifold:
    return lathe(
        [(0, 1.5), (28, 1.5), (30, 0), (33, 0), (34, 2), (39, 125), (36.5, 125), (31, 14), (0, 12)], 0.8
    )


@world_shape("kitchen", 178)
def pitcher(rng: np.random.Generator) -> Manifold:
    """Tall plastic jug with a spout, a large handle and a soft base."""
    outer = lathe([(0, 1), (44, 1), (47, 0), (50, 2), (54, 235), (0, 235)], 2)
    spout = Manifold.batch_hull(
        [ball(4, (-62, 0, 230)), cylinder(30, 2, (-22, 0, 205)), cylinder(40, 2, (-14, 0, 233))]
    )
    inner = lathe([(0, 4), (47, 4), (51, 300), (0, 300)], 3)
    hollow = Manifold.batch_hull(
        [ball(2, (-58, 0, 240)), cylinder(26, 2, (-21, 0, 212)), cylinder(37, 8, (-14, 0, 236))]
    )
    return (outer + spout + _handle((52, 140), 70, 42, 7)) - inner - hollow


@world_shape("kitchen", 720)
def tea_pot(rng: np.random.Generator) -> Built:
    """Round-bellied pot on a foot ring, with spout, handle, lid and knob."""
    belly = lathe(
        [(0, 4), (32, 4), (34, 0), (40, 0), (42, 5), (62, 30), (68, 58), (58, 88), (38, 104), (0, 106)], 2
    )
    hollow = lathe([(0, 10), (38, 10), (57, 32), (62, 58), (53, 85), (34, 99), (0, 100)], 4)
    spout = rod([[50, 0, 35], [78, 0, 50], [92, 0, 80], [106, 0, 98]], [15, 11, 8, 6.5])
    handle = _handle((-55, 58), 34, -42, 6)
    lid = lathe([(0, 100), (37, 100), (36, 106), (14, 116), (0, 117)], 1) + ball(10, (0, 0, 124))
    return made_of(("pot", 0.87, (belly + spout + handle) - hollow), ("lid", 0.13, lid))


@world_shape("kitchen", 850)
def moka_pot(rng: np.random.Generator) -> Built:
    """Eight-sided boiler, waist, jug with spout, plastic handle."""
    angle = np.radians(45 * np.arange(8) + 22.5)
    octagon = np.column_stack([np.cos(angle), np.sin(angle)])
    boiler = loft([(0, 50 * octagon), (2, 52 * octagon), (70, 40 * octagon)])
    jug = loft([(76, 40 * octagon), (160, 50 * octagon)])
    lid = loft([(160, 50 * octagon), (178, 12 * octagon)]) + ball(7, (0, 0, 184))
    spout = Manifold.batch_hull([ball(3, (62, 0, 156)), box(4, 30, 40, (42, 0, 118))])
    metal = boiler + cylinder(38, 10, (0, 0, 68)) + jug + lid + spout
    handle = rod([[-44, 0, 150], [-78, 0, 152], [-84, 0, 120], [-76, 0, 88]], [8, 8, 8, 6])
    return made_of(("metal", 0.88, metal), ("handle", 0.12, handle))


@world_shape("kitchen", 1180)
def kettle(rng: np.random.Generator) -> Built:
    """Electric kettle: heating base, tapered can, beak, handle at the back."""
    base = lathe([(0, 0), (70, 0), (76, 4), (76, 26), (0, 26)], 3)
    can = lathe([(0, 24), (72, 24), (56, 205), (40, 220), (0, 224)], 3)
    beak = Manifold.batch_hull(
        [ball(4, (78, 0, 198)), cylinder(20, 2, (40, 0, 150)), cylinder(25, 2, (35, 0, 200))]
    )
    handle = rod([[-55, 0, 206], [-104, 0, 200], [-108, 0, 120], [-78, 0, 60]], [11, 12, 12, 10])
    return made_of(("base", 0.45, base), ("can", 0.4, can + beak), ("handle", 0.15, handle))


@world_shape("kitchen", 960)
def sauce_pan(rng: np.random.Generator) -> Built:
    pan = lathe([(0, 0), (76, 0), (82, 5), (84, 90), (87, 91), (87, 93), (82, 93), (80, 7), (0, 6)], 1.5)
    handle = rod([[82, 0, 72], [130, 0, 82], [250, 0, 92]], [6, 9, 10])
    return made_of(("pan", 0.85, pan), ("handle", 0.15, handle - cylinder(79, 200)))


@world_shape("kitchen", 1300)
def frying_pan(rng: np.random.Generator) -> Built:
    pan = lathe([(0, 0), (95, 0), (102, 6), (130, 44), (127, 45), (99, 9), (95, 5), (0, 5)], 1.2)
    handle = rod([[128, 0, 40], [180, 0, 62], [310, 0, 72]], [7, 10, 11])
    return made_of(("pan", 0.82, pan), ("handle", 0.18, handle - cylinder(125, 200)))


@world_shape("kitchen", 62)
def egg_cup(rng: np.random.Generator) -> Manifold:
    return lathe(
        [
            (0, 2),
            (20, 1),
            (22, 0),
            (25, 0),
            (26, 3),
            (12, 14),
            (10, 24),
            (22, 38),
            (26, 60),
            (23, 60),
            (19, 40),
            (0, 30),
        ],
        0.8,
    )


@world_shape("kitchen", 640)
def vase(rng: np.random.Generator) -> Manifold:
    """Twisted vase with seven flutes and a hollow that follows them."""
    z = np.linspace(0, 180, 50)
    angle = 2 * np.pi * np.arange(140) / 140

    def rings(shrink: float, low: float) -> Manifold:
        sections = []
        for h in z[z >= low]:
            r = (34 + 14 * np.sin(np.pi * h / 180) - shrink) * (1 + 0.06 * np.cos(7 * (angle + h / 150)))
            sections.append(
                (
                    h + (0.5 if shrink and h > 179 else 0),
                    np.column_stack([r * np.cos(angle), r * np.sin(angle)]),
                )
            )
        return loft(sections)

    return rings(0, 0) - rings(5, 8)


@world_shape("kitchen", 85)
def salt_shaker(rng: np.random.Generator) -> Built:
    """Ten-sided foot, glass that narrows, domed steel cap."""
    angle = 2 * np.pi * np.arange(10) / 10
    sides = np.column_stack([np.cos(angle), np.sin(angle)])
    glass = loft([(0, 20 * sides), (1.5, 21 * sides), (50, 16 * sides)])
    return made_of(
        ("glass", 0.8, glass), ("cap", 0.2, lathe([(0, 48), (17, 48), (17, 58), (10, 66), (0, 68)], 2))
    )


@world_shape("kitchen", 330)
def pepper_mill(rng: np.random.Generator) -> Manifold:
    return lathe(
        [(0, 3), (20, 3), (22, 0), (29, 0), (29, 14), (24, 22), (19, 60), (22, 100), (26, 130), (26, 152),
         (21, 158), (27, 170), (24, 188), (12, 197), (7, 206), (0, 208)], 2.5
    )  # fmt: skip


@world_shape("kitchen", 52)
def spatula(rng: np.random.Generator) -> Manifold:
    """Slotted turner whose blade is bent off the handle."""
    blade = prism([(-40, -37), (48, -41), (48, 41), (-40, 37)], 2.5, 8)
    for y in (-22, -7, 7, 22):
        blade -= prism(superellipse(28, 4, 4), 10).translate((8, y, -2))
    handle = rod([[-38, 0, 3], [-65, 0, 22], [-120, 0, 30], [-270, 0, 38]], [4, 5, 6, 9])
    return blade + handle.trim_by_plane((0, 0, 1), 0)


@world_shape("kitchen", 34)
def fork(rng: np.random.Generator) -> Manifold:
    outline = [
        (-100, -6),
        (-60, -4),
        (20, -3),
        (45, -12),
        (100, -12),
        (100, 12),
        (45, 12),
        (20, 3),
        (-60, 4),
        (-100, 6),
    ]
    flat = prism(outline, 2.2, 3)
    for y in (-6.2, 0, 6.2):
        flat -= box(48, 2.4, 6, (78, y, -2))
    return bent(flat, 260, 6)


@world_shape("kitchen", 30)
def spoon(rng: np.random.Generator) -> Manifold:
    bowl_ = ball(1, (78, 0, 8), (30, 20, 8)).trim_by_plane((0, 0, -1), -7) - ball(
        1, (78, 0, 10.5), (28, 18.2, 8)
    )
    return bowl_ + rod([[52, 0, 6.5], [20, 0, 10], [-40, 0, 9], [-95, 0, 3]], [1.8, 2.2, 2.5, 3.0])


@world_shape("kitchen", 130)
def kitchen_knife(rng: np.random.Generator) -> Built:
    blade = (
        prism([(0, -18), (110, -16), (165, 0), (180, 14), (0, 18)], 2.2)
        .rotate((90, 0, 0))
        .translate((10, 1.1, 18))
    )
    handle = rounded_box(126, 16, 26, 6, (-46, 0, 10))
    return made_of(("blade", 0.6, blade), ("handle", 0.4, handle))


@world_shape("kitchen", 105)
def ladle(rng: np.random.Generator) -> Manifold:
    cup = ball(42, (0, 0, 42)).trim_by_plane((0, 0, -1), -34) - ball(39.5, (0, 0, 42))
    return cup + rod(
        [[-41, 0, 32], [-50, 0, 80], [-60, 0, 250], [-45, 0, 268], [-32, 0, 258]], [2.5, 3, 4, 3, 3]
    )


@world_shape("kitchen", 390)
def rolling_pin(rng: np.random.Generator) -> Manifold:
    pin = lathe(
        [
            (0, 0),
            (9, 0),
            (13, 20),
            (11, 82),
            (28, 92),
            (30, 96),
            (30, 326),
            (28, 330),
            (11, 340),
            (13, 402),
            (9, 422),
            (0, 422),
        ],
        4,
    )
    return pin.rotate((0, 90, 0))


@world_shape("kitchen", 880)
def cutting_board(rng: np.random.Generator) -> Manifold:
    return chamfered(superellipse(150, 105, 8), 20, 3) - prism(superellipse(30, 9, 3), 40).translate(
        (-115, 0, -5)
    )


@world_shape("kitchen", 46)
def peeler(rng: np.random.Generator) -> Built:
    """Y-shaped peeler with a swivelling blade."""
    grip = rod([[0, 0, 9], [-40, 0, 9], [-95, 0, 9]], [7, 8, 9])
    fork_ = rod([[0, 0, 9], [22, -26, 9], [46, -28, 9]], [6, 5, 4]) + rod(
        [[0, 0, 9], [22, 26, 9], [46, 28, 9]], [6, 5, 4]
    )
    return made_of(("grip", 0.8, grip + fork_), ("blade", 0.2, box(9, 56, 2, (45, 0, 8))))


@world_shape("kitchen", 240)
def corkscrew(rng: np.random.Generator) -> Manifold:
    """Bell corkscrew: open frame on a ring, helix inside, two levers folded down."""
    ring = lathe([(13, 0), (20, 0), (20, 12), (13, 12)], 0.8)
    posts = box(4, 8, 80, (17, 0, 8)) + box(4, 8, 80, (-17, 0, 8))
    top = cylinder(20, 10, (0, 0, 86)) + cylinder(5, 40, (0, 0, 92)) + rounded_box(62, 10, 12, 4, (0, 0, 126))
    turn = np.linspace(0, 8 * np.pi, 49)
    screw = rod(np.column_stack([4 * np.cos(turn), 4 * np.sin(turn), 90 - 2.2 * turn]).tolist(), 1.5, 10)
    levers = rod([[22, 0, 92], [36, 0, 70], [40, 0, 30]], [4, 3.5, 6]) + rod(
        [[-22, 0, 92], [-36, 0, 70], [-40, 0, 30]], [4, 3.5, 6]
    )
    return joined(ring, posts, top, screw, levers)


@world_shape("kitchen", 510)
def kitchen_scale(rng: np.random.Generator) -> Built:
    """Flat scale on four rubber feet, with a bowl plate and a battery off the middle."""
    body = chamfered(superellipse(105, 80, 5), 16, 3).translate((0, 0, 4))
    feet = joined(*[cylinder(8, 6, (a * 78, b * 54, 0), 7) for a in (-1, 1) for b in (-1, 1)])
    top = chamfered(superellipse(78, 72, 3), 4, 1).translate((0, 0, 19.5))
    return with_insert(body + feet + top, 0.2, box(48, 28, 12, (60, 20, 5)))


@world_shape("kitchen", 70)
def funnel(rng: np.random.Generator) -> Manifold:
    """Funnel as it is put down: on its wide mouth."""
    return lathe([(50, 0), (52, 0), (52, 6), (10, 52), (7, 100), (5, 100), (8, 50), (50, 6)], 0.4)


@world_shape("kitchen", 210)
def whisk(rng: np.random.Generator) -> Manifold:
    """Balloon whisk: eight wires on a handle."""
    handle = lathe([(0, 0), (9, 0), (12, 20), (8, 90), (10, 112), (0, 112)], 2)
    loops = []
    for turn in np.pi * np.arange(4) / 4:
        t = np.linspace(0, np.pi, 15)
        x, z = 30 * np.sin(2 * t), 110 + 145 * np.sin(t) ** 0.8
        loops.append(rod(np.column_stack([x * np.cos(turn), x * np.sin(turn), z]).tolist(), 1.4, 8))
    return joined(handle, *loops).rotate((0, 90, 0))


@world_shape("kitchen", 150)
def ring_cake_tin(rng: np.random.Generator) -> Manifold:
    """Fluted ring tin, open below, with a tube in the middle."""
    angle = 2 * np.pi * np.arange(160) / 160
    wave = 1 + 0.03 * np.cos(16 * angle)

    def ring(radius: float, z: float) -> np.ndarray:
        return np.column_stack(
            [radius * wave * np.cos(angle), radius * wave * np.sin(angle), np.full(160, z)]
        )

    outer = tube([ring(r, z) for r, z in ((105, 0), (104, 20), (96, 70), (75, 90))])
    inner = tube([ring(r, z) for r, z in ((102, -1), (101, 20), (93, 68), (73, 87))])
    pipe = lathe([(15, 0), (18, 0), (24, 90), (21, 90)])
    return (outer - inner + pipe) - cylinder(15, 200, (0, 0, -5), 20)
