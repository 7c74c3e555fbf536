"""Refits a view's corners on pixels straightened (undistorted) by an approximate lens and pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.calibration.detect import View, refine
from analyze.calibration.lens import project
from analyze.calibration.saddle import patches
from analyze.tracking.camera_model import pixel_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.calibration.board_pose import Pose
    from analyze.calibration.lens import Lens
    from analyze.tags.sheet import Board
    from analyze.types import Array


def refit(
    image: NDArray[np.uint8], board: Board, view: View, points: Array, lens: Lens, pose: Pose
) -> View | None:
    """Refit the corners in an image of a board, with the lens's distortion removed.

    The distortion, the perspective (which is removed, too) and the first positions come from an approximate
    fit of lens and pose.

    Args:
        image: (height, width) grey values.
        board: the board.
        view: corners of the board as found so far.
        points: (n, 3) all corners of the board in the board's frame [m].
        lens: lens as estimated so far.
        pose: pose of the board as estimated with that lens.

    Returns:
        The refitted corners, in pixels of the image, without those that fail; None if fewer than six are left
        or all are in one row or column of the board. `view` itself is not changed.
    """
    seen = points[view.index]
    start, by_pose, _ = project(lens, seen, pose.rotation, pose.translation)
    square = 1e-3 * board.square_mm
    # d pixel / d point in C, by the translation's columns, times R's first two columns: px per m along the
    # board's x and y.
    per_square = by_pose[:, :, 3:] @ pose.matrix[:, :2] * square
    patch = patches(start, per_square, lens.width, lens.height)
    rays = (pixel_map(lens.camera()).ideal[patch.row, patch.column] - lens.numbers[2:4]) / lens.numbers[:2]
    # A plane seen through a pinhole: ray ~ (r1, r2, t) (x, y, 1).
    to_board = np.linalg.inv(np.column_stack([pose.matrix[:, 0], pose.matrix[:, 1], pose.translation]))
    on_board = rays @ to_board[:, :2].T + to_board[:, 2]
    on_board = on_board[..., :2] / on_board[..., 2:]
    straight = np.einsum("nij,nmj->nmi", per_square / square, on_board - seen[:, None, :2])
    return refine(image, board, view.index, start, per_square, straight)
