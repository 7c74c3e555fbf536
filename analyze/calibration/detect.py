"""Detects the corners of a calibration board (chessboard with tags) in an image.

Each tag predicts the board corners beside it; predictions of neighbouring tags must agree. The module
`saddle` then refines the corners to subpixel accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.calibration.board import tag_corners, tag_count, tag_margin, tag_squares
from analyze.calibration.saddle import fit_saddles, patches
from analyze.tags.families import FAMILIES, dictionary

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from analyze.tags.sheet import Board
    from analyze.types import Array, IntArray

_MAX_DISAGREEMENT = 0.2
"""largest distance [squares] between two tags' predictions of their common corner; beyond it a tag is
misread, or the board has another layout"""
_MIN_CORNERS = 6
"""least number of corners of a view"""
_MIN_SQUARE_PX = 9.0
"""least side of a square whose corners are used [px]"""
_MAX_COLUMNS = 24
"""largest number of columns tried in the search for a board's layout"""


@dataclass(frozen=True)
class View:
    """Corners of a calibration board found in one image: index on the board, and position [raw px].

    Raw pixels include the lens's distortion.
    """

    index: IntArray
    """(n,) indices of the corners in `board.corner_points`"""
    place: Array
    """(n, 2) positions in the image, not undistorted [px]"""
    covariance: Array
    """(n, 2, 2) covariance of the positions [px^2]"""
    per_square: Array
    """(n, 2, 2) shift in the image for one square along the board's x and y, in columns [px]"""
    blur: float
    """median standard deviation of the edges' blur [px]"""

    def only(self, kept: NDArray[np.bool_]) -> View:
        """Copy of a view of the board with only those of its n corners that are True in `kept` (n,).

        The median blur stays that of all corners.
        """
        return View(
            self.index[kept], self.place[kept], self.covariance[kept], self.per_square[kept], self.blur
        )


@dataclass(frozen=True)
class BoardSighting:
    """Tags of a calibration board found in one image [px], and how many board corners they predict.

    Ids of foreign tags (not on the board) are listed too.
    """

    tags: Mapping[int, Array]
    """corners (4, 2) of each of the board's tags [px], by tag id"""
    read: Mapping[int, Array]
    """corners (4, 2) of all tags in the image [px] by tag id, including tags that the board does not have"""
    foreign_ids: tuple[int, ...]
    """ids of tags in the image that the board does not have, increasing"""
    pairs: int
    """number of board corners that two tags predict"""
    agreeing: int
    """number of those corners for which the two predictions agree"""
    start: Mapping[int, tuple[Array, Array]]
    """by corner index: predicted position (2,) [px], accurate to about a pixel, and the shift in the image
    (2, 2) for one square along the board's x and y, in columns [px]"""

    @property
    def another_layout(self) -> bool:
        """True if the tags are arranged unlike the board's, so that the image shows another board.

        That is so if at least three board corners lie between two tags that were seen, and for less than half
        of these corners the two tags predict the same place in the image.
        """
        return self.pairs >= 3 and self.agreeing < 0.5 * self.pairs


@cache
def _detector(family: str) -> cv2.aruco.ArucoDetector:
    """OpenCV's detector for the tags of a family, without refinement of the tags' corners.

    Raises:
        TagError: the family is unknown.
    """
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    parameters.errorCorrectionRate = 0.3
    parameters.minMarkerPerimeterRate = 0.02
    parameters.adaptiveThreshWinSizeMin = 7
    parameters.adaptiveThreshWinSizeMax = 39
    parameters.adaptiveThreshWinSizeStep = 16
    parameters.adaptiveThreshConstant = 7
    parameters.minMarkerDistanceRate = 0.02
    return cv2.aruco.ArucoDetector(dictionary(family), parameters)


def read_tags(image: NDArray[np.uint8], family: str) -> dict[int, Array]:
    """Find the tags of a family in an image (height, width) uint8.

    Returns:
        Corners (4, 2) of each tag [px] by tag id, accurate to about half a pixel; empty if there is none. Of
        several tags with one id the last one found is kept.
    """
    corners, ids, _ = _detector(family).detectMarkers(np.ascontiguousarray(image))
    if len(corners) == 0:
        return {}
    return {
        int(tag): np.asarray(quad[0], dtype=float) for quad, tag in zip(corners, np.ravel(ids), strict=True)
    }


def families_seen(image: NDArray[np.uint8]) -> dict[str, int]:
    """Number of tags seen in an image, by tag family; families without any are left out.

    Args:
        image: (height, width) grey values.
    """
    found = {family: len(read_tags(image, family)) for family in FAMILIES}
    return {family: many for family, many in found.items() if many}


def read_board(image: NDArray[np.uint8], board: Board) -> BoardSighting:
    """Find the board's tags in an image, and predict the board corners beside them.

    Args:
        image: (height, width) grey values.
        board: the board.

    Returns:
        The tags found, with their ids and corners [raw px], and the predicted position [raw px] of each board
        corner beside them, by corner index; both are empty if no tag is seen.
    """
    return predict_corners(read_tags(image, board.family), board)


def predict_corners(tags: Mapping[int, Array], board: Board) -> BoardSighting:
    """Predict the board corners in an image from the tags that were found in it.

    A corner between two tags gets the mean prediction, or none if the two disagree by more than
    `_MAX_DISAGREEMENT` squares plus 2 px.

    Args:
        tags: corners (4, 2) of each tag [raw px], by tag id.
        board: the board.

    Returns:
        The tags; and by corner index the predicted position (2,) [raw px], with the shift in the image (2, 2)
        [px] for one square along the board's x and y.
    """
    known = {tag: quad for tag, quad in tags.items() if tag < tag_count(board)}
    beyond = tuple(sorted(set(tags) - set(known)))
    squares, shape = tag_squares(board.columns, board.rows), tag_corners(board).astype(np.float32)
    predictions: dict[int, list[tuple[Array, Array]]] = {}
    for tag, quad in known.items():
        H = np.asarray(cv2.getPerspectiveTransform(shape, quad.astype(np.float32)), dtype=float)
        column, row = squares[tag]
        for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)):
            i, j = int(column + x + 0.5), int(row + y + 0.5)
            if 0 < i < board.columns and 0 < j < board.rows:
                predictions.setdefault((j - 1) * (board.columns - 1) + i - 1, []).append(
                    _through(H, np.array([x, y]))
                )
    pairs = agreeing = 0
    start: dict[int, tuple[Array, Array]] = {}
    for corner, found in predictions.items():
        place = np.mean([each[0] for each in found], axis=0)
        per_square = np.mean([each[1] for each in found], axis=0)
        if len(found) == 2:
            pairs += 1
            apart = np.linalg.norm(found[0][0] - found[1][0])
            if apart > _MAX_DISAGREEMENT * np.sqrt(abs(np.linalg.det(per_square))) + 2.0:
                continue
            agreeing += 1
        start[corner] = (place, per_square)
    return BoardSighting(known, tags, beyond, pairs, agreeing, start)


def _through(H: Array, at: Array) -> tuple[Array, Array]:
    """Project a point near a tag to the image by a homography.

    Args:
        H: (3, 3) homography from squares (relative to the tag's middle, x right, y down) to pixels.
        at: (2,) the point [squares].

    Returns:
        Position (2,) in the image [px]; its derivative (2, 2) by the board's x and y (up), in columns [px per
        square].
    """
    x = H @ np.array([at[0], at[1], 1.0])
    place = x[:2] / x[2]
    by = (H[:2, :2] - np.outer(place, H[2, :2])) / x[2]
    return place, by * np.array([1.0, -1.0])


def find_corners(image: NDArray[np.uint8], board: Board, sight: BoardSighting) -> View | None:
    """Fit the board's corners to an image, from their predictions by tags.

    Corners whose square is smaller than `_MIN_SQUARE_PX` in the image are not used.

    Args:
        image: (height, width) grey values.
        board: the board.
        sight: tags of the board in the image.

    Returns:
        The good corners by index on the board, with places in the image [raw px] and their covariances; None
        if there are fewer than `_MIN_CORNERS`, or all lie in one row or column of the board.
    """
    if len(sight.start) < _MIN_CORNERS:
        return None
    index = np.array(sorted(sight.start), dtype=np.int64)
    start = np.array([sight.start[i][0] for i in index])
    per_square = np.array([sight.start[i][1] for i in index])
    large = np.linalg.norm(per_square, axis=1).min(axis=1) > _MIN_SQUARE_PX
    return refine(image, board, index[large], start[large], per_square[large], None) if large.any() else None


def refine(
    image: NDArray[np.uint8],
    board: Board,
    index: IntArray,
    start: Array,
    per_square: Array,
    straight: Array | None,
) -> View | None:
    """Fit n corners of the board to the grey values around their first positions.

    Args:
        image: (height, width) grey values.
        board: the board.
        index: (n,) indices of the corners in `board.corner_points`.
        start: (n, 2) first positions [px].
        per_square: (n, 2, 2) shift in the image for one square along the board's x and y, in columns [px].
        straight: (n, m, 2) undistorted positions of the m pixels around each corner (`saddle.patches`),
            relative to `start` [px]; None for the pixels as they are.

    Returns:
        The corners that could be fitted: index, position [raw px] and covariance [px^2] of each, and their
        median blur [px]. None if they are fewer than `_MIN_CORNERS`, or all in one row or column of the
        board.
    """
    height, width = image.shape
    patch = patches(start, per_square, width, height)
    if straight is None:
        straight = np.stack([patch.column, patch.row], axis=-1) - start[:, None]
    found = fit_saddles(image, start, per_square, tag_margin(board), patch, straight)
    kept = found.good
    columns, rows = index[kept] % (board.columns - 1), index[kept] // (board.columns - 1)
    if np.count_nonzero(kept) < _MIN_CORNERS or min(len(set(columns)), len(set(rows))) < 2:
        return None
    return View(
        index[kept],
        found.place[kept],
        found.covariance[kept],
        per_square[kept],
        float(np.median(found.blur[kept])),
    )


def likely_squares(tags: Sequence[Mapping[int, Array]], board: Board) -> tuple[int, int] | None:
    """Numbers of columns and rows of the board that fits the arrangement of seen tags best.

    Args:
        tags: for each image, corners (4, 2) of each tag [px], by tag id.
        board: the board that the user named; its tag family and sizes are used.

    Returns:
        Numbers of squares across and down. None if there are fewer than three pairs of neighbouring tags, or
        if, whatever the board, only 70 % of the pairs or fewer agree on the corner between them.
    """
    highest = max((tag for seen in tags for tag in seen), default=0)
    best: tuple[float, int, int] | None = None
    for columns in range(3, _MAX_COLUMNS + 1):
        rows = max(3, next(r for r in range(2, 2 * highest + 4) if columns * r // 2 > highest))
        other = replace(board, columns=columns, rows=rows)
        sights = [predict_corners(seen, other) for seen in tags]
        pairs = sum(sight.pairs for sight in sights)
        share = sum(sight.agreeing for sight in sights) / pairs if pairs >= 3 else 0.0
        if share > 0.7 and (best is None or share > best[0]):
            best = (share, columns, rows)
    return None if best is None else best[1:]
