"""A board in an image: OpenCV reads the tags, each says where the corners beside it are, neighbours must agree, and `saddle` finds them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.calibration.board import rim, tag_corners, tag_count, tag_squares
from analyze.calibration.saddle import fit_saddles, patches
from analyze.tags.families import FAMILIES, dictionary

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from analyze.tags.sheet import Board
    from analyze.types import Array, IntArray

_AGREE = 0.2
"""squares; two tags that predict their common corner farther apart than this are not on the board that was named, or misread"""
_LEAST_CORNERS = 6
_SMALLEST_SQUARE_PX = 9.0
_MOST_COLUMNS = 24


@dataclass(frozen=True)
class View:
    """Corners of the board in one image."""

    index: IntArray
    """(n,) which corners, as `board.corner_points` counts them"""
    place: Array
    """(n, 2) px, raw"""
    covariance: Array
    """(n, 2, 2) px^2"""
    per_square: Array
    """(n, 2, 2) px; columns are the image of one square along the board's x and y"""
    blur: float
    """px, median"""

    def only(self, kept: NDArray[np.bool_]) -> View:
        """Some of its corners."""
        return View(self.index[kept], self.place[kept], self.covariance[kept], self.per_square[kept], self.blur)


@dataclass(frozen=True)
class Sight:
    """What one image shows of a board."""

    tags: Mapping[int, Array]
    """id -> corners (4, 2) px, of the board"""
    read: Mapping[int, Array]
    """the same with those that the board does not have"""
    beyond: tuple[int, ...]
    """ids that the board does not have"""
    pairs: int
    """neighbouring tags"""
    agreeing: int
    """of those, tags that stand to each other as on the board"""
    start: Mapping[int, tuple[Array, Array]]
    """corner -> place (2,) px to about a pixel, and the image (2, 2) px of one square along the board's x and y"""

    @property
    def another_layout(self) -> bool:
        """Whether its tags stand otherwise than on the board."""
        return self.pairs >= 3 and self.agreeing < 0.5 * self.pairs


@cache
def _detector(family: str) -> cv2.aruco.ArucoDetector:
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
    """Tags of a family in an image: id -> corners (4, 2) px, to about half a pixel."""
    corners, ids, _ = _detector(family).detectMarkers(np.ascontiguousarray(image))
    if ids is None:
        return {}
    return {int(tag): np.asarray(quad[0], dtype=float) for quad, tag in zip(corners, np.ravel(ids), strict=True)}


def families_seen(image: NDArray[np.uint8]) -> dict[str, int]:
    """How many tags of each family an image shows, where there are any."""
    found = {family: len(read_tags(image, family)) for family in FAMILIES}
    return {family: many for family, many in found.items() if many}


def look(image: NDArray[np.uint8], board: Board) -> Sight:
    """Read the tags, and say where the corners beside them must be."""
    return arrange(read_tags(image, board.family), board)


def arrange(tags: Mapping[int, Array], board: Board) -> Sight:
    """The same of tags that were read before."""
    known = {tag: quad for tag, quad in tags.items() if tag < tag_count(board)}
    beyond = tuple(sorted(set(tags) - set(known)))
    squares, shape = tag_squares(board.columns, board.rows), tag_corners(board).astype(np.float32)
    said: dict[int, list[tuple[Array, Array]]] = {}
    for tag, quad in known.items():
        H = np.asarray(cv2.getPerspectiveTransform(shape, quad.astype(np.float32)), dtype=float)
        column, row = squares[tag]
        for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)):
            i, j = int(column + x + 0.5), int(row + y + 0.5)
            if 0 < i < board.columns and 0 < j < board.rows:
                said.setdefault((j - 1) * (board.columns - 1) + i - 1, []).append(_through(H, np.array([x, y])))
    pairs = agreeing = 0
    start: dict[int, tuple[Array, Array]] = {}
    for corner, words in said.items():
        place = np.mean([word[0] for word in words], axis=0)
        per_square = np.mean([word[1] for word in words], axis=0)
        if len(words) == 2:
            pairs += 1
            apart = np.linalg.norm(words[0][0] - words[1][0])
            if apart > _AGREE * np.sqrt(abs(np.linalg.det(per_square))) + 2.0:
                continue
            agreeing += 1
        start[corner] = (place, per_square)
    return Sight(known, tags, beyond, pairs, agreeing, start)


def _through(H: Array, at: Array) -> tuple[Array, Array]:
    """A point in squares about a tag's middle (y down) to px, and the derivative by the board's x and y (up)."""
    x = H @ np.array([at[0], at[1], 1.0])
    place = x[:2] / x[2]
    by = (H[:2, :2] - np.outer(place, H[2, :2])) / x[2]
    return place, by * np.array([1.0, -1.0])


def find_corners(image: NDArray[np.uint8], board: Board, sight: Sight) -> View | None:
    """The corners themselves; None where there are too few, or all on a line."""
    if len(sight.start) < _LEAST_CORNERS:
        return None
    index = np.array(sorted(sight.start), dtype=np.int64)
    start = np.array([sight.start[i][0] for i in index])
    per_square = np.array([sight.start[i][1] for i in index])
    large = np.linalg.norm(per_square, axis=1).min(axis=1) > _SMALLEST_SQUARE_PX
    return refine(image, board, index[large], start[large], per_square[large], None) if large.any() else None


def refine(image: NDArray[np.uint8], board: Board, index: IntArray, start: Array, per_square: Array, straight: Array | None) -> View | None:
    """Fit the corners from `start` (n, 2) px on; `straight` as `saddle.fit_saddles` takes it, None for the pixels as they are."""
    height, width = image.shape
    patch = patches(start, per_square, width, height)
    if straight is None:
        straight = np.stack([patch.column, patch.row], axis=-1) - start[:, None]
    found = fit_saddles(image, start, per_square, rim(board), patch, straight)
    kept = found.good
    columns, rows = index[kept] % (board.columns - 1), index[kept] // (board.columns - 1)
    if np.count_nonzero(kept) < _LEAST_CORNERS or min(len(set(columns)), len(set(rows))) < 2:
        return None
    return View(index[kept], found.place[kept], found.covariance[kept], per_square[kept], float(np.median(found.blur[kept])))


def likely_squares(tags: Sequence[Mapping[int, Array]], board: Board) -> tuple[int, int] | None:
    """Columns and rows of the board whose layout these images' tags follow; None where there is none."""
    highest = max((tag for seen in tags for tag in seen), default=0)
    best: tuple[float, int, int] | None = None
    for columns in range(3, _MOST_COLUMNS + 1):
        rows = max(3, next(r for r in range(2, 2 * highest + 4) if columns * r // 2 > highest))
        other = type(board)(board.family, columns, rows, board.square_mm, board.marker_mm)
        sights = [arrange(seen, other) for seen in tags]
        pairs = sum(sight.pairs for sight in sights)
        share = sum(sight.agreeing for sight in sights) / pairs if pairs >= 3 else 0.0
        if share > 0.7 and (best is None or share > best[0]):
            best = (share, columns, rows)
    return None if best is None else best[1:]
