"""Pixels straightened by a lens and a pose that are nearly right: round each corner the board's lines become straight and evenly spaced."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.calibration.detect import View, refine
from analyze.calibration.lens import project
from analyze.calibration.saddle import patches
from analyze.tracking.camera_model import pixel_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.calibration.lens import Lens
    from analyze.calibration.solve import Pose
    from analyze.tags.sheet import Board
    from analyze.types import Array


def refit(image: NDArray[np.uint8], board: Board, view: View, points: Array, lens: Lens, pose: Pose) -> View | None:
    """Fit a view's corners again, through this lens.

    Args:
        image: (height, width).
        board: that is seen.
        view: its corners so far.
        points: all corners of the board (n, 3) m in B.
        lens: as known so far.
        pose: of the board, by that lens.
    """
    seen = points[view.index]
    start, by_pose, _ = project(lens, seen, pose.rotation, pose.translation)
    square = 1e-3 * board.square_mm
    # d pixel / d point in C, by the translation's columns, times R's first two columns: px per m along the board's x and y.
    per_square = by_pose[:, :, 3:] @ pose.matrix[:, :2] * square
    patch = patches(start, per_square, lens.width, lens.height)
    rays = (pixel_map(lens.camera()).ideal[patch.row, patch.column] - lens.numbers[2:4]) / lens.numbers[:2]
    # A plane seen through a pinhole: ray ~ (r1, r2, t) (x, y, 1).
    to_board = np.linalg.inv(np.column_stack([pose.matrix[:, 0], pose.matrix[:, 1], pose.translation]))
    on_board = rays @ to_board[:, :2].T + to_board[:, 2]
    on_board = on_board[..., :2] / on_board[..., 2:]
    straight = np.einsum("nij,nmj->nmi", per_square / square, on_board - seen[:, None, :2])
    return refine(image, board, view.index, start, per_square, straight)
