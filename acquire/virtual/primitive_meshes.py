"""Triangle meshes of the primitives, box and cylinder, with normals outward."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_CYLINDER_SEGMENTS = 96
"""number of corners of the polygons that stand for a cylinder's rims"""


def box_mesh(half: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (8, 3) and triangles (12, 3) of a box about the origin, with half edge lengths `half` (3,)."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    faces = [
        (0, 1, 3),
        (0, 3, 2),
        (4, 6, 7),
        (4, 7, 5),
        (0, 4, 5),
        (0, 5, 1),
        (2, 3, 7),
        (2, 7, 6),
        (0, 2, 6),
        (0, 6, 4),
        (1, 5, 7),
        (1, 7, 3),
    ]
    return corners, np.array(faces)


def cylinder_mesh(radius: float, half_height: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (n, 3) and triangles (m, 3) of a cylinder about z, centred on the origin [any length].

    Polygons with 96 corners stand for its rims.
    """
    n = _CYLINDER_SEGMENTS
    angle = np.arange(n) * (2 * np.pi / n)
    rim = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low = np.column_stack([rim, np.full(n, -half_height)])
    high = np.column_stack([rim, np.full(n, half_height)])
    i = np.arange(n)
    j = (i + 1) % n
    sides = [np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])]
    centre_low, centre_high = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    caps = [np.column_stack([centre_low, j, i]), np.column_stack([centre_high, i + n, j + n])]
    centres = np.array([[0, 0, -half_height], [0, 0, half_height]])
    return np.concatenate([low, high, centres]), np.concatenate(sides + caps)
