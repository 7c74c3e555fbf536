"""How well a lens is known over its image: the sd of the pixel that a given direction falls on, everywhere, not only where the board was.

An error of the lens that a turn of the camera would hide is none: whoever finds the camera's pose by the same lens has turned it already.
So the best turn is taken out, over the whole image, before the sd is reckoned.
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


@dataclass(frozen=True)
class PixelMap:
    """On an even grid over the image, its borders included."""

    column: Array
    """(COLUMNS,) px"""
    row: Array
    """(ROWS,) px"""
    value: Array
    """(ROWS, COLUMNS) px; NaN where a fisheye sees too far out"""

    @property
    def worst(self) -> float:
        """Largest value [px]."""
        return float(np.nanmax(self.value))

    @property
    def worst_at(self) -> tuple[float, float]:
        """Column and row of it [px]."""
        row, column = np.unravel_index(int(np.nanargmax(self.value)), self.value.shape)
        return float(self.column[column]), float(self.row[row])

    @property
    def median(self) -> float:
        """Of the image [px]."""
        return float(np.nanmedian(self.value))


def grid(lens: Lens) -> tuple[Array, Array, Array]:
    """Columns, rows, and all points (ROWS COLUMNS, 2) px."""
    column, row = np.linspace(0.0, lens.width - 1.0, COLUMNS), np.linspace(0.0, lens.height - 1.0, ROWS)
    return column, row, np.stack(np.meshgrid(column, row), axis=-1).reshape(-1, 2)


def pixel_sd(lens: Lens, covariance: Array) -> PixelMap:
    """1 sigma of the distance by which a direction's pixel is off [px], `covariance` (p, p) being that of the lens's numbers."""
    column, row, points = grid(lens)
    rays = (undistort(lens.camera(), points) - lens.numbers[2:4]) / lens.numbers[:2]
    seen = np.isfinite(rays).all(axis=1)
    directions = np.column_stack([np.nan_to_num(rays), np.ones(len(rays))])
    _, by_pose, by_lens = project(lens, directions, np.zeros(3), np.zeros(3))
    by_turn, by_lens = by_pose[seen, :, :3].reshape(-1, 3), by_lens[seen].reshape(2 * int(seen.sum()), -1)
    left = without_turn(by_lens, by_turn).reshape(int(seen.sum()), 2, -1)
    value = np.full(len(points), np.nan)
    value[seen] = np.sqrt(np.maximum(np.einsum("nip,pq,niq->n", left, covariance, left), 0.0))
    return PixelMap(column, row, value.reshape(ROWS, COLUMNS))


def without_turn(moves: Array, by_turn: Array) -> Array:
    """Moves (2n, p) of pixels less what the best turn of the camera, by_turn (2n, 3), does for each of them."""
    return moves - by_turn @ np.linalg.lstsq(by_turn, moves, rcond=None)[0]
