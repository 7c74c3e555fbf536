"""Deterministic, evenly spread points on a triangulated surface, and triangles cut into small pieces."""

from __future__ import annotations

import numpy as np

from analyze.types import Array, IntArray

ROOT = 1.32471795724474602596
"""Real root of x^3 = x + 1, which defines the R2 low-discrepancy sequence."""


def even_samples(vertices: Array, faces: IntArray, count: int) -> tuple[Array, IntArray]:
    """Points at equal steps of a surface's area, with the face that each lies on.

    A face's share of the points follows its area; within it they follow the R2 sequence (Roberts 2018).

    Args:
        vertices: (v, 3) vertices [m].
        faces: (f, 3) faces.
        count: Number n of points.

    Returns:
        Points (n, 3) [m], and the index (n,) of the face that each lies on.
    """
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    border = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.cross(b - a, c - a), axis=1))])
    at = (np.arange(count) + 0.5) / count * border[-1]
    owner: IntArray = np.minimum(
        np.asarray(np.searchsorted(border, at, side="right"), dtype=np.int64) - 1, len(faces) - 1
    )
    u, v = (np.outer(np.arange(count), [1 / ROOT, 1 / ROOT**2]) % 1).T
    folded = u + v > 1
    u, v = np.where(folded, 1 - u, u), np.where(folded, 1 - v, v)
    return a[owner] + u[:, None] * (b - a)[owner] + v[:, None] * (c - a)[owner], owner


def bisected(triangles: Array, longest: float, rounds: float = np.inf) -> tuple[Array, IntArray]:
    """Triangles cut into pieces by halving their longest edges until none exceeds `longest` [m].

    Args:
        triangles: (n, 3, 3) corners of the triangles [m]; the second index is the corner.
        longest: Largest length of an edge [m].
        rounds: Largest number of times that a triangle and its pieces are halved; edges may stay longer then.

    Returns:
        Triangles (m, 3, 3) [m], and the index (m,) in `triangles` of the one that each is a piece of.
    """
    owner = np.arange(len(triangles))
    done: list[Array] = []
    owners: list[IntArray] = []
    while len(triangles) and rounds > 0:
        sides = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        long = sides.max(axis=1) > longest
        done.append(triangles[~long])
        owners.append(owner[~long])
        start = np.argmax(sides[long], axis=1)
        a, b, c = (triangles[long][np.arange(len(start)), (start + i) % 3] for i in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
        owner = np.tile(owner[long], 2)
        rounds -= 1
    return np.concatenate([*done, triangles]), np.concatenate([*owners, owner])
