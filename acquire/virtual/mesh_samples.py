"""Points inside a closed mesh, by parallel lines through it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_DENSER = 3
"""factor by which the lines are denser than the points along them: a line beside a wall misses all of it"""


def sample_mesh(triangles: NDArray[np.float64], samples: int) -> NDArray[np.float64]:
    """Points (n, 3) [m] spread uniformly inside a closed mesh; equal meshes give equal points.

    Lines along z on a jittered grid pass through the mesh; a point of a line lies inside if the line has
    crossed the surface an odd number of times below it.

    Args:
        triangles: (m, 3, 3) corners of the triangles [m].
        samples: number of points in the bounding box; those outside the mesh are dropped.
    """
    rng = np.random.default_rng(20261123)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    pitch = (np.prod(high - low) / samples) ** (1 / 3) * np.array([1 / _DENSER, 1 / _DENSER, _DENSER**2])
    counts = np.maximum(2, np.ceil((high - low) / pitch).astype(int))
    step = (high - low) / counts
    cells = np.stack(np.meshgrid(np.arange(counts[0]), np.arange(counts[1]), indexing="ij"), axis=-1)
    lines = low[:2] + (cells + rng.random(cells.shape)) * step[:2]
    column, height = _crossings(triangles, lines, low[:2], step[:2])
    z = low[2] + (np.arange(counts[2]) + rng.random((counts[0] * counts[1], counts[2]))) * step[2]
    span = 4 * float(high[2] - low[2])
    keys = np.sort(column * span + (height - low[2]))
    number = np.arange(len(z))[:, None]
    below = np.searchsorted(keys, number * span + (z - low[2])) - np.searchsorted(
        keys, number * span - span / 2
    )
    inside = below % 2 == 1
    at = np.nonzero(inside)[0]
    return np.column_stack([lines.reshape(-1, 2)[at], z[inside]])


def _crossings(
    triangles: NDArray[np.float64],
    lines: NDArray[np.float64],
    low: NDArray[np.float64],
    step: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Number (n,) of the line, and height z (n,) [m], of every crossing of a line with a triangle.

    Args:
        triangles: (m, 3, 3) corners of the triangles [m].
        lines: (a, b, 2) x and y of the lines [m], one in each cell of a grid.
        low: (2,) lower corner of the grid [m].
        step: (2,) size of its cells [m].
    """
    numbers: list[NDArray[np.int64]] = [np.zeros(0, dtype=np.int64)]
    heights: list[NDArray[np.float64]] = [np.zeros(0)]
    first = np.maximum(0, np.floor((triangles[..., :2].min(axis=1) - low) / step).astype(int))
    last = np.floor((triangles[..., :2].max(axis=1) - low) / step).astype(int) + 1
    edge, other = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = edge[:, 0] * other[:, 1] - edge[:, 1] * other[:, 0]
    for i in np.flatnonzero(area != 0):
        near = lines[first[i, 0] : last[i, 0], first[i, 1] : last[i, 1]] - triangles[i, 0, :2]
        u = (near[..., 0] * other[i, 1] - near[..., 1] * other[i, 0]) / area[i]
        v = (edge[i, 0] * near[..., 1] - edge[i, 1] * near[..., 0]) / area[i]
        hit = np.nonzero((u >= 0) & (v >= 0) & (u + v < 1))
        numbers.append((hit[0] + first[i, 0]) * lines.shape[1] + hit[1] + first[i, 1])
        heights.append(triangles[i, 0, 2] + u[hit] * edge[i, 2] + v[hit] * other[i, 2])
    return np.concatenate(numbers), np.concatenate(heights)
