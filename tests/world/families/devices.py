"""Electric devices: plastic cases with batteries and boards inside."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import Built, made_of, with_insert, world_shape
from tests.world.solids import (
    arc,
    ball,
    box,
    chamfered,
    cylinder,
    joined,
    lathe,
    loft,
    prism,
    rod,
    rounded_box,
    rounded_rectangle,
    smooth_loft,
    superellipse,
    tube,
)


@world_shape("device", 110)
def remote_control(rng: np.random.Generator) -> Built:
    """Long case with a curved underside and rows of keys; two cells near one end."""
    rings = []
    for x in np.linspace(-95, 95, 30):
        outline = superellipse(22 - 3 * (x / 95) ** 2, 10 + 2 * x / 95, 4)
        rings.append(np.column_stack([np.full(96, x), outline[:, 0], outline[:, 1] + 2 * (x / 95) ** 2]))
    keys = joined(
        *[
            rounded_box(8, 7, 5, 1, (-70 + 14 * i, 12 * j, 5 + 2 * (-70 + 14 * i) / 95))
            for i in range(8)
            for j in (-1, 0, 1)
        ]
    )
    return with_insert(tube(rings) + keys, 0.42, box(52, 26, 10, (55, 0, -5)), 0.3)


@world_shape("device", 187)
def phone(rng: np.random.Generator) -> Built:
    """Slab with round edges and a camera bump on the back, on which it lies."""
    slab = chamfered(rounded_rectangle(72, 148, 10), 8, 2.5)
    bump = chamfered(rounded_rectangle(28, 30, 6), 3, 0.8).translate((-18, 54, -2))
    return with_insert(slab + bump, 0.35, box(55, 80, 5, (0, -15, 1.5)))


@world_shape("device", 99)
def computer_mouse(rng: np.random.Generator) -> Built:
    """Arched shell with concave flanks on four skates."""
    z = np.linspace(0, 38, 24)
    shell = loft(
        [
            (
                h,
                superellipse(
                    58 * np.sqrt(max(1 - (h / 40) ** 2.2, 0.02)),
                    (31 - 5 * np.sin(np.pi * h / 38)) * np.sqrt(max(1 - (h / 42) ** 2.5, 0.02)),
                    2.3,
                )
                + np.array([-4 * h / 38, 0]),
            )
            for h in z
        ]
    )
    skates = joined(
        *[
            chamfered(superellipse(7, 4), 1.4, 0.3).translate((40 * a, 17 * b, -0.8))
            for a in (-1, 1)
            for b in (-1, 1)
        ]
    )
    wheel = cylinder(10, 6).rotate((90, 0, 0)).translate((28, 3, 27))
    return with_insert(joined(shell, skates, wheel), 0.3, box(30, 16, 14, (-25, 0, 2)), 0.4)


@world_shape("device", 560)
def loudspeaker(rng: np.random.Generator) -> Built:
    cabinet = rounded_box(120, 140, 200, 6) - cylinder(40, 10, (0, 0, 0), 42).rotate((0, 90, 0)).translate(
        (54, 0, 75)
    )
    return with_insert(
        cabinet + ball(18, (44, 0, 75)), 0.45, cylinder(30, 35).rotate((0, 90, 0)).translate((18, 0, 75)), 0.4
    )


@world_shape("device", 640)
def camera(rng: np.random.Generator) -> Built:
    body = chamfered(rounded_rectangle(128, 55, 18), 88, 4) + Manifold.batch_hull(
        [box(50, 40, 2, (0, 2, 84)), box(32, 28, 2, (0, 2, 108))]
    )
    lens = (
        lathe([(0, 0), (33, 0), (33, 30), (36, 32), (36, 62), (30, 62), (27, 55), (0, 52)], 0.8)
        .rotate((90, 0, 0))
        .translate((4, -24, 44))
    )
    grip = rounded_box(24, 28, 80, 9, (-56, -24, 4))
    return made_of(("body", 0.62, body + grip + cylinder(9, 6, (-46, 0, 87))), ("lens", 0.38, lens))


@world_shape("device", 240)
def router(rng: np.random.Generator) -> Built:
    """Flat case on four feet with two upright aerials behind."""
    case = chamfered(rounded_rectangle(190, 120, 12), 28, 4).translate((0, 0, 3))
    feet = joined(*[cylinder(6, 4, (80 * a, 45 * b, 0), 7) for a in (-1, 1) for b in (-1, 1)])
    aerials = joined(*[rounded_box(14, 8, 130, 3.5, (70 * a, 62, 12)) for a in (-1, 1)])
    return made_of(("case", 0.85, case), ("feet", 0.01, feet), ("aerials", 0.14, aerials))


@world_shape("furniture", 890)
def desk_lamp(rng: np.random.Generator) -> Built:
    """Round heavy foot, a two-part arm, a conical shade."""
    foot = lathe([(0, 1), (58, 1), (60, 0), (66, 0), (66, 8), (60, 16), (0, 18)], 1)
    arm = rod([[-20, 0, 12], [-50, 0, 150], [30, 0, 270]], [6, 6, 5])
    shade = (lathe([(0, 0), (18, 0), (52, 60), (49, 60), (16, 4), (0, 4)]).rotate((0, 150, 0))).translate(
        (34, 0, 276)
    )
    return made_of(("foot", 0.68, foot), ("arm", 0.17, arm), ("shade", 0.15, shade))


@world_shape("device", 310)
def alarm_clock(rng: np.random.Generator) -> Built:
    """Twin-bell clock on two splayed feet and the case's back."""
    case = cylinder(50, 45).rotate((90, 0, 0)).translate((0, 22, 66))
    feet = joined(
        *[rod([[24 * s, -12, 28], [38 * s, -16, 5]], [5, 5]) for s in (-1, 1)],
        rod([[0, 14, 26], [0, 24, 5]], 5),
    )
    bells = joined(
        *[ball(22, (28 * s, 0, 118), (1, 1, 0.6)).trim_by_plane((0, 0, 1), 112) for s in (-1, 1)],
        rod([[24, 0, 104], [28, 0, 114]], 4),
        rod([[-24, 0, 104], [-28, 0, 114]], 4),
    )
    grip = rod(arc((0, 116), 34, 20, 160), 3)
    return with_insert(joined(case, feet, bells, grip), 0.35, box(40, 26, 40, (0, 4, 40)))


@world_shape("device", 220)
def game_pad(rng: np.random.Generator) -> Built:
    middle = chamfered(rounded_rectangle(110, 60, 22), 30, 8).translate((0, 0, 14))
    horns = joined(
        *[rod([[50 * s, 0, 28], [62 * s, -38, 20], [66 * s, -62, 12]], [20, 17, 12]) for s in (-1, 1)]
    )
    sticks = joined(
        *[cylinder(7, 16, (28 * s, -10, 40)) + cylinder(10, 5, (28 * s, -10, 54)) for s in (-1, 1)]
    )
    return with_insert(joined(middle, horns, sticks), 0.25, box(44, 30, 12, (0, 0, 20)), 0.3)


@world_shape("device", 130)
def electric_toothbrush(rng: np.random.Generator) -> Built:
    """Slim handle with a flat end, a neck and a brush head at the side."""
    body = lathe(
        [
            (0, 0.5),
            (9, 0.5),
            (10, 0),
            (12, 0),
            (13.5, 3),
            (14.5, 60),
            (12, 140),
            (5, 158),
            (4, 215),
            (0, 217),
        ],
        1.2,
    )
    head = ball(1, (0, 0, 220), (7, 9, 13)) + box(10, 9, 12, (8, 0, 214))
    return with_insert(body + head, 0.4, cylinder(8, 55, (0, 0, 45)))


@world_shape("device", 520)
def hair_dryer(rng: np.random.Generator) -> Built:
    barrel = (
        lathe([(0, 0), (32, 0), (38, 12), (38, 90), (28, 165), (24, 190), (0, 190)], 2)
        .rotate((0, 90, 0))
        .translate((-60, 0, 150))
    )
    grip = Manifold.batch_hull([ball(19, (5, 0, 130)), ball(15, (-6, 0, 18))])
    return with_insert(barrel + grip, 0.4, cylinder(24, 50).rotate((0, 90, 0)).translate((-40, 0, 150)), 0.3)


@world_shape("device", 72)
def charger(rng: np.random.Generator) -> Built:
    """Plug charger: block with a round two-pin plug."""
    block = rounded_box(44, 30, 58, 4)
    pins = joined(*[rod([[9.5 * s, 12, 40], [9.5 * s, 36, 40]], 2) for s in (-1, 1)])
    return made_of(
        (
            "block",
            0.92,
            block + Manifold.batch_hull([box(34, 1, 14, (0, 14, 33)), box(30, 1, 10, (0, 20, 35))]),
        ),
        ("pins", 0.08, pins),
    )


@world_shape("device", 165)
def calculator(rng: np.random.Generator) -> Built:
    """Wedge-shaped desk calculator with keys."""
    wedge = Manifold.batch_hull(
        [rounded_box(100, 4, 8, 1.8, (0, -68, 0)), rounded_box(100, 4, 28, 1.8, (0, 68, 0))]
    )
    keys = joined(
        *[
            rounded_box(13, 10, 6, 1.2, (-38 + 19 * i, -54 + 16 * j, 5 + 2.3 * j))
            for i in range(5)
            for j in range(5)
        ]
    )
    return with_insert(wedge + keys, 0.25, box(30, 14, 12, (20, 50, 3)), 0.3)


@world_shape("device", 340)
def stapler(rng: np.random.Generator) -> Built:
    base = rounded_box(140, 34, 10, 3)
    arm = Manifold.batch_hull(
        [rounded_box(30, 32, 30, 5, (-52, 0, 12)), rounded_box(20, 28, 14, 4, (55, 0, 34))]
    )
    magazine = box(128, 18, 8, (2, 0, 20)).rotate((0, -4, 0))
    hinge = box(16, 20, 20, (-52, 0, 5))
    return made_of(("steel", 0.7, joined(base, magazine, hinge)), ("arm", 0.3, arm))


@world_shape("device", 410)
def tape_dispenser(rng: np.random.Generator) -> Built:
    """Desk dispenser: weighted base, a slot for the roll, a serrated nose."""
    side = [(-65, 0), (70, 0), (74, 18), (62, 34), (30, 26), (-10, 22), (-40, 40), (-62, 44)]
    body = prism(side, 48, 6).rotate((90, 0, 0)).translate((0, 24, 0)) - box(86, 24, 40, (-6, 0, 10))
    roll = (cylinder(32, 19) - cylinder(13, 30, (0, 0, -5))).rotate((90, 0, 0)).translate((-12, 9.5, 45))
    hub = rod([[-12, -21, 45], [-12, 21, 45]], 6) + box(14, 46, 30, (-12, 0, 18))
    return made_of(("base", 0.86, body), ("roll", 0.14, roll + hub))


@world_shape("device", 180)
def webcam(rng: np.random.Generator) -> Built:
    """Camera bar on a ball joint over a folding clip."""
    bar = rounded_box(95, 30, 28, 10, (0, 0, 62)) + cylinder(10, 5).rotate((90, 0, 0)).translate((0, -14, 76))
    clip = box(46, 60, 6, (0, 10, 0)) + box(46, 6, 26, (0, -20, 0))
    return with_insert(joined(bar, clip, rod([[0, 0, 4], [0, 0, 66]], 7)), 0.3, box(60, 15, 16, (0, 0, 68)))


@world_shape("device", 250)
def headphones(rng: np.random.Generator) -> Built:
    """Headband with two ear cups, as they stand: on the cups."""
    band = rod(arc((0, 92), 82, 0, 180, 25), 6).scale((1, 2.0, 1))
    cups = joined(
        *[
            cylinder(36, 26).rotate((0, 90, 0)).scale((1, 0.85, 1.1)).translate((80 * s - 13, 0, 46))
            for s in (-1, 1)
        ]
    )
    stems = joined(*[rod([[82 * s, 0, 92], [82 * s, 0, 50]], 6) for s in (-1, 1)])
    return made_of(("cups", 0.7, cups), ("band", 0.3, band + stems))


@world_shape("device", 95)
def shaver(rng: np.random.Generator) -> Built:
    body = smooth_loft([0, 2, 50, 110, 130], [17, 19, 23, 21, 18], [12, 14, 16, 18, 20], 2.6)
    head = Manifold.batch_hull([ball(11, (a, b, 138)) for a, b in ((14, 6), (-14, 6), (0, -16))])
    return with_insert(body + head, 0.35, cylinder(7, 50, (0, 0, 30)))


@world_shape("device", 1150)
def iron(rng: np.random.Generator) -> Built:
    """Clothes iron on its boat-shaped sole, with a looped handle."""
    sole = [(-75, -55), (30, -55), (85, -25), (125, 0), (85, 25), (30, 55), (-75, 55)]
    plate = prism(sole, 10, 14)
    body = Manifold.batch_hull(
        [prism(np.array(sole) * 0.95, 30, 12).translate((0, 0, 9)), rounded_box(110, 60, 10, 4, (-10, 0, 70))]
    )
    handle = rod([[60, 0, 70], [50, 0, 125], [-50, 0, 128], [-66, 0, 60]], [13, 14, 15, 15])
    return made_of(("sole", 0.5, plate), ("body", 0.35, body), ("handle", 0.15, handle))
