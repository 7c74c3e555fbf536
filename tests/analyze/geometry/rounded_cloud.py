"""Noisy point clouds of boxes whose edges are rounded, some more than others; for tests."""

from __future__ import annotations

import numpy as np


def rounded_box_cloud(
    size: tuple[float, float, float],
    radius: float,
    noise: float,
    count: int,
    seed: int,
    vertical_radius: float | None = None,
) -> np.ndarray:
    """Points (count, 3) [m] on a box centred on the origin, with noise across its surface.

    Horizontal edges have `radius` [m], edges along z `vertical_radius`, or the same if it is None.
    """
    rng = np.random.default_rng(seed)
    half = np.array(size) / 2
    upright = radius if vertical_radius is None else vertical_radius
    found: list[np.ndarray] = []
    while sum(map(len, found)) < count:
        # Directions of rays that lead to a surface with points in proportion to its area, roughly.
        axis = rng.choice(3, count, p=_face_shares(half))
        points = rng.uniform(-1, 1, (count, 3)) * half
        points[np.arange(count), axis] = half[axis] * rng.choice([-1, 1], count)
        found.append(_onto_rounding(points, half, radius, upright))
    points = np.vstack(found)[:count]
    return points + rng.normal(0, noise, points.shape)


def _face_shares(half: np.ndarray) -> np.ndarray:
    areas = np.array([half[1] * half[2], half[0] * half[2], half[0] * half[1]])
    return areas / areas.sum()


def _onto_rounding(points: np.ndarray, half: np.ndarray, radius: float, upright: float) -> np.ndarray:
    """Project points of a sharp box on one with rounded edges; corners are left out."""
    moved = points.copy()
    corner = np.zeros(len(points), dtype=bool)
    beyond = np.abs(points) > half - max(radius, upright)
    corner = beyond.all(axis=1)
    for one, other, rho in ((0, 1, upright), (0, 2, radius), (1, 2, radius)):
        pair = [one, other]
        out = np.abs(points[:, pair]) - (half[pair] - rho)
        both = (out > 0).all(axis=1)
        length = np.linalg.norm(out[both], axis=1, keepdims=True)
        arc = np.sign(points[both][:, pair]) * (half[pair] - rho + rho * out[both] / length)
        moved[np.ix_(both, pair)] = arc
    return moved[~corner]
