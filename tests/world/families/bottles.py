"""Bottles: lofted waists, handles, pumps, triggers, feet of a petaloid base."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import Built, filled, world_shape
from tests.world.solids import (
    arc,
    ball,
    box,
    chamfered,
    cylinder,
    lathe,
    loft,
    prism,
    rod,
    rounded_box,
    rounded_rectangle,
    smooth_loft,
    superellipse,
)


@world_shape("food", 603)
def mustard_bottle(rng: np.random.Generator) -> Built:
    body = smooth_loft(
        [0, 3, 30, 80, 118, 135, 150], [43, 46, 48, 44, 47, 40, 15], [25, 28, 29, 27, 29, 25, 15], 2.6
    )
    cap = cylinder(17, 20, (0, 0, 146), 14) + cylinder(8, 26, (0, 0, 165), 3)
    return filled(body + cap, 0.1, 0.75)


@world_shape("container", 1131)
def bleach_bottle(rng: np.random.Generator) -> Built:
    """Jug with a handle through a hole, a neck at one side and a flat base with a soft corner."""
    body = smooth_loft([0, 4, 120, 170, 215], [48, 51, 51, 45, 18], [30, 33, 33, 30, 16], 3.0)
    hole = prism(superellipse(15, 32), 100).rotate((90, 0, 0)).translate((24, 50, 158))
    neck = lathe([(0, 0), (15, 0), (15, 30), (19, 30), (19, 52), (0, 52)], 1.0).translate((-6, 0, 200))
    handle = rod([[30, 0, 110], [47, 0, 140], [44, 0, 185], [10, 0, 212]], 10)
    return filled((body - hole) + neck + handle, 0.1, 0.6, body)


@world_shape("container", 540)
def shampoo_bottle(rng: np.random.Generator) -> Built:
    body = smooth_loft([0, 2.5, 40, 110, 160, 178], [30, 33, 35, 33, 24, 12], [16, 18, 20, 19, 15, 11], 2.2)
    return filled(body + chamfered(superellipse(17, 13), 26, 1.5).translate((0, 0, 172)), 0.1, 0.8)


@world_shape("container", 560)
def ketchup_bottle(rng: np.random.Generator) -> Built:
    """Squeezy bottle that stands on its wide cap."""
    cap = chamfered(superellipse(31, 24, 2.6), 30, 1.5)
    body = smooth_loft([28, 40, 80, 150, 178, 186], [24, 33, 39, 35, 24, 10], [18, 24, 27, 25, 18, 8], 2.3)
    return filled(cap + body, 0.12, 0.85)


@world_shape("container", 520)
def water_bottle(rng: np.random.Generator) -> Built:
    """Half-litre bottle on a base of five feet, with ribs, neck and cap."""
    ribs = [(31.5 - 1.2 * (i % 2), 40 + 8 * i) for i in range(12)]
    body = lathe(
        [(0, 16), (24, 16), (31.5, 30), *ribs, (31.5, 140), (26, 165), (13, 186), (12.5, 205), (0, 205)], 1.0
    )
    cap = lathe([(0, 192), (15, 192), (15, 208), (0, 208)], 0.8)
    feet = [
        Manifold.batch_hull(
            [
                ball(4.5, (21 * np.cos(a), 21 * np.sin(a), 4.5)),
                ball(7, (23 * np.cos(a), 23 * np.sin(a), 24)),
                ball(6, (4 * np.cos(a), 4 * np.sin(a), 22)),
            ]
        )
        for a in 2 * np.pi * np.arange(5) / 5
    ]
    solid = body + cap
    for foot in feet:
        solid += foot
    return filled(solid, 0.05, 0.85)


@world_shape("container", 1200)
def wine_bottle(rng: np.random.Generator) -> Built:
    punt = [(0, 28), (8, 25), (16, 17), (24, 5), (29, 0)]
    wall = [
        (34, 0),
        (37, 3),
        (37.5, 180),
        (33, 205),
        (17, 235),
        (14, 300),
        (15.5, 301),
        (15.5, 310),
        (0, 310),
    ]
    return filled(lathe([*punt, *wall], 2.0), 0.4, 0.75)


@world_shape("container", 690)
def trigger_spray(rng: np.random.Generator) -> Built:
    """Cleaner's bottle with an oval, waisted body and a trigger head that reaches out at one side."""
    body = smooth_loft([0, 3, 60, 120, 150, 185], [43, 46, 46, 38, 36, 14], [27, 30, 30, 26, 24, 14], 2.5)
    head = (
        rounded_box(86, 22, 26, 4, (-14, 0, 214))
        + cylinder(14, 40, (0, 0, 180))
        + cylinder(6, 10).rotate((0, -90, 0)).translate((-55, 0, 228))
    )
    trigger = rod([[-30, 0, 214], [-36, 0, 198], [-33, 0, 182], [-26, 0, 170]], [6, 5, 4.5, 4])
    return filled(body + head + trigger, 0.16, 0.55)


@world_shape("container", 410)
def soap_pump(rng: np.random.Generator) -> Built:
    """Square bottle with a pump whose spout reaches out."""
    body = chamfered(rounded_rectangle(62, 62, 12), 118, 3)
    pump = (
        cylinder(16, 16, (0, 0, 116))
        + cylinder(5, 40, (0, 0, 130))
        + rod([[0, 0, 166], [34, 0, 164], [40, 0, 158]], [8, 5, 4])
    )
    return filled(body + pump, 0.2, 0.7)


@world_shape("container", 260)
def perfume_flask(rng: np.random.Generator) -> Built:
    """Thick glass block with bevelled edges and a metal cap."""
    return filled(
        chamfered(rounded_rectangle(58, 30, 2), 72, 3.0)
        + cylinder(7, 8, (0, 0, 71))
        + chamfered(rounded_rectangle(24, 24, 1.5), 30, 1).translate((0, 0, 78)),
        0.75,
        0.8,
    )


@world_shape("container", 250)
def hot_sauce(rng: np.random.Generator) -> Built:
    return filled(
        lathe(
            [
                (0, 1.5),
                (16, 1),
                (19, 0),
                (21, 0),
                (23.5, 2.5),
                (23.5, 85),
                (12, 112),
                (12, 150),
                (14, 150),
                (14, 172),
                (0, 172),
            ],
            1.5,
        ),
        0.45,
        0.6,
    )


@world_shape("container", 430)
def dish_soap(rng: np.random.Generator) -> Built:
    """Leaning, asymmetric flask: its sections drift sideways as they rise."""
    z = np.linspace(0, 190, 40)
    width = np.interp(z, [0, 4, 60, 120, 170, 190], [36, 40, 42, 33, 16, 13])
    depth = np.interp(z, [0, 4, 60, 120, 170, 190], [20, 24, 26, 22, 14, 13])
    drift = 8 * np.sin(np.pi * z / 190)
    body = loft(
        [
            (h, superellipse(a, b, 2.4) + np.array([d, 0]))
            for h, a, b, d in zip(z, width, depth, drift, strict=True)
        ]
    )
    return filled(body + cylinder(14, 26, (0, 0, 188), 10), 0.12, 0.65)


@world_shape("container", 380)
def oil_can(rng: np.random.Generator) -> Built:
    """Cone-shouldered can with a long curved spout and a handle."""
    can = lathe([(0, 1), (42, 1), (43, 0), (45, 0), (45, 70), (10, 95), (6, 110), (0, 110)], 0.8)
    spout = rod([[0, 0, 100], [10, 0, 130], [40, 0, 165], [85, 0, 190]], [5, 4, 3, 2.2])
    handle = rod(arc((-44, 48), 22, 60, 300), 4)
    return filled(can + spout + handle, 0.4, 0.4)


@world_shape("container", 95)
def glue_bottle(rng: np.random.Generator) -> Built:
    """Flat bottle with shoulders and a twisted cone as its tip."""
    body = chamfered(rounded_rectangle(58, 27, 10), 105, 4) + cylinder(12, 18, (0, 0, 100), 10)
    return filled(body + cylinder(9, 34, (0, 0, 116), 2) - box(80, 1.5, 60, (0, 14, 20)), 0.2, 0.8)
