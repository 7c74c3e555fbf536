"""Triangle meshes of boxes and cylinders, faces counter-clockwise from outside."""

from __future__ import annotations

import numpy as np

from analyze.types import Array, IntArray

CYLINDER_SIDES = 128
"""Number of sides of a cylinder's mesh."""


def box_mesh(size: Array) -> tuple[Array, IntArray]:
    """Vertices (8, 3) [m] and faces (12, 3) of a box with edges `size` (3,) [m], centred on the origin.

    The faces, triangles of vertex indices, are counter-clockwise from outside.
    """
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array(
        [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))], dtype=np.int64
    )


def cylinder_mesh(radius: float, height: float) -> tuple[Array, IntArray]:
    """Vertices (n, 3) [m] and faces (f, 3) of a cylinder centred on the origin, with its axis along z.

    It is a prism of `CYLINDER_SIDES` sides, with its corners on the cylinder. The faces, triangles of vertex
    indices, are counter-clockwise from outside.

    Args:
        radius: Radius [m].
        height: Height [m].
    """
    n = CYLINDER_SIDES
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    vertices = np.vstack(
        [
            np.column_stack([ring, np.full(n, -height / 2)]),
            np.column_stack([ring, np.full(n, height / 2)]),
            [[0.0, 0.0, -height / 2], [0.0, 0.0, height / 2]],
        ],
    )
    i = np.arange(n)
    j = (i + 1) % n
    side = np.vstack([np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])])
    caps = np.vstack(
        [np.column_stack([np.full(n, 2 * n), j, i]), np.column_stack([np.full(n, 2 * n + 1), i + n, j + n])]
    )
    return vertices, np.vstack([side, caps]).astype(np.int64)
