"""Packages: boxes, cartons, bags of a grocery's shelf."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import Built, filled, made_of, world_shape
from tests.world.solids import (
    box,
    chamfered,
    cylinder,
    loft,
    prism,
    rounded_box,
    rounded_rectangle,
    smooth_loft,
    superellipse,
)


@world_shape("food", 411)
def cracker_box(rng: np.random.Generator) -> Built:
    return filled(rounded_box(158, 60, 210, 0.8), 0.15, 0.75)


@world_shape("food", 514)
def sugar_box(rng: np.random.Generator) -> Built:
    return filled(chamfered(rounded_rectangle(89, 38, 4), 175, 2.0), 0.06, 0.9)


@world_shape("food", 187)
def pudding_box(rng: np.random.Generator) -> Built:
    return filled(rounded_box(110, 35, 89, 0.6), 0.12, 0.85)


@world_shape("food", 97)
def gelatin_box(rng: np.random.Generator) -> Built:
    return filled(rounded_box(85, 28, 73, 0.6), 0.15, 0.8)


@world_shape("food", 1040)
def milk_carton(rng: np.random.Generator) -> Built:
    """Gable-topped carton: the roof's faces meet in a fin."""
    body = rounded_box(70, 70, 195, 1)
    roof = Manifold.hull_points(
        np.array(
            [[a * 35, b * 35, 194] for a in (-1, 1) for b in (-1, 1)] + [[a * 35, 0, 232.0] for a in (-1, 1)]
        )
    )
    solid = (
        body
        + roof
        + box(70, 2.5, 20, (0, 0, 228))
        + cylinder(14, 10, (0, 0, 0)).rotate((45, 0, 0)).translate((0, -18, 208))
    )
    return filled(solid, 0.03, 0.8)


@world_shape("food", 215)
def drink_brick(rng: np.random.Generator) -> Built:
    """Brick of 200 ml with a fold on top and ears at the sides."""
    body = chamfered(rounded_rectangle(48, 38, 2), 118, 1.0)
    ears = box(1.2, 20, 26, (24, 0, 88)) + box(1.2, 20, 26, (-24, 0, 88))
    return filled(body + ears + box(48, 1.2, 4, (0, 0, 117)), 0.04, 0.93)


@world_shape("container", 120)
def tissue_box(rng: np.random.Generator) -> Built:
    solid = rounded_box(225, 115, 75, 1) - prism(superellipse(75, 22, 2.5), 60).translate((0, 0, 30))
    return filled(solid, 0.3, 0.9)


@world_shape("container", 12)
def matchbox(rng: np.random.Generator) -> Built:
    """Sleeve with a tray that is pushed out a little."""
    sleeve = box(53, 36, 14)
    return filled(sleeve + box(50, 34, 12, (4, 0, 1)), 0.5, 0.6)


@world_shape("food", 500)
def bread_loaf(rng: np.random.Generator) -> Manifold:
    """Tin loaf: flat base with soft corners, sides that widen, a domed top."""
    return smooth_loft([0, 4, 60, 85, 104], [118, 123, 130, 124, 60], [44, 49, 56, 50, 18], 4.5)


@world_shape("food", 340)
def coffee_bag(rng: np.random.Generator) -> Built:
    """Vacuum brick with a folded top and dented sides."""
    z = np.linspace(0, 185, 30)
    dent = 1 - 0.05 * np.exp(-(((z - 90) / 40) ** 2))
    fade = np.where(z > 150, 1 - (z - 150) / 35 * 0.85, 1.0)
    foot = np.where(z < 4, 1 - 0.02 * (4 - z), 1.0)
    return filled(
        loft(
            [
                (h, superellipse(42 * d * f, 29 * d * f * k, 6))
                for h, d, k, f in zip(z, dent, fade, foot, strict=True)
            ]
        ),
        0.05,
        0.85,
    )


@world_shape("toy", 28)
def foam_brick(rng: np.random.Generator) -> Manifold:
    return rounded_box(78, 52, 51, 1.2)


@world_shape("kitchen", 6.2)
def sponge(rng: np.random.Generator) -> Built:
    """Dish sponge with a waist and a denser scouring layer."""
    x = np.linspace(-1, 1, 40)
    half = 33 - 4 * np.exp(-((x / 0.45) ** 2))
    outline = np.vstack([np.column_stack([52 * x, -half]), np.column_stack([52 * x[::-1], half[::-1]])])
    foam, pad = prism(outline, 22, 4).translate((0, 0, 7)), prism(outline, 7, 4)
    return made_of(("foam", 0.55, foam), ("pad", 0.45, pad))


@world_shape("kitchen", 95)
def soap_bar(rng: np.random.Generator) -> Manifold:
    """Pillow of an oval plan, curved on both broad sides."""
    return smooth_loft([0, 3, 13, 23, 26], [22, 34, 43, 34, 22], [14, 22, 29, 22, 14], 2.5)


@world_shape("toy", 729)
def wood_block(rng: np.random.Generator) -> Manifold:
    return rounded_box(86, 86, 205, 2.0)


@world_shape("furniture", 640)
def book(rng: np.random.Generator) -> Manifold:
    """Hardcover: boards that stand out over the pages, a rounded spine."""
    boards = box(150, 215, 2.5) + box(150, 215, 2.5, (0, 0, 32))
    pages = box(143, 208, 30, (-1, 0, 2.4))
    spine = cylinder(17.25, 215).scale((0.35, 1, 1)).rotate((-90, 0, 0)).translate((-75, -107.5, 17.25))
    return boards + pages + spine


@world_shape("food", 370)
def potted_meat_can(rng: np.random.Generator) -> Built:
    """Tapered tin with rounded corners and a rim at the base, whose middle is recessed."""
    wall = loft(
        [
            (z, rounded_rectangle(x, y, 17))
            for z, x, y in (
                (0, 99, 56),
                (3, 99, 56),
                (3.4, 97, 54),
                (78, 94, 51),
                (78.5, 96, 53),
                (82, 96, 53),
            )
        ]
    )
    base = prism(rounded_rectangle(95, 52, 15), 2.0)
    lid = prism(rounded_rectangle(92, 49, 14), 3.0).translate((0, 0, 80))
    return filled(wall - base - lid, 0.16)


@world_shape("container", 160)
def lunch_box(rng: np.random.Generator) -> Built:
    """Tapered box with a lid that stands out, and two clips."""
    body = Manifold.hull_points(
        np.vstack(
            [
                np.column_stack([rounded_rectangle(x, y, r), np.full(36, z)])
                for z, x, y, r in ((0, 150, 95, 14), (2, 154, 99, 16), (55, 164, 109, 18))
            ]
        )
    )
    lid = chamfered(rounded_rectangle(172, 117, 20), 14, 2.5).translate((0, 0, 52))
    clips = box(4, 34, 26, (86, 0, 38)) + box(4, 34, 26, (-86, 0, 38))
    return filled(body + lid + clips, 0.9)


@world_shape("container", 92)
def egg_carton(rng: np.random.Generator) -> Built:
    """Ten cups whose rounded ends are the feet, under a flat lid."""
    cups = [cylinder(14, 34, (32 * i - 64, 50 * j - 25, 0), 22.5) for i in range(5) for j in range(2)]
    lid = chamfered(rounded_rectangle(168, 106, 10), 36, 6).translate((0, 0, 32))
    solid = lid
    for cup in cups:
        solid += cup
    return filled(solid, 0.8)
