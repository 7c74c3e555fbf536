"""Uncertainty of a lens over its image: standard deviation of the pixel to which a direction projects.

The standard deviation of the image's strain follows from it: that of the part of a lens error that shifts a
tipping angle measured in the image.

The uncertainty is computed also where no board was seen. A lens error that a rotation of the camera
compensates does no harm, because the camera's pose is found with the same lens. So the best rotation over the
whole image is removed before the standard deviation is computed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.calibration.lens import project
from analyze.tracking.camera_model import undistort

if TYPE_CHECKING:
    from analyze.calibration.lens import Lens
    from analyze.types import Array

COLUMNS, ROWS = 41, 31
"""numbers of columns and rows of the grid over the image"""


@dataclass(frozen=True)
class PixelMap:
    """Uncertainty of a lens on a grid over its image.

    It is the standard deviation [px], of column and row together, of the pixel to which a direction projects.
    The grid has ROWS rows and COLUMNS columns, whose places in the image are `row` and `column` [px].
    """

    column: Array
    """(COLUMNS,) columns [px]"""
    row: Array
    """(ROWS,) rows [px]"""
    value: Array
    """(ROWS, COLUMNS) standard deviation, of column and row together [px]; NaN beyond a fisheye's range"""
    strain_sd: float
    """standard deviation of the image's strain: relative error of a length in one direction against one
    across it, rms over the middle half of the image's width and height, where objects are filmed"""

    @property
    def worst(self) -> float:
        """Largest standard deviation in the image of the pixel to which a direction projects [px]."""
        return float(np.nanmax(self.value))

    @property
    def worst_at(self) -> tuple[float, float]:
        """Column and row [px] of the place in the image where the lens is least certain (largest sd)."""
        row, column = np.unravel_index(int(np.nanargmax(self.value)), self.value.shape)
        return float(self.column[column]), float(self.row[row])

    @property
    def median(self) -> float:
        """Median over the image of the standard deviation of the pixel to which a direction projects [px]."""
        return float(np.nanmedian(self.value))


def grid(lens: Lens) -> tuple[Array, Array, Array]:
    """Regular grid of points over a lens's image.

    Returns:
        Columns (COLUMNS,), rows (ROWS,), and all points (ROWS COLUMNS, 2) as column and row, row by row [px].
    """
    column, row = np.linspace(0.0, lens.width - 1.0, COLUMNS), np.linspace(0.0, lens.height - 1.0, ROWS)
    return column, row, np.stack(np.meshgrid(column, row), axis=-1).reshape(-1, 2)


def pixel_sd(lens: Lens, covariance: Array) -> PixelMap:
    """Compute the standard deviation of the pixel to which a direction projects, all over the image.

    The part of a lens error that a rotation of the camera compensates is left out.

    Args:
        lens: the lens, with p numbers.
        covariance: (p, p) covariance of the lens's numbers.

    Returns:
        Standard deviations (rows, columns) [px], of column and row together, on a grid over the image, with
        the grid's columns and rows [px]; NaN where a pixel has no direction (beyond a fisheye's range). Also
        the standard deviation of the image's strain.
    """
    column, row, points = grid(lens)
    rays = (undistort(lens.camera(), points) - lens.numbers[2:4]) / lens.numbers[:2]
    seen = np.isfinite(rays).all(axis=1)
    directions = np.column_stack([np.nan_to_num(rays), np.ones(len(rays))])
    _, by_pose, by_lens = project(lens, directions, np.zeros(3), np.zeros(3))
    by_turn, by_lens = by_pose[seen, :, :3].reshape(-1, 3), by_lens[seen].reshape(2 * int(seen.sum()), -1)
    left = without_turn(by_lens, by_turn).reshape(int(seen.sum()), 2, -1)
    value = np.full(len(points), np.nan)
    value[seen] = np.sqrt(np.maximum(np.einsum("nip,pq,niq->n", left, covariance, left), 0.0))
    moves = np.full((len(points), *left.shape[1:]), np.nan)
    moves[seen] = left
    strain = _strain_sd(moves.reshape(ROWS, COLUMNS, 2, -1), column, row, covariance)
    return PixelMap(column, row, value.reshape(ROWS, COLUMNS), strain)


def _strain_sd(moves: Array, column: Array, row: Array, covariance: Array) -> float:
    """Standard deviation of the image's strain, rms over the middle half of its width and height.

    With the displacement (u, v) of pixels (x, y), the strain's two components are du/dx - dv/dy and
    du/dy + dv/dx; the strain is the root of their squares' sum.

    Args:
        moves: (ROWS, COLUMNS, 2, p) derivatives of the pixels by the lens's p numbers.
        column: (COLUMNS,) columns of the grid [px].
        row: (ROWS,) rows of the grid [px].
        covariance: (p, p) covariance of the lens's numbers.
    """
    by_row: Array = np.asarray(np.gradient(moves, row, axis=0), dtype=np.float64)
    by_column: Array = np.asarray(np.gradient(moves, column, axis=1), dtype=np.float64)
    stretch = by_column[..., 0, :] - by_row[..., 1, :]
    shear = by_row[..., 0, :] + by_column[..., 1, :]
    middle = np.stack([stretch, shear])[:, ROWS // 4 : -(ROWS // 4), COLUMNS // 4 : -(COLUMNS // 4)]
    variance: Array = np.einsum("crxp,pq,crxq->rx", middle, covariance, middle)
    return float(np.sqrt(np.nanmean(np.maximum(variance, 0.0))))


def without_turn(moves: Array, by_turn: Array) -> Array:
    """Derivatives (2n, p) of pixels by a lens's numbers, less what a camera rotation can compensate.

    The compensable part of each column of `moves` is its least-squares fit by the columns of `by_turn`.

    Args:
        moves: (2n, p) derivatives of n pixels by each of the lens's p numbers.
        by_turn: (2n, 3) derivatives of the pixels by the camera's rotation about its three axes [px/rad].
    """
    return moves - by_turn @ np.linalg.lstsq(by_turn, moves, rcond=None)[0]
