"""Shoes, bags, and things that stand about a room or a doll's house."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import Built, filled, made_of, world_shape
from tests.world.solids import (
    Array,
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
    superellipse,
    warped,
)


def _sole(length: float, ball_: float, heel: float, inset: float = 0.0) -> Array:
    """Outline of a right shoe's sole along x, wider at the ball of the foot and curved inwards."""
    x = np.linspace(-1, 1, 50)
    half = np.interp(
        x, [-1, -0.9, -0.6, -0.1, 0.4, 0.8, 0.95, 1], [0.12, 0.6, 0.98, 0.8, 1.0, 0.8, 0.42, 0.1]
    )
    width = np.interp(x, [-1, 0.4, 1], [heel, ball_, ball_]) / 2
    bow = 7 * np.sin(1.5 * x + 0.4)
    half = np.maximum(half * width - inset, 0.5)
    upper = np.column_stack([x * (length / 2 - inset), bow + half])
    lower = np.column_stack([x * (length / 2 - inset), bow - half])
    return np.vstack([lower, upper[::-1]])


@world_shape("clothing", 310)
def shoe(rng: np.random.Generator) -> Built:
    """Low shoe: sole with toe spring, upper with an opening."""

    def spring(points: Array) -> Array:
        points = points.copy()
        points[:, 2] += (
            12 * np.clip((points[:, 0] - 50) / 90, 0, 1) ** 2
            + 4 * np.clip((-points[:, 0] - 105) / 35, 0, 1) ** 2
        )
        return points

    outline = _sole(280, 100, 70)
    sole = warped(prism(outline, 22), spring, 8)
    sections = []
    for z, back, front, wide in (
        (12, 0.0, 0.0, 1.0),
        (40, 0.0, 26, 0.95),
        (60, 4, 95, 0.85),
        (80, 6, 150, 0.7),
        (95, 8, 175, 0.62),
    ):
        ring = _sole(270, 94, 66).copy()
        share = (ring[:, 0] + 135) / 270
        ring[:, 0] = -135 + back + share * (270 - back - front)
        ring[:, 1] *= wide
        sections.append((z, ring))
    upper = warped(loft(sections), spring, 8)
    hollow = prism(superellipse(48, 24, 2.5), 90).translate((-78, -3, 34))
    return made_of(("sole", 0.55, sole), ("upper", 0.45, upper - hollow))


@world_shape("clothing", 340)
def boot(rng: np.random.Generator) -> Built:
    """Ankle boot with a separate heel: the sole bridges between heel and ball."""
    heel = prism(_sole(270, 96, 70), 26).trim_by_plane((-1, 0, 0), 60)
    tread = prism(_sole(270, 96, 70), 12).trim_by_plane((1, 0, 0), 5)
    bridge = prism(_sole(270, 96, 70, 3), 14).translate((0, 0, 12))
    foot = Manifold.batch_hull(
        [
            prism(_sole(262, 90, 66), 20).translate((0, 0, 24)),
            prism(superellipse(45, 32), 10).translate((-80, 0, 90)),
            ball(24, (92, 2, 50)),
        ]
    )
    shaft = Manifold.batch_hull(
        [
            prism(superellipse(46, 34), 10).translate((-80, 0, 80)),
            prism(superellipse(52, 38), 4).translate((-78, 0, 180)),
        ]
    )
    hollow = Manifold.batch_hull(
        [
            prism(superellipse(42, 30), 4).translate((-80, 0, 70)),
            prism(superellipse(48, 34), 4).translate((-78, 0, 190)),
        ]
    )
    return made_of(("sole", 0.55, heel + tread + bridge), ("upper", 0.45, (foot + shaft) - hollow))


@world_shape("clothing", 290)
def high_heel(rng: np.random.Generator) -> Manifold:
    """Pump: stands on the front sole and a thin stiletto."""

    def raised(points: Array) -> Array:
        points = points.copy()
        points[:, 2] += 75 / (1 + np.exp((points[:, 0] + 20) / 22.0)) - 75 / (1 + np.exp(150 / 22.0))
        points[:, 2] += 5 * np.clip((points[:, 0] - 70) / 50, 0, 1) ** 2
        return points

    sole = warped(prism(_sole(230, 78, 50), 6), raised, 6)
    toe = warped(
        Manifold.batch_hull(
            [
                prism(_sole(228, 76, 48), 5).translate((0, 0, 3)).trim_by_plane((1, 0, 0), 45),
                ball(16, (70, 0, 24)),
            ]
        ),
        raised,
        6,
    )
    cup = warped(
        prism(_sole(228, 76, 48), 42).trim_by_plane((-1, 0, 0), 55)
        - prism(_sole(222, 70, 42, 2), 60).trim_by_plane((-1, 0, 0), 56).translate((0, 0, 5)),
        raised,
        6,
    )
    stiletto = Manifold.batch_hull([cylinder(14, 2, (-88, -6, 70)), cylinder(5, 2, (-96, -6, 0))])
    return joined(sole, toe, cup, stiletto)


@world_shape("clothing", 150)
def sandal(rng: np.random.Generator) -> Manifold:
    sole = prism(_sole(250, 92, 64), 18)
    turn = np.radians(np.linspace(0, 180, 15))
    straps = joined(
        *[
            rod(np.column_stack([np.full(15, x), 3 + w * np.cos(turn), 12 + h * np.sin(turn)]).tolist(), 4)
            for x, w, h in ((45, 42, 45), (20, 42, 55), (-70, 32, 70))
        ]
    )
    return sole + straps.trim_by_plane((0, 0, 1), 1)


@world_shape("clothing", 95)
def glasses_case(rng: np.random.Generator) -> Built:
    return filled(chamfered(superellipse(80, 32, 2.6), 42, 14), 0.7)


@world_shape("clothing", 130)
def wallet(rng: np.random.Generator) -> Manifold:
    """Folded leather: thicker at the fold than at the open side."""
    return Manifold.batch_hull(
        [rounded_box(4, 92, 22, 1.9, (-54, 0, 0)), rounded_box(4, 92, 14, 1.9, (54, 0, 0))]
    )


@world_shape("furniture", 32)
def dolls_chair(rng: np.random.Generator) -> Manifold:
    """Chair with four square feet and a leaning back."""
    legs = joined(*[box(7, 7, 42, (22 * a, 20 * b, 0)) for a in (-1, 1) for b in (-1, 1)])
    seat = rounded_box(56, 52, 6, 1.5, (0, 0, 40))
    posts = joined(*[rod([[-23, 20 * s, 43], [-32, 20 * s, 98]], 3.5) for s in (-1, 1)])
    rails = joined(*[rounded_box(5, 40, 9, 1.5, (-28.5 - 2 * i, 0, 66 + 16 * i)) for i in range(2)])
    return joined(legs, seat, posts, rails)


@world_shape("furniture", 60)
def dolls_table(rng: np.random.Generator) -> Manifold:
    """Round table on a pedestal with four claw feet."""
    top = lathe([(0, 70), (55, 70), (57, 73), (55, 76), (0, 76)], 1)
    post = lathe([(0, 15), (8, 15), (5, 30), (9, 50), (5, 72), (0, 72)], 2)
    claws = joined(
        *[
            rod(
                [[0, 0, 24], [20 * np.cos(a), 20 * np.sin(a), 18], [36 * np.cos(a), 36 * np.sin(a), 4]],
                [6, 5, 4],
            )
            for a in np.radians([45, 135, 225, 315])
        ]
    )
    return joined(top, post, claws)


@world_shape("furniture", 240)
def milking_stool(rng: np.random.Generator) -> Manifold:
    """Three splayed round legs."""
    legs = joined(
        *[
            Manifold.batch_hull(
                [
                    cylinder(11, 4, (40 * np.cos(a), 40 * np.sin(a), 108)),
                    cylinder(8, 2, (62 * np.cos(a), 62 * np.sin(a), 0)),
                ]
            )
            for a in np.radians([90, 210, 330])
        ]
    )
    return legs + lathe([(0, 108), (72, 108), (75, 112), (72, 128), (60, 130), (0, 124)], 2)


@world_shape("furniture", 175)
def mini_tripod(rng: np.random.Generator) -> Built:
    """Table tripod with rubber balls as feet and a ball head."""
    legs = joined(
        *[
            rod([[8 * np.cos(a), 8 * np.sin(a), 78], [70 * np.cos(a), 70 * np.sin(a), 7]], [6, 4])
            for a in np.radians([0, 120, 240])
        ]
    )
    feet = joined(*[ball(7, (70 * np.cos(a), 70 * np.sin(a), 7)) for a in np.radians([0, 120, 240])])
    head = (
        cylinder(14, 26, (0, 0, 68))
        + ball(12, (0, 0, 100))
        + cylinder(18, 6, (0, 0, 108))
        + cylinder(3, 8, (0, 0, 114))
    )
    return made_of(
        ("legs", 0.4, legs),
        ("feet", 0.1, feet),
        ("head", 0.5, head + rod([[0, 0, 84], [-28, 0, 88]], [4, 5])),
    )


@world_shape("furniture", 560)
def plant_pot(rng: np.random.Generator) -> Manifold:
    """Clay pot with a drain hole, a band below the rim and a bevelled base."""
    return lathe(
        [(10, 0), (48, 0), (50, 3), (62, 95), (68, 96), (70, 120), (64, 120), (57, 95), (45, 9), (10, 8)], 1.2
    )


@world_shape("furniture", 360)
def picture_frame(rng: np.random.Generator) -> Manifold:
    """Frame that leans back on a strut: two edges on the table."""
    frame = (box(150, 14, 190) - box(116, 40, 156, (0, 0, 17)) + box(130, 5, 170, (0, 3, 10))).rotate(
        (-12, 0, 0)
    )
    strut = prism([(28, 118), (34, 118), (100, 0), (92, 0)], 36).rotate((90, 0, 90)).translate((-18, 0, 0))
    return (frame + strut).trim_by_plane((0, 0, 1), 0.6)


@world_shape("furniture", 24)
def clothes_peg(rng: np.random.Generator) -> Manifold:
    halves = [
        prism(
            [
                (-36, 1.2 * s + 5 * s),
                (-36, 1 * s + 9 * s),
                (0, 6.5 * s),
                (36, 4.5 * s),
                (36, 0.6 * s),
                (8, 0.6 * s),
                (0, 2.5 * s),
            ][::s],
            10,
            1,
        )
        for s in (1, -1)
    ]
    return joined(*halves, cylinder(4.5, 13, (0, 0, -1.5)))


@world_shape("furniture", 155)
def door_wedge(rng: np.random.Generator) -> Manifold:
    return Manifold.batch_hull(
        [rounded_box(4, 45, 34, 1.8, (58, 0, 0)), rounded_box(4, 45, 4, 1.8, (-58, 0, 0))]
    )


@world_shape("furniture", 520)
def book_end(rng: np.random.Generator) -> Manifold:
    """Bent steel sheet: L with a tongue cut out of the upright side."""
    foot = chamfered(rounded_rectangle(110, 130, 12), 3, 0.5)
    upright = prism(rounded_rectangle(170, 130, 14), 3).rotate((0, 90, 0)).translate((-55, 0, 85)) - box(
        20, 60, 60, (-55, 0, 10)
    )
    return foot + upright.trim_by_plane((0, 0, 1), 0)


@world_shape("furniture", 680)
def trophy(rng: np.random.Generator) -> Built:
    """Cup with two handles on a stepped square plinth of stone."""
    plinth = box(80, 80, 30) + box(62, 62, 14, (0, 0, 30))
    cup = lathe(
        [
            (0, 43),
            (18, 43),
            (7, 56),
            (6, 76),
            (14, 86),
            (38, 110),
            (45, 160),
            (42, 160),
            (35, 112),
            (12, 92),
            (0, 90),
        ],
        0.8,
    )
    handles = joined(
        *[rod([[s * x, 0, z] for x, z in ((38, 112), (62, 122), (66, 146), (44, 154))], 4) for s in (-1, 1)]
    )
    return made_of(("plinth", 0.72, plinth), ("cup", 0.28, cup + (handles - cylinder(40, 60, (0, 0, 108)))))


@world_shape("furniture", 430)
def hand_bell(rng: np.random.Generator) -> Built:
    bell = lathe(
        [
            (46, 0),
            (50, 0),
            (50, 3),
            (38, 30),
            (32, 70),
            (18, 84),
            (0, 88),
            (0, 84),
            (15, 80),
            (28, 68),
            (34, 30),
        ],
        0.8,
    )
    return made_of(
        ("bell", 0.75, bell),
        ("grip", 0.2, lathe([(0, 84), (6, 84), (13, 110), (9, 145), (12, 160), (0, 164)], 2)),
        ("clapper", 0.05, rod([[0, 0, 84], [0, 0, 20]], [2, 7])),
    )


@world_shape("furniture", 260)
def pencil_cup(rng: np.random.Generator) -> Manifold:
    """Square cup with slanting rim and inner walls."""
    outer = chamfered(rounded_rectangle(82, 82, 10), 105, 1.0)
    rooms = joined(*[box(35, 35, 110, (19 * a, 19 * b, 4)) for a in (-1, 1) for b in (-1, 1)])
    return (outer - rooms).trim_by_plane((-0.25, 0, -1), -92)


@world_shape("furniture", 1350)
def garden_gnome(rng: np.random.Generator) -> Manifold:
    """Figure on an uneven round plinth."""
    plinth = lathe([(0, 4), (36, 3), (40, 0), (46, 0), (48, 8), (40, 18), (0, 18)], 2)
    body = lathe([(0, 16), (36, 16), (40, 50), (28, 100), (0, 105)], 8)
    head, hat = ball(24, (0, 0, 112)), rod([[0, 0, 120], [-4, 0, 150], [-16, 0, 190]], [24, 16, 5])
    arms = joined(*[rod([[0, 32 * s, 88], [26, 26 * s, 60], [36, 8 * s, 62]], 9) for s in (-1, 1)])
    return joined(
        plinth,
        body,
        head,
        hat,
        arms,
        ball(1, (18, 0, 92), (14, 18, 24)),
        *[ball(1, (30, 18 * s, 14), (26, 13, 14)) for s in (-1, 1)],
    ).trim_by_plane((0, 0, 1), 0)


@world_shape("furniture", 95)
def coat_hook(rng: np.random.Generator) -> Manifold:
    plate_ = chamfered(rounded_rectangle(42, 120, 12), 5, 1)
    return (
        plate_
        + rod([[0, 20, 4], [0, 22, 40], [0, 44, 62]], [7, 6, 8])
        + rod([[0, -25, 4], [0, -30, 28], [0, -14, 44]], [6, 5, 6.5])
    )


@world_shape("furniture", 210)
def watering_can(rng: np.random.Generator) -> Manifold:
    body = prism(superellipse(62, 45, 2.5), 110) - prism(superellipse(58, 41, 2.5), 120).translate((0, 0, 4))
    spout = rod([[55, 0, 25], [110, 0, 95], [150, 0, 140]], [11, 8, 7]) + cylinder(
        7, 18, (0, 0, 0), 22
    ).rotate((0, 55, 0)).translate((148, 0, 138))
    handle = rod([[-58, 0, 30], [-105, 0, 80], [-60, 0, 150], [30, 0, 140], [55, 0, 104]], 6)
    return joined(body, spout - prism(superellipse(60, 43, 2.5), 120), handle)
