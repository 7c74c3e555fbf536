"""Pixels along the edges of a square in an image, to which the edges are fitted (edges.py)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.tracking.camera_model import PixelMap
    from analyze.types import Array, IntArray

HALF_BAND = 4
"""number of rows (or columns) on either side of the edge"""
_REACH_PX = 2.6
"""distance from the edge [px] beyond which a pixel carries no information on its position"""
NEXT = np.array([1, 2, 3, 0])
"""index of the corner that follows each corner of a square"""
_EDGE = np.arange(4)
_ACROSS = np.arange(-HALF_BAND, HALF_BAND + 1)


@dataclass(frozen=True)
class EdgeBand:
    """Pixels along a square's four edges, s per edge, with their coordinates along and across the edge."""

    corners_ideal: Array
    """(4, 2) corners of the square around which the band lies [ideal px]"""
    corners_raw: Array
    """(4, 2) corners of the same square in the distorted image [raw px]"""
    index: IntArray
    """(4, s) index of the pixels in the image, row by row"""
    t: Array
    """(4, s) coordinate along each edge, from -1 to 1"""
    v: Array
    """(4, s) distance out of the square [ideal px]"""
    valid: NDArray[np.bool_]
    """(4, s) True for a pixel that is used"""
    window: tuple[float, float]
    """middle and half width of the range of v that is fitted [px]"""
    middle: Array
    """(4, 2) middle of the edges [ideal px]"""
    along: Array
    """(4, 2) unit vectors along the edges"""
    outward: Array
    """(4, 2) unit vectors out of the square"""
    half: Array
    """(4,) half the edges' lengths [ideal px]"""


def edge_band(
    shape: tuple[int, ...], pixels: PixelMap, corners_ideal: Array, corners_raw: Array, end_margin: float
) -> EdgeBand | None:
    """Pixels near each edge of a square; None if an edge is too short, too long, or outside the image.

    Too short is below 6 px, too long above 2000 px, measured along the image's rows or columns, whichever are
    nearer to the edge's direction. An edge is outside if the image lacks more than a tenth of its pixels.

    Args:
        shape: height and width of the image [px].
        pixels: ideal coordinates of the pixel centres.
        corners_ideal: (4, 2) corners around which the band lies [ideal px].
        corners_raw: (4, 2) these corners in the image [raw px].
        end_margin: stretch left out at each end of an edge [px], limited to an eighth of the shortest edge.
    """
    taken = _pixels_along(shape, corners_raw)
    if taken is None:
        return None
    index, valid = taken
    start = corners_ideal
    stop = start[NEXT]
    along = stop - start
    length = np.hypot(along[:, 0], along[:, 1])
    along /= length[:, None]
    area = float(np.sum(start[:, 0] * stop[:, 1] - stop[:, 0] * start[:, 1]))
    # y points down: a positive area is clockwise on the screen, and (dy, -dx) points out of the square.
    outward = along[:, ::-1] * (np.array([1.0, -1.0]) * math.copysign(1.0, area))
    middle = 0.5 * (start + stop)
    half = 0.5 * length
    points = pixels.ideal.reshape(-1, 2).take(index, axis=0)
    tv = (points - middle[:, None, :]) @ np.stack([along / half[:, None], outward], axis=-1)
    t, v = np.ascontiguousarray(tv[..., 0]), np.ascontiguousarray(tv[..., 1])
    cell = float(length.min()) / 8.0
    inner = min(_REACH_PX, 0.8 * cell)
    outer = min(_REACH_PX, 0.7 * cell)
    valid &= np.abs(t) < (1.0 - min(end_margin, cell) / half)[:, None]
    window = 0.5 * (outer - inner), 0.5 * (outer + inner)
    return EdgeBand(corners_ideal, corners_raw, index, t, v, valid, window, middle, along, outward, half)


def _pixels_along(shape: tuple[int, ...], corners_raw: Array) -> tuple[IntArray, NDArray[np.bool_]] | None:
    """Pixels in a band along a square's four edges: index (4, s) in the flattened image, mask (4, s).

    s is the number of pixels of the longest edge's band. The mask is True for pixels to use: it is False
    outside the image, and where a shorter edge repeats its last pixels. None if more than a tenth of an
    edge's band lies outside the image, or if an edge extends over less than 6 px or more than 2000 px along
    the image's rows or columns, whichever are nearer to its direction.

    Args:
        shape: height and width of the image [px].
        corners_raw: (4, 2) corners of the square [raw px].
    """
    height, width = shape
    start, stop = corners_raw, corners_raw[NEXT]
    delta = stop - start
    steep = np.abs(delta[:, 1]) > np.abs(delta[:, 0])
    major = steep.astype(np.intp)
    from_major, to_major = start[_EDGE, major], stop[_EDGE, major]
    low, high = np.minimum(from_major, to_major), np.maximum(from_major, to_major)
    extent = high - low
    if not (extent.min() >= 6.0 and extent.max() <= 2000.0):
        return None
    first = np.ceil(low)
    last = np.floor(high)
    steps = np.arange(int((last - first).max()) + 1)
    # Shorter edges repeat their last pixel, unused: beyond it the image may end, as below a tag seen from the
    # side.
    along = np.minimum(first[:, None] + steps, last[:, None])
    slope = delta[_EDGE, 1 - major] / delta[_EDGE, major]
    across = start[_EDGE, 1 - major][:, None] + slope[:, None] * (along - from_major[:, None])
    middle = np.rint(across).astype(np.intp)
    used = (steps <= (last - first)[:, None]).repeat(len(_ACROSS), axis=1)
    along_px = along.astype(np.intp)
    (left, top), (right, bottom) = corners_raw.min(axis=0), corners_raw.max(axis=0)
    reach = HALF_BAND + 2
    if left < reach or top < reach or right > width - 1 - reach or bottom > height - 1 - reach:
        along_px, middle = _within(
            along_px, middle, used, np.where(steep, height, width), np.where(steep, width, height)
        )
        if np.any(used.sum(axis=1) < 0.9 * len(_ACROSS) * (last - first + 1)):
            return None
    step_across = np.where(steep, 1, width)[:, None]
    index = along_px * np.where(steep, width, 1)[:, None] + middle * step_across
    index = (index[..., None] + step_across[..., None] * _ACROSS).reshape(4, -1)
    return index, used


def _within(
    along: IntArray, middle: IntArray, used: NDArray[np.bool_], length: IntArray, breadth: IntArray
) -> tuple[IntArray, IntArray]:
    """Clip the pixels of four edges' bands to the image, and clear `used` for those beyond it.

    A band consists of n cross-rows of nine pixels, one for each step along the edge; the main direction of an
    edge is along the image's rows or its columns, whichever is nearer to it.

    Args:
        along: (4, n) coordinate, in the main direction, of each cross-row's middle pixel [px].
        middle: (4, n) coordinate of these pixels across the main direction [px].
        used: (4, 9 n) True for a pixel that is used, changed in place.
        length: (4,) size of the image in the main direction of each edge [px].
        breadth: (4,) size of the image across it [px].

    Returns:
        `along` and `middle` (4, n), clipped.
    """
    across = middle[..., None] + _ACROSS
    inside = (
        (along >= 0)[..., None]
        & (along < length[:, None])[..., None]
        & (across >= 0)
        & (across < breadth[:, None, None])
    )
    used &= inside.reshape(4, -1)
    kept = np.clip(middle, HALF_BAND, breadth[:, None] - 1 - HALF_BAND)
    return np.clip(along, 0, length[:, None] - 1), kept
