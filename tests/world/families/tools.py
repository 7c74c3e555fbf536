"""Workshop tools: steel with plastic or wooden handles."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import Built, made_of, with_insert, world_shape
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
    superellipse,
)


def _lying(solid: Manifold) -> Manifold:
    """Upright solid laid down along x."""
    return solid.rotate((0, 90, 0))


@world_shape("tool", 665)
def hammer(rng: np.random.Generator) -> Built:
    head = (
        _lying(cylinder(13, 28)).translate((20, 0, 0))
        + box(50, 22, 22, (0, 0, -11))
        + Manifold.batch_hull([box(4, 22, 22, (-26, 0, -11)), box(2, 26, 3, (-62, 0, -16))])
    )
    handle = prism(superellipse(15, 10, 2.5), 250).translate((0, 0, -250)) + prism(
        superellipse(17, 12.5, 2.5), 90
    ).translate((0, 0, -300))
    return made_of(("head", 0.72, head.rotate((90, 0, 0))), ("handle", 0.28, handle.rotate((90, 0, 0))))


@world_shape("tool", 580)
def mallet(rng: np.random.Generator) -> Built:
    """Rubber mallet as it stands: on its head, the handle upwards."""
    head = _lying(lathe([(0, 0), (27, 0), (30, 3), (30, 82), (27, 85), (0, 85)], 1.5)).translate(
        (-42.5, 0, 30)
    )
    return made_of(
        ("head", 0.75, head), ("handle", 0.25, rod([[0, 0, 40], [0, 0, 180], [0, 0, 320]], [10, 12, 14]))
    )


@world_shape("tool", 97)
def screwdriver(rng: np.random.Generator) -> Built:
    angle = 2 * np.pi * np.arange(96) / 96
    flutes = 15 - 1.6 * np.maximum(np.cos(6 * angle), 0)
    grip = prism(np.column_stack([flutes * np.cos(angle), flutes * np.sin(angle)]), 92) + lathe(
        [(0, 90), (14, 90), (9, 106), (10, 112), (0, 112)], 2
    )
    blade = cylinder(3, 100, (0, 0, 110)) + Manifold.batch_hull(
        [cylinder(3, 1, (0, 0, 205)), box(7, 1, 1, (0, 0, 222))]
    )
    return made_of(("grip", 0.45, _lying(grip)), ("blade", 0.55, _lying(blade)))


@world_shape("tool", 98)
def phillips_screwdriver(rng: np.random.Generator) -> Built:
    """Screwdriver whose grip is triangular, so that it does not roll."""
    angle = np.radians([90, 210, 330])
    grip = prism(20 * np.column_stack([np.cos(angle), np.sin(angle)]), 100, 7) + cylinder(9, 12, (0, 0, 98))
    blade = cylinder(3, 90, (0, 0, 108)) + cylinder(3, 7, (0, 0, 198), 0.8)
    return made_of(("grip", 0.5, _lying(grip)), ("blade", 0.5, _lying(blade)))


@world_shape("tool", 252)
def adjustable_wrench(rng: np.random.Generator) -> Manifold:
    handle = (
        chamfered(rounded_rectangle(160, 22, 8), 8, 2)
        - prism(superellipse(55, 6, 4), 20).translate((0, 0, 5.5))
        - prism(superellipse(6, 6), 30).translate((-70, 0, -5))
    )
    head = prism(
        [
            (60, -16),
            (95, -26),
            (125, -22),
            (125, -10),
            (100, -8),
            (100, 8),
            (118, 12),
            (114, 26),
            (90, 24),
            (60, 12),
        ],
        12,
        2,
    ).translate((0, 0, -2))
    worm = cylinder(6, 14).rotate((0, 90, 0)).translate((80, 2, 4))
    return joined(handle, head, worm)


@world_shape("tool", 160)
def combination_wrench(rng: np.random.Generator) -> Manifold:
    angle = np.radians(np.arange(0, 360, 60))
    ring = (
        (
            cylinder(15, 11)
            - prism(9.8 * np.column_stack([np.cos(angle), np.sin(angle)]), 30).translate((0, 0, -5))
        )
        .rotate((0, -6, 0))
        .translate((95, 0, -1))
    )
    jaw = chamfered(superellipse(17, 18), 8, 1).translate((-90, 0, 0)) - box(40, 17, 30, (-112, 0, -5))
    shank = rounded_box(175, 11, 6, 2.2, (0, 0, 1))
    return shank - cylinder(9.8, 80, (95, 0, -30)) + ring + jaw


def _jaw(side: int) -> Manifold:
    """Half of a pair of pliers, jaw and lever; `side` is 1 for the half with its jaw at +y, else -1."""
    nose = Manifold.batch_hull([box(8, 9, 10, (0, 6 * side, 0)), box(2, 3, 6, (62, 1.6 * side, 2))])
    lever = rod(
        [[0, -6 * side, 5], [-40, -20 * side, 5], [-90, -26 * side, 5], [-135, -22 * side, 5]], [6, 6, 7, 7]
    )
    return nose + lever


@world_shape("tool", 245)
def pliers(rng: np.random.Generator) -> Built:
    hinge = cylinder(13, 12, (0, 0, -1)) + cylinder(6, 14, (0, 0, -2))
    metal = _jaw(1) + _jaw(-1) + hinge
    grips = joined(
        *[rod([[-45, -21 * s, 5], [-90, -26 * s, 5], [-138, -22 * s, 5]], [8, 9, 8.5]) for s in (-1, 1)]
    )
    return made_of(("metal", 0.85, metal), ("grips", 0.15, grips))


@world_shape("tool", 82)
def scissors(rng: np.random.Generator) -> Built:
    def half(side: int) -> tuple[Manifold, Manifold]:
        blade = (
            prism([(-12, -6), (85, -1.5), (88, 0), (0, 8), (-14, 4)], 2.2)
            .scale((1, side, 1))
            .translate((0, 0, 2.2 * (side > 0) + 3))
        )
        turn = np.radians(np.linspace(0, 360, 21))
        loop = rod(
            np.column_stack(
                [-62 + 26 * np.cos(turn), -19 * side + 15 * np.sin(turn), np.full(21, 5.5)]
            ).tolist(),
            5.0,
            12,
        )
        arm = rod([[-8, 0, 5.5], [-38, -9 * side, 5.5]], [4.5, 5])
        return blade, loop + arm

    (blade_a, ring_a), (blade_b, ring_b) = half(1), half(-1)
    return made_of(
        ("blades", 0.6, blade_a + blade_b + cylinder(4, 7, (0, 0, 2))), ("rings", 0.4, ring_a + ring_b)
    )


@world_shape("tool", 895)
def power_drill(rng: np.random.Generator) -> Built:
    """Cordless drill on its battery: motor body, chuck, leaning grip."""
    battery = rounded_box(112, 72, 48, 5, (4, 0, 0))
    grip = Manifold.batch_hull(
        [rounded_box(48, 36, 20, 8, (0, 0, 44)), rounded_box(50, 40, 20, 8, (16, 0, 132))]
    )
    motor = _lying(lathe([(0, 0), (27, 0), (31, 12), (31, 92), (26, 112), (22, 124), (0, 124)], 3)).translate(
        (-42, 0, 165)
    )
    chuck = _lying(lathe([(0, 0), (20, 0), (20, 26), (12, 44), (0, 44)], 1.5)).translate((80, 0, 165))
    guard = rod([[52, 0, 136], [50, 0, 110], [30, 0, 96]], 5)
    return made_of(
        ("battery", 0.45, battery),
        ("grip", 0.1, grip + guard),
        ("motor", 0.33, motor),
        ("chuck", 0.12, chuck),
    )


@world_shape("tool", 208)
def padlock(rng: np.random.Generator) -> Built:
    body = chamfered(rounded_rectangle(48, 27, 6), 52, 1.5)
    bow = (
        [[14.5, 0, 40], [14.5, 0, 70]]
        + [[14.5 * np.cos(a), 0, 70 + 14.5 * np.sin(a)] for a in np.radians(np.linspace(15, 165, 9))]
        + [[-14.5, 0, 70], [-14.5, 0, 40]]
    )
    return made_of(("body", 0.85, body), ("shackle", 0.15, rod(bow, 4)))


@world_shape("tool", 15.8)
def marker_pen(rng: np.random.Generator) -> Built:
    pen = lathe([(0, 0), (7, 0), (9, 2), (9, 78), (9.6, 79), (9.6, 118), (6, 121), (0, 121)], 0.5)
    return made_of(("pen", 1.0, _lying(pen + box(3, 2.5, 30, (0, 10, 84)))))


@world_shape("tool", 125)
def spring_clamp(rng: np.random.Generator) -> Manifold:
    """Clamp with two levers that spread from a coil, and pivoting pads."""
    arms = []
    for s in (-1, 1):
        arms.append(rod([[-62, 24 * s, 9], [-8, 9 * s, 9], [35, 17 * s, 9], [62, 8 * s, 9]], [7, 8, 6, 4]))
        arms.append(rounded_box(16, 7, 16, 2.5, (62, 5 * s, 1)))
    return joined(*arms, cylinder(11, 20, (-4, 0, -1)))


@world_shape("tool", 1060)
def c_clamp(rng: np.random.Generator) -> Built:
    """G-shaped cast frame, screw with a T handle and a swivel pad."""
    frame = prism(
        [(-50, -60), (50, -60), (50, -38), (-26, -38), (-26, 38), (50, 38), (50, 60), (-50, 60)], 22, 8
    )
    screw = (
        rod([[36, -78, 11], [36, 20, 11]], 6)
        + cylinder(13, 5).rotate((-90, 0, 0)).translate((36, 18, 11))
        + rod([[8, -72, 11], [64, -72, 11]], 3.5)
    )
    return made_of(("frame", 0.75, frame), ("screw", 0.25, screw))


@world_shape("tool", 310)
def tape_measure(rng: np.random.Generator) -> Built:
    case = (
        prism([(-36, 0), (36, 0), (36, 40), (22, 66), (-22, 70), (-36, 54)], 36, 9)
        .rotate((90, 0, 0))
        .translate((0, 18, 0))
    )
    hook = box(6, 18, 12, (37, 0, 2))
    belt = rounded_box(22, 5, 44, 2, (0, 20, 14))
    return with_insert(case + hook + belt, 0.55, cylinder(27, 24).rotate((90, 0, 0)).translate((0, 12, 36)))


@world_shape("tool", 270)
def spirit_level(rng: np.random.Generator) -> Manifold:
    bar = box(230, 22, 45)
    for x in (-75, 0, 75):
        bar -= prism(superellipse(19, 13, 3), 60).rotate((90, 0, 0)).translate((x, 30, 24))
    return bar


@world_shape("tool", 190)
def flashlight(rng: np.random.Generator) -> Built:
    body = lathe(
        [(0, 0), (15, 0), (17, 2), (17, 96), (15, 100), (25, 118), (27, 122), (27, 140), (24, 142), (0, 139)],
        1,
    )
    button = ball(6, (17, 0, 78), (0.6, 1, 1.5))
    return with_insert(body + button, 0.5, cylinder(13, 70, (0, 0, 8)))


@world_shape("tool", 420)
def glue_gun(rng: np.random.Generator) -> Built:
    """Hot glue gun with nozzle, trigger and a folding wire stand."""
    body = (
        rounded_box(130, 32, 46, 10, (0, 0, 92))
        + cylinder(12, 30).rotate((0, 90, 0)).translate((62, 0, 116))
        + cylinder(7, 22, (0, 0, 0), 2).rotate((0, 90, 0)).translate((90, 0, 116))
    )
    grip = Manifold.batch_hull(
        [rounded_box(40, 30, 20, 8, (-38, 0, 88)), rounded_box(38, 28, 14, 6, (-58, 0, 2))]
    )
    stand = rod([[40, -14, 96], [58, -32, 3], [58, 32, 3], [40, 14, 96]], 3)
    return with_insert(joined(body, grip, stand), 0.3, box(60, 20, 24, (15, 0, 104)))


@world_shape("tool", 85)
def putty_knife(rng: np.random.Generator) -> Built:
    blade = Manifold.batch_hull([box(2, 30, 1.6, (0, 0, 6)), box(2, 80, 1.0, (85, 0, 3))])
    return made_of(("blade", 0.45, blade), ("grip", 0.55, rounded_box(105, 28, 17, 7, (-50, 0, 0))))


@world_shape("tool", 45)
def allen_key(rng: np.random.Generator) -> Manifold:
    angle = np.radians(60 * np.arange(6))
    hexagon = 4 * np.column_stack([np.cos(angle), np.sin(angle)]) / np.cos(np.radians(30))
    long, short = prism(hexagon, 100), prism(hexagon, 36)
    return _lying(long) + short.rotate((90, 0, 90)).translate((4, 0, 0)) + ball(4.5, (0, 0, 0))


@world_shape("tool", 180)
def chisel(rng: np.random.Generator) -> Built:
    blade = Manifold.batch_hull([box(110, 25, 3.5, (60, 0, 6)), box(130, 25, 0.5, (70, 0, 6))]) + cylinder(
        6, 25
    ).rotate((0, 90, 0)).translate((-15, 0, 9))
    return made_of(
        ("blade", 0.6, blade),
        (
            "grip",
            0.4,
            _lying(lathe([(0, 0), (13, 0), (15, 20), (12, 95), (15, 118), (0, 122)], 3))
            .rotate((0, 0, 180))
            .translate((-10, 0, 9)),
        ),
    )


@world_shape("tool", 145)
def hex_bolt(rng: np.random.Generator) -> Manifold:
    """M20 bolt with chamfered head, standing on it, and a nut that is turned on."""
    angle = np.radians(60 * np.arange(6))
    hexagon = np.column_stack([np.cos(angle), np.sin(angle)])
    head = prism(17.3 * hexagon, 12.5) ^ lathe([(0, 0), (14.5, 0), (18, 3), (18, 12.5), (0, 12.5)])
    return head + cylinder(9.2, 88, (0, 0, 12)) + prism(17.3 * hexagon, 16).translate((0, 0, 58))


@world_shape("tool", 64)
def utility_knife(rng: np.random.Generator) -> Manifold:
    case = chamfered(superellipse(75, 13, 3), 18, 5)
    return case + box(24, 14, 1, (80, 0, 9)) + rounded_box(14, 7, 8, 2, (20, 0, 15))


@world_shape("tool", 460)
def hand_plane(rng: np.random.Generator) -> Built:
    """Bench plane: iron sole with cheeks, a wedge iron, knob and tote."""
    sole = box(190, 52, 5) + box(110, 4, 26, (-10, 24, 4)) + box(110, 4, 26, (-10, -24, 4))
    iron = box(90, 44, 5).rotate((0, -45, 0)).translate((-10, 0, 34))
    wood = lathe([(0, 4), (14, 4), (10, 16), (17, 34), (12, 46), (0, 48)], 3).translate((72, 0, 0)) + rod(
        [[-60, 0, 12], [-72, 0, 45], [-62, 0, 78]], [12, 11, 12]
    )
    return made_of(("iron", 0.85, (sole + iron).trim_by_plane((0, 0, 1), 0)), ("wood", 0.15, wood))
