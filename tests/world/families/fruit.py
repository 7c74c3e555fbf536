"""Fruit and vegetables: bodies without a flat face, dimpled, bent or lopsided."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from tests.world.shapes import world_shape
from tests.world.solids import Array, ball, bent, lathe, rod, smooth_loft, superellipse, tube, warped


@world_shape("fruit", 66)
def banana(rng: np.random.Generator) -> Manifold:
    x = np.linspace(-95, 95, 40)
    half = np.interp(x, [-95, -85, -60, 0, 60, 80, 95], [5, 7, 15, 18, 15, 6, 5])
    angle = 2 * np.pi * np.arange(30) / 30
    ridge = 1 + 0.05 * np.cos(5 * angle)
    rings = [
        np.column_stack([np.full(30, p), r * ridge * np.cos(angle), r * ridge * np.sin(angle)])
        for p, r in zip(x, half, strict=True)
    ]
    return bent(tube(rings), 130, 6)


def _pome(radius: float, height: float, dimple: float, lobes: int, depth: float) -> Manifold:
    """Apple-like body: dimples at both ends, lobes around."""
    t = np.linspace(0, np.pi, 40)
    r = radius * np.sin(t) * (1 + 0.12 * np.cos(t))
    z = -height / 2 * np.cos(t) + dimple * np.cos(t) * np.exp(-((r / (0.35 * radius)) ** 2))
    solid = lathe(list(zip(r, z, strict=True)), segments=80)

    def lobed(points: Array) -> Array:
        angle, low = np.arctan2(points[:, 1], points[:, 0]), points[:, 2] < 0
        points = points.copy()
        points[:, 2] += np.where(
            low, depth * np.cos(lobes * angle) * np.hypot(points[:, 0], points[:, 1]) / radius, 0
        )
        return points

    return warped(solid, lobed, 3)


@world_shape("fruit", 68)
def apple(rng: np.random.Generator) -> Manifold:
    return _pome(37, 66, 9, 5, 2.0) + rod([[0, 0, 20], [1, 0, 32], [4, 0, 42]], 1.5, 10)


@world_shape("fruit", 49)
def pear(rng: np.random.Generator) -> Manifold:
    body = lathe(
        [(0, 4), (8, 2), (18, 0.5), (30, 8), (34, 24), (30, 44), (18, 64), (15, 78), (8, 88), (0, 89)], 8
    )
    return body + rod([[0, 0, 85], [3, 0, 100]], 1.5, 10)


@world_shape("fruit", 29)
def lemon(rng: np.random.Generator) -> Manifold:
    return lathe(
        [(0, -34), (4, -32), (12, -26), (24, -12), (26, 0), (24, 12), (12, 25), (5, 32), (0, 36)], 5
    ).rotate((0, 90, 0))


@world_shape("fruit", 47)
def orange(rng: np.random.Generator) -> Manifold:
    return _pome(36, 70, 2.5, 7, 0.4)


@world_shape("fruit", 33)
def peach(rng: np.random.Generator) -> Manifold:
    groove = rod([[34 * np.cos(a), 0, 34 * np.sin(a)] for a in np.radians(np.linspace(-80, 95, 15))], 2.5)
    return _pome(30, 57, 6, 1, 1.0) - groove


@world_shape("fruit", 18)
def strawberry(rng: np.random.Generator) -> Manifold:
    return lathe([(0, 0), (6, 2), (16, 18), (21, 33), (18, 43), (8, 46), (0, 43)], 4)


@world_shape("fruit", 210)
def potato(rng: np.random.Generator) -> Manifold:
    """Lumpy ellipsoid: random waves of low order."""
    waves, phases = rng.normal(0, 0.045, (12, 3)), rng.uniform(0, 2 * np.pi, 12)
    sizes = rng.normal(0, 1.6, 12)

    def lumpy(points: Array) -> Array:
        out = points / np.linalg.norm(points, axis=1)[:, None]
        return points + (np.sin(points @ waves.T + phases) @ sizes)[:, None] * out

    return warped(ball(1, (0, 0, 0), (52, 37, 31)), lumpy, 3)


@world_shape("fruit", 340)
def bell_pepper(rng: np.random.Generator) -> Manifold:
    """Four-lobed pepper that stands on its lobes, with a stalk."""
    body = _pome(42, 92, 14, 4, 6.0)
    return body + rod([[0, 0, 28], [2, 0, 48], [8, 0, 60]], [6, 4, 5])


@world_shape("fruit", 95)
def carrot(rng: np.random.Generator) -> Manifold:
    return lathe([(0, 0), (2, 1), (9, 40), (15, 110), (17, 150), (12, 160), (0, 156)], 3).rotate((0, 92, 0))


@world_shape("fruit", 160)
def avocado_half(rng: np.random.Generator) -> Manifold:
    """Half fruit on its cut, with the stone's hollow below."""
    whole = smooth_loft([-36, -20, 0, 20, 36], [8, 38, 55, 38, 8], [8, 30, 38, 30, 8], 2.0)
    return whole.trim_by_plane((0, 0, 1), 0) - ball(17, (12, 0, 0))


@world_shape("fruit", 60)
def egg(rng: np.random.Generator) -> Manifold:
    t = np.linspace(0, np.pi, 40)
    return lathe(
        list(zip(21.5 * np.sin(t) * (1 - 0.13 * np.cos(np.pi - t)), -28 * np.cos(t), strict=True))
    ).rotate((0, 90, 0))


@world_shape("fruit", 900)
def pumpkin(rng: np.random.Generator) -> Manifold:
    angle = 2 * np.pi * np.arange(120) / 120
    ribs = 1 - 0.07 * np.abs(np.cos(5 * angle))
    rings = []
    for t in np.linspace(0.12, np.pi - 0.12, 36):
        r, z = 65 * np.sin(t) ** 0.8, -46 * np.cos(t) + 12 * np.cos(t) * np.exp(-((np.sin(t) / 0.4) ** 2))
        rings.append(np.column_stack([r * ribs * np.cos(angle), r * ribs * np.sin(angle), np.full(120, z)]))
    return tube(rings) + rod([[0, 0, 25], [3, 0, 50], [12, 0, 62]], [9, 6, 7])


@world_shape("fruit", 130)
def cucumber_piece(rng: np.random.Generator) -> Manifold:
    """Piece of a cucumber with two flat cut faces that are not quite parallel."""
    piece = tube(
        [np.column_stack([np.full(64, x), superellipse(21, 20, 2, 64)]) for x in np.linspace(-50, 50, 30)]
    )
    return bent(piece, 320, 4).trim_by_plane((-1, 0, 0), -48).trim_by_plane((0.98, 0.0, 0.2), -46)
