"""Cans, jars and tubs: bodies of revolution with rims, beads, punts and lids."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import Built, filled, made_of, world_shape
from tests.world.solids import ball, chamfered, cylinder, lathe, prism, rod, rounded_box, superellipse


def _tin(radius: float, height: float, rim: float = 1.6, deep: float = 3.0) -> Manifold:
    """Tin with a rim that stands out and a recessed base and lid."""
    half = [
        (0, deep), (radius - 3.5, deep), (radius - 2.2, 0), (radius, 0), (radius, 3), (radius - rim, 4),
        (radius - rim, height - 4), (radius, height - 3), (radius, height), (radius - 2.2, height),
        (radius - 3.5, height - deep), (0, height - deep),
    ]  # fmt: skip
    return lathe(half, 0.5)


@world_shape("food", 414)
def coffee_can(rng: np.random.Generator) -> Built:
    return filled(_tin(51, 139) + cylinder(52, 12, (0, 0, 129)), 0.25, 0.8)


@world_shape("food", 349)
def soup_can(rng: np.random.Generator) -> Built:
    return filled(_tin(33, 101.5), 0.13)


@world_shape("food", 171)
def tuna_can(rng: np.random.Generator) -> Built:
    return filled(_tin(42.5, 33), 0.18)


@world_shape("food", 205)
def chips_can(rng: np.random.Generator) -> Built:
    solid = lathe([(0, 2), (35, 2), (36, 0), (37.5, 0), (37.5, 240), (38.5, 240), (38.5, 250), (0, 250)], 0.6)
    return filled(solid, 0.3, 0.85)


@world_shape("food", 365)
def soda_can(rng: np.random.Generator) -> Built:
    """Necked can: it stands on a ring of 48 mm around a domed punt."""
    punt = [(0, 10), (8, 9.4), (15, 7), (20, 3.2), (22.5, 0.3)]
    wall = [
        (24, 0),
        (25.5, 0.6),
        (28, 5),
        (33, 12),
        (33, 103),
        (30, 112),
        (27, 118),
        (27, 122),
        (25, 122),
        (24.5, 119),
        (0, 119),
    ]
    return filled(lathe([*punt, *wall], 0.8), 0.04, 0.97)


@world_shape("container", 340)
def spray_paint_can(rng: np.random.Generator) -> Built:
    body = lathe(
        [
            (0, 6),
            (15, 4.5),
            (26, 1.5),
            (29, 0),
            (32, 0),
            (33, 1.5),
            (33, 3),
            (32.5, 4),
            (32.5, 150),
            (34, 151),
            (34, 154),
            (25, 164),
            (16, 168),
            (0, 168),
        ],
        0.7,
    )
    cap = lathe([(0, 160), (31, 160), (31, 196), (29, 200), (0, 200)], 1.5)
    return filled(body + cap, 0.35, 0.5)


@world_shape("container", 1250)
def paint_tin(rng: np.random.Generator) -> Built:
    """Tin with a lid in a groove, two ears and a wire handle that hangs down at one side."""
    tin = _tin(54, 125, 2.0, 4.0)
    ears = cylinder(9, 9).rotate((0, 90, 0)).translate((49, 0, 100)) + cylinder(9, 9).rotate(
        (0, -90, 0)
    ).translate((-49, 0, 100))
    angle = np.radians(np.linspace(0, 180, 15))
    wire = rod(
        np.column_stack([58 * np.cos(angle), -60 * np.sin(angle), 100 - 40 * np.sin(angle)]).tolist(), 1.6, 12
    )
    return filled(tin + ears + wire, 0.16, 0.85)


@world_shape("container", 410)
def jam_jar(rng: np.random.Generator) -> Built:
    glass = lathe(
        [(0, 2.5), (18, 1.5), (27, 0), (30, 0), (34, 4), (34, 76), (27, 88), (27, 96), (0, 96)], 2.5
    )
    return filled(glass + lathe([(0, 86), (31, 86), (31, 100), (0, 100)], 1.2), 0.45, 0.85)


@world_shape("container", 480)
def honey_jar(rng: np.random.Generator) -> Built:
    """Hexagonal jar with a round lid."""
    angle = np.radians(60 * np.arange(6))
    hexagon = np.column_stack([38 * np.cos(angle), 38 * np.sin(angle)])
    body = chamfered(hexagon, 72, 3.0) - ball(60, (0, 0, -58.0))
    return filled(
        body + cylinder(24, 8, (0, 0, 70)) + lathe([(0, 76), (27, 76), (27, 92), (0, 92)], 1.0), 0.35, 0.75
    )


@world_shape("container", 38)
def pill_bottle(rng: np.random.Generator) -> Built:
    body = lathe([(0, 1), (16, 0.8), (17, 0), (19, 0), (20.5, 1.5), (20.5, 52), (17, 56), (0, 56)], 0.8)
    return filled(body + lathe([(0, 54), (22, 54), (22, 72), (20.5, 73.5), (0, 73.5)], 0.6), 0.5, 0.5)


@world_shape("container", 320)
def thermos(rng: np.random.Generator) -> Built:
    steel = lathe([(0, 1.5), (30, 1.5), (31.5, 0), (34, 0), (35, 1), (35, 190), (27, 215), (0, 215)], 1.0)
    cup = lathe([(0, 205), (29, 205), (29, 250), (26, 256), (0, 256)], 2.0)
    return filled(steel + cup, 0.8)


@world_shape("container", 260)
def candle_glass(rng: np.random.Generator) -> Built:
    glass = lathe([(0, 0), (34, 0), (37, 3), (40, 90), (37, 90), (34.5, 8), (0, 8)], 1.0)
    wax = lathe([(0, 8), (34.5, 8), (36.5, 62), (0, 62)])
    return made_of(("glass", 0.62, glass), ("wax", 0.38, wax))


@world_shape("container", 118)
def tape_roll(rng: np.random.Generator) -> Manifold:
    return cylinder(50, 48) - cylinder(38, 60, (0, 0, -5))


@world_shape("container", 130)
def toilet_roll(rng: np.random.Generator) -> Manifold:
    return lathe([(21, 0), (54, 0), (54, 98), (21, 98)], 3.0)


@world_shape("container", 210)
def yoghurt_tub(rng: np.random.Generator) -> Built:
    """Tapered cup with a narrow base ring, a wide rim and a foil lid."""
    cup = lathe(
        [(0, 3), (22, 3), (24, 0), (26.5, 0), (27.5, 2), (33, 78), (37.5, 78), (37.5, 80.5), (0, 80.5)], 0.5
    )
    return filled(cup, 0.06, 0.93)


@world_shape("container", 900)
def wine_cooler(rng: np.random.Generator) -> Manifold:
    """Open beaker with a thick wall, faceted by sixteen sides."""
    angle = 2 * np.pi * np.arange(16) / 16
    sides = np.column_stack([np.cos(angle), np.sin(angle)])
    return prism(58 * sides, 190) - prism(52 * sides, 190).translate((0, 0, 6))


@world_shape("container", 75)
def shoe_polish_tin(rng: np.random.Generator) -> Built:
    """Flat round tin with a butterfly lever at its side."""
    tin = lathe(
        [
            (0, 1),
            (31, 1),
            (32, 0),
            (35, 0),
            (36, 1),
            (36, 9),
            (37, 9),
            (37, 20),
            (36, 21),
            (33, 21),
            (32, 20),
            (0, 20),
        ],
        0.4,
    )
    return filled(tin + rounded_box(8, 14, 3, 1, (40, 0, 8)), 0.4, 0.5)


@world_shape("container", 65)
def cosmetics_jar(rng: np.random.Generator) -> Built:
    """Low jar, square with soft corners below a round lid that is wider."""
    return filled(
        chamfered(superellipse(26, 26, 5), 26, 2) + lathe([(0, 24), (29, 24), (29, 40), (0, 40)], 1.0),
        0.5,
        0.5,
    )
