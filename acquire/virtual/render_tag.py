"""Printed square tag as boundary lines between black and white areas, with their steps in grey level."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np

from acquire.virtual.layers import cut_lines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from schemas.tags import TagFamily

WHITE, BLACK = 225.0, 30.0
"""grey levels of a printed card that faces the camera, at the reference exposure"""
RIM_CELLS = 1
"""white cells around the black square"""


@dataclass(frozen=True)
class Lines:
    """Straight boundary lines of a tag on its white card, with the change of grey level across each.

    Inside is the side to the right of a line, going from start to end and looking at the card. A change is
    the value inside minus the value outside; either side may be black, white, or beyond the card. The change
    of cover (1 on the card, 0 beyond it) is given too. A cell is one black or white square of the tag.
    """

    points: NDArray[np.float64]
    """(n, 2) points in cells from the card's centre, x right, y up"""
    start: NDArray[np.int64]
    """(m,) index of each line's start point"""
    end: NDArray[np.int64]
    """(m,) index of each line's end point"""
    value: NDArray[np.float64]
    """(m,) grey levels inside minus outside"""
    cover: NDArray[np.float64]
    """(m,) cover inside minus outside: 1 or -1 on the card's rim, 0 within the card"""
    tag_cells: int
    """number of cells along an edge of the black square"""


@cache
def tag_lines(family: TagFamily, marker_id: int) -> Lines:
    """Boundary lines between black and white of a tag on its white card, and the card's rim.

    The lines are the longest straight runs with an equal step in grey level across them. They are cut into
    pieces of about two cells (squares of the tag), so that lens distortion can bend a line at its joints.
    Orientation as in OpenCV's detector: the first row of `generateImageMarker` is the top (+y), its first
    corner the top left (-x, +y).

    Args:
        family: family of tags (dictionary of codes).
        marker_id: id of the tag in its family.

    Returns:
        The pieces: start and end points, in cells from the card's centre, and the step in grey level across
        each.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, family.opencv))
    tag_cells = dictionary.markerSize + 2
    bits = cv2.aruco.generateImageMarker(dictionary, marker_id, tag_cells)
    cells = tag_cells + 2 * RIM_CELLS
    card = np.zeros((cells + 2, cells + 2))
    card[1:-1, 1:-1] = WHITE
    card[2:-2, 2:-2] = np.where(bits > 127, WHITE, BLACK)
    rows = _runs(np.diff(card, axis=0))
    columns = [(line, a, b, -step) for line, a, b, step in _runs(np.diff(card, axis=1).T)]
    half = cells / 2
    # Row boundaries run left to right with the inside below them, column boundaries top to bottom with the
    # inside on their left.
    runs = [((a - half, half - line), (b - half, half - line), step, line) for line, a, b, step in rows]
    runs += [((line - half, half - a), (line - half, half - b), step, line) for line, a, b, step in columns]
    first, last, step, line = (np.array(column) for column in zip(*runs, strict=True))
    pieces = np.maximum(1, np.round(np.abs(last - first).max(axis=1) / 2)).astype(int)
    points, start = cut_lines(first, last, pieces)
    cover = np.where(np.isin(line, [0, cells]), np.sign(step), 0.0)
    return Lines(points, start, start + 1, np.repeat(step, pieces), np.repeat(cover, pieces), tag_cells)


def _runs(steps: NDArray[np.float64]) -> list[tuple[int, int, int, float]]:
    """Runs of equal non-zero steps in grey level along the grid lines between the cells of a tag's card.

    Args:
        steps: (l, c) steps across l grid lines, at c cells (squares) along each; the first and last cell of a
            line lie outside the card.

    Returns:
        For each run: number of the grid line, first and last grid point of the run (0 at the card's edge),
        and step in grey level.
    """
    found = []
    for line, row in enumerate(steps):
        edges = np.concatenate([[0], np.flatnonzero(np.diff(row)) + 1, [len(row)]])
        found += [(line, int(a) - 1, int(b) - 1, float(row[a])) for a, b in pairwise(edges) if row[a] != 0]
    return found
