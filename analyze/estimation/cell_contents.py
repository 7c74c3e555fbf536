"""Volume, first and second moments of a body's cells: merged to clumps, and cut by planes and balls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.cells import Cells
from analyze.types import TENSOR_ENTRIES, Array

_SAME_PLACE = 1e-6
"""Distance over a clump's edge, within which a cell on the border of two clumps counts to the upper one:
rounding errors are smaller."""


@dataclass(frozen=True)
class CutPieces:
    """The body's interior in n pieces with volume and moments, prepared to be cut by many surfaces.

    Surfaces are planes and balls (dividing_surfaces.py). Numbers are float32, so that moments have a relative
    error of 1e-6.
    """

    places: NDArray[np.float32]
    """(5, n) coordinates from the body's middle in pitches (3), 1, and the sum of their squares."""
    contents: NDArray[np.float32]
    """(n, 10) volume [m^3] (1), first (3) and second moments (6: xx, yy, zz, xy, xz, yz) [m^4, m^5] about the
    measured centre of mass, at unit density."""
    pitch: float
    """Width [m] of the layer about a surface in which a piece counts in part: the edge of a piece."""

    @classmethod
    def from_cells(cls, points: Array, contents: Array, pitch: float) -> CutPieces:
        """Pieces of the interior at `points` (n, 3) [m], from the body's middle, rounded to float32.

        `contents` (n, 10) are their volume [m^3] (1), first (3) [m^4] and second moments (6: xx, yy, zz, xy,
        xz, yz) [m^5] about the measured centre of mass, at unit density; `pitch` is a piece's edge [m].
        """
        places = points.T / pitch
        return cls(
            np.vstack([places, np.ones(len(points)), np.sum(places**2, axis=0)]).astype(np.float32),
            contents.astype(np.float32),
            pitch,
        )

    def shares(self, surfaces: Array) -> NDArray[np.float32]:
        """Fraction (b, n), 0 to 1, of each of n pieces of the interior above each of b planes or balls.

        A row of `surfaces` (b, 5) holds u (3), h [m] and k [1/m]; above are the points x, in m from the
        body's middle, with u.x - h - k |x|^2 / 2 > 0: the side of a plane's normal u, or the inside of a
        ball. A piece that the surface cuts counts in part.
        """
        share = np.column_stack(
            [surfaces[:, :3], 0.5 - surfaces[:, 3] / self.pitch, -0.5 * self.pitch * surfaces[:, 4]]
        ).astype(np.float32)
        share = share @ self.places
        np.clip(share, 0.0, 1.0, out=share)
        return share

    def above(self, surfaces: Array) -> Array:
        """Volume, first and second moments (b, 10) of the interior above each of b planes or balls.

        A row of `surfaces` (b, 5) holds u (3), h [m] and k [1/m]; above are the points x, in m from the
        body's middle, with u.x - h - k |x|^2 / 2 > 0: the side of a plane's normal u, or the inside of a
        ball. Columns of the result: volume [m^3], first moments (3) [m^4], second moments (6) [m^5] in the
        order xx, yy, zz, xy, xz, yz, about the measured centre of mass along the axes of the object frame O,
        at unit density.
        """
        return np.asarray(self.shares(surfaces) @ self.contents, dtype=np.float64)

    def beyond_plane(self, surfaces: Array, plane: Array) -> Array:
        """Fractions (b, 2) of the parts above and below each of b surfaces that lie above one plane.

        They are fractions of the volume of the interior's parts; a part without volume has the fraction 0.
        The rows of `surfaces` (b, 5), and `plane` (5,), hold u (3), h [m] and k [1/m]; above are the points
        x, in m from the body's middle, with u.x - h - k |x|^2 / 2 > 0: the side of a plane's normal u, or the
        inside of a ball.
        """
        volumes = self.contents[:, 0].astype(np.float64)
        beyond = volumes * self.shares(plane[None])[0]
        inside = np.asarray(self.shares(surfaces) @ np.column_stack([volumes, beyond]), dtype=np.float64)
        outside = np.array([volumes.sum(), beyond.sum()]) - inside
        parts = np.maximum(np.stack([inside, outside], axis=1), 0.0)
        return parts[..., 1] / np.maximum(parts[..., 0], 1e-9 * volumes.sum())


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

    The contents of a clump are the sums of those of its cells. A cell on the border of two cubes counts to
    the upper one.

    Args:
        points: (n, 3) centroids of the cells [m].
        contents: (n, 10) volume [m^3], first (3) [m^4] and second moments (6) [m^5], in the order xx, yy, zz,
            xy, xz, yz, of each cell.
        pitch: Edge of the cubes [m].
    """
    cube = np.floor(points / pitch + _SAME_PLACE).astype(np.int64)
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
