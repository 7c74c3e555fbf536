"""Geometry of a ChArUco board: positions of its corners and tags in the board's frame B.

Frame B: x right and y up as printed, z out of the board's face, origin at the lower left corner of the
squares, where the print has its mark.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.tags.sheet import Board
    from analyze.types import Array, IntArray

MM = 1e-3
"""metres in a millimetre"""


@cache
def corner_points(board: Board) -> Array:
    """Positions (n, 3) of a board's inner chessboard corners in its frame B [m], read-only.

    B: x right, y up, origin at the lower left corner of the squares. The corners are ordered row by row from
    the upper left, n = (columns - 1)(rows - 1).
    """
    column, row = np.meshgrid(np.arange(1, board.columns), np.arange(1, board.rows))
    squares = np.stack([column.ravel(), board.rows - row.ravel(), np.zeros(column.size)], axis=-1)
    points = np.asarray(squares * (board.square_mm * MM), dtype=np.float64)
    points.setflags(write=False)
    return points


@cache
def tag_squares(columns: int, rows: int) -> IntArray:
    """Column and row (n, 2) of each square with a tag on a board, in the order of the tags' ids.

    Columns and rows count from 0 at the upper left square. The n tags are in the white squares.

    Args:
        columns: number of squares across.
        rows: number of squares down.
    """
    return np.array(
        [(column, row) for row in range(rows) for column in range(columns) if (row + column) % 2],
        dtype=np.int64,
    )


def tag_count(board: Board) -> int:
    """Number of tags on a board; the tags' ids begin at 0."""
    return board.columns * board.rows // 2


def tag_corners(board: Board) -> Array:
    """Corners (4, 2) of any tag of a board, relative to the middle of its square [square sides].

    x is to the right and y down. Order: top-left, top-right, bottom-right, bottom-left.
    """
    half = 0.5 * board.marker_mm / board.square_mm
    return np.array([[-half, -half], [half, -half], [half, half], [-half, half]])


def tag_margin(board: Board) -> float:
    """Width of the white margin between a tag and the edge of its square [square sides]."""
    return 0.5 * (1.0 - board.marker_mm / board.square_mm)
