"""Volume, first and second moments of the cells of a body: merged to clumps, and cut by planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.cells import Cells
from analyze.types import TENSOR_ENTRIES, Array


@dataclass(frozen=True)
class CutPieces:
    """The body's interior in n pieces with volume and moments, prepared to be cut by many planes.

    `places` (4, n) are coordinates from the body's middle in units of `pitch` (the width of the layer in
    which a cut piece counts in part), and 1. `contents` (n, 10) are volume [m^3], first moments [m^4] and
    second moments [m^5] about the measured centre of mass, at unit density. Numbers are float32, so that
    moments have a relative error of 1e-6.
    """

    places: NDArray[np.float32]
    """(4, n) coordinates from the body's middle in pitches, and 1."""
    contents: NDArray[np.float32]
    """(n, 10) volume, first and second moments about the measured centre of mass, at unit density."""
    pitch: float
    """Width [m] of the layer about a plane in which a piece counts in part."""

    @classmethod
    def from_cells(cls, points: Array, contents: Array, pitch: float) -> CutPieces:
        """Pieces of the interior at `points` (n, 3) with `contents` (n, 10), rounded to float32.

        `points` [m] are relative to the body's middle. `contents` are the pieces' volume [m^3] (1), and at
        unit density their first moments [m^4] (3) and second moments [m^5] (xx, yy, zz, xy, xz, yz), about
        the measured centre of mass. `pitch` is a piece's edge [m].
        """
        return cls(
            np.vstack([points.T / pitch, np.ones(len(points))]).astype(np.float32),
            contents.astype(np.float32),
            pitch,
        )

    def above(self, normals: Array, heights: Array) -> Array:
        """Volume, first and second moments (b, 10) of the interior above each of b planes.

        Above is the side of the normal. Columns: volume [m^3], first moments (3) [m^4], second moments (6)
        [m^5] in the order xx, yy, zz, xy, xz, yz, about the measured centre of mass along the axes of O. They
        are continuous in the plane: a piece that it cuts counts in part.

        Args:
            normals: (b, 3) unit normals, in the object frame O.
            heights: (b,) heights over the body's middle [m].
        """
        share = np.column_stack([normals, 0.5 - heights / self.pitch]).astype(np.float32) @ self.places
        np.clip(share, 0.0, 1.0, out=share)
        return np.asarray(share @ self.contents, dtype=np.float64)


def cell_contents(cells: Cells, about: Array) -> Array:
    """Moments (n, 10) of each of n cells about a point, per volume of the cell.

    Columns: 1 (the volume itself), first moments (3) [m], second moments (6) [m^2] in the order xx, yy, zz,
    xy, xz, yz. The second moments include the cell's own, which are the same about every axis. `about` (3,)
    is the point [m], in the object frame O.
    """
    arm = cells.points - about
    second = np.stack(
        [arm[:, i] * arm[:, j] + (cells.own_inertia / 2 if i == j else 0.0) for i, j in TENSOR_ENTRIES],
        axis=1,
    )
    return np.column_stack([np.ones(len(arm)), arm, second])


def clumped(points: Array, contents: Array, pitch: float) -> tuple[Array, Array]:
    """Centroids (m, 3) [m] and contents (m, 10) of clumps: all cells in one cube of edge `pitch`.

    The contents of a clump are the sums of those of its cells.

    Args:
        points: (n, 3) centroids of the cells [m].
        contents: (n, 10) volume [m^3], first (3) [m^4] and second moments (6) [m^5], in the order xx, yy, zz,
            xy, xz, yz, of each cell.
        pitch: Edge of the cubes [m].
    """
    cube = np.floor(points / pitch).astype(np.int64)
    cube -= cube.min(axis=0)
    size = cube.max(axis=0) + 1
    _, clump = np.unique((cube[:, 0] * size[1] + cube[:, 1]) * size[2] + cube[:, 2], return_inverse=True)
    weights = np.column_stack([contents, contents[:, :1] * points])
    sums: Array = np.stack(
        [np.asarray(np.bincount(clump, column), dtype=np.float64) for column in weights.T], axis=1
    )
    together, moments = sums[:, : contents.shape[1]], sums[:, contents.shape[1] :]
    return moments / together[:, :1], together


def concentrated(contents: Array) -> Array:
    """Contents (n, 10) of n pieces, changed to those with all mass of each piece at its centroid.

    Columns are volume (1), first moments (3) and second moments (6: xx, yy, zz, xy, xz, yz), at unit density
    and about one common point.
    """
    first = contents[:, 1:4]
    second = np.stack([first[:, i] * first[:, j] for i, j in TENSOR_ENTRIES], axis=1) / contents[:, :1]
    return np.column_stack([contents[:, :4], second])
