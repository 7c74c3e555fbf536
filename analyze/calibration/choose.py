"""Selects images for a calibration: one per position and tilt of the board, at most `MOST_VIEWS`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.calibration.board import tag_squares

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.calibration.detect import BoardSighting
    from analyze.tags.sheet import Board
    from analyze.types import Array

MIN_VIEW_DISTANCE = 0.025
"""least distance between the outlines of two different views: mean over the corners, over the image's
width"""
MOST_VIEWS = 40
"""largest number of views; more cost time and add little"""
_MIN_TAGS = 3
"""least number of tags in an image from which the board's outline is predicted"""


def outline(sight: BoardSighting, board: Board) -> Array | None:
    """Outer corners (4, 2) of the board in an image, predicted from its tags, accurate to some pixels.

    Args:
        sight: tags of the board in the image.
        board: the board.

    Returns:
        Corners [px], upper left first, then clockwise as printed; None if fewer than `_MIN_TAGS` tags are
        seen, or a corner would lie behind the camera.
    """
    tags = sorted(sight.tags)
    if len(tags) < _MIN_TAGS:
        return None
    middles: Array = np.asarray(tag_squares(board.columns, board.rows)[tags] + 0.5, dtype=np.float64)
    seen = np.array([sight.tags[tag].mean(axis=0) for tag in tags])
    found = cv2.findHomography(middles, seen, cv2.RANSAC, 5.0)[0] if len(tags) > _MIN_TAGS else None
    H = _affine(middles, seen) if found is None else np.asarray(found, dtype=float)
    corners = np.array(
        [[0, 0], [board.columns, 0], [board.columns, board.rows], [0, board.rows]], dtype=float
    )
    image = np.column_stack([corners, np.ones(4)]) @ H.T
    return image[:, :2] / image[:, 2:] if np.all(image[:, 2] > 0) else None


def _affine(squares: Array, pixels: Array) -> Array:
    """Affine transform (3, 3) from board coordinates [squares] to pixels, fitted by least squares.

    Args:
        squares: (n, 2) points on the board [squares].
        pixels: (n, 2) their positions in the image [px].
    """
    rows = np.column_stack([squares, np.ones(len(squares))])
    return np.vstack([np.linalg.lstsq(rows, pixels, rcond=None)[0].T, [0.0, 0.0, 1.0]])


def distinct_views(outlines: Sequence[Array], tags: Sequence[int], width: int) -> list[int]:
    """Indices of the views (images) whose outlines of the board differ, increasing.

    Outlines are similar if their corners are apart by at most `MIN_VIEW_DISTANCE` times the image's width in
    the mean. Of views with similar outlines the one with the most tags is taken.

    Args:
        outlines: outer corners (4, 2) of the board in each view [px].
        tags: number of tags in each view.
        width: width of the image [px].
    """
    order = sorted(range(len(outlines)), key=lambda i: (-tags[i], i))
    kept: list[int] = []
    for i in order:
        if all(_distance(outlines[i], outlines[j]) > MIN_VIEW_DISTANCE * width for j in kept):
            kept.append(i)
    return sorted(kept)


def _distance(first: Array, second: Array) -> float:
    """Mean distance [px] between the corresponding corners of two board outlines (4, 2) [px]."""
    return float(np.linalg.norm(first - second, axis=1).mean())


def most_different(views: Sequence[int], outlines: Sequence[Array]) -> list[int]:
    """Indices, increasing, of at most `MOST_VIEWS` of the views (images) `views`, those that differ most.

    The first view is taken, then always the one whose outline is farthest from all taken before.

    Args:
        views: indices of the views to choose from.
        outlines: outer corners (4, 2) of the board in all views [px].
    """
    if len(views) <= MOST_VIEWS:
        return sorted(views)
    points = np.array([outlines[i].ravel() for i in views])
    taken = [0]
    nearest = np.linalg.norm(points - points[0], axis=1)
    while len(taken) < MOST_VIEWS:
        taken.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(points - points[taken[-1]], axis=1))
    return sorted(views[i] for i in taken)
