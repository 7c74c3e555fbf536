"""Exact area coverage of polygons: the fraction of each pixel that lies inside, exact up to rounding.

Every directed edge adds the signed area between itself and the image's right border; a running sum along the
rows turns edges into areas (the accumulation buffer of R. Levien's font-rs, 2016). The method is linear: the
boundary between two surfaces is one edge weighted by their difference, any number of surfaces and
sub-exposures share one buffer, and seams between neighbours vanish exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Box:
    """Rectangle of pixels: `left` <= column < `right`, `top` <= row < `bottom`."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def empty(self) -> bool:
        """True if the box contains no pixel."""
        return self.right <= self.left or self.bottom <= self.top

    @property
    def slices(self) -> tuple[slice, slice]:
        """Slices (rows, columns) that select the box in an image (height, width)."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def grown(self, margin: int, width: int, height: int) -> Box:
        """Box enlarged by `margin` px on every side, but within an image of width x height px."""
        return Box(
            left=max(self.left - margin, 0),
            top=max(self.top - margin, 0),
            right=min(self.right + margin, width),
            bottom=min(self.bottom + margin, height),
        )

    def within(self, outer: Box) -> tuple[slice, slice]:
        """Slices (rows, columns) of this box in an array that holds just the pixels of the box `outer`."""
        rows = slice(self.top - outer.top, self.bottom - outer.top)
        return rows, slice(self.left - outer.left, self.right - outer.left)


def box_around(points_px: NDArray[np.float64], width: int, height: int) -> Box:
    """Box of the pixels that the convex hull of points (n, 2) [px] can touch.

    It is cut off at the edges of an image of width x height px, and empty if all points lie beyond one edge
    of the image. Integer coordinates are pixel centres.
    """
    low, high = np.floor(points_px.min(axis=0) + 0.5), np.ceil(points_px.max(axis=0) + 0.5)
    return Box(max(int(low[0]), 0), max(int(low[1]), 0), min(int(high[0]), width), min(int(high[1]), height))


def coverage(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    weights: NDArray[np.float64],
    box: Box,
) -> tuple[NDArray[np.float32], ...]:
    """Sum over all polygons of weight times covered fraction, per pixel.

    The edges of a polygon run clockwise as seen in the image (x right, y down); counter-clockwise ones count
    negative. An edge between two polygons may be given once, with the difference of their weights.

    Args:
        start: (n, 2) start points of the edges [px], integer coordinates at pixel centres (OpenCV).
        end: (n, 2) end points of the edges [px].
        weights: (c, n) weights of the edges, for each of c images.
        box: the pixels to compute; edges may lie outside.

    Returns:
        c images (box height, box width), float32.
    """
    width, height = box.right - box.left, box.bottom - box.top
    x0, y0 = start[:, 0] - (box.left - 0.5), start[:, 1] - (box.top - 0.5)
    x1, y1 = end[:, 0] - (box.left - 0.5), end[:, 1] - (box.top - 0.5)
    down = y1 > y0
    slope = (x1 - x0) / np.where(y1 == y0, 1.0, y1 - y0)
    high_x, high_y, low_y = np.where(down, x0, x1), np.minimum(y0, y1), np.maximum(y0, y1)
    # Cut the edges into pieces within one row.
    first = np.clip(np.floor(high_y), 0, height).astype(np.int64)
    edge, row = _ragged_ranges(first, np.clip(np.ceil(low_y), 0, height).astype(np.int64) - first)
    top, bottom = np.maximum(high_y[edge], row), np.minimum(low_y[edge], row + 1)
    x_top = high_x[edge] + (top - high_y[edge]) * slope[edge]
    x_bottom = x_top + (bottom - top) * slope[edge]
    # Left of a clockwise polygon's rising edges is outside, left of its falling edges is inside.
    height_of_piece = np.where(down, -1.0, 1.0)[edge] * (bottom - top)
    left, right = np.minimum(x_top, x_bottom), np.maximum(x_top, x_bottom)
    first = np.floor(np.minimum(np.maximum(left, -1.0), width)).astype(np.int64)
    beyond = np.ceil(np.minimum(np.maximum(right, -1.0), width + 1.0)).astype(np.int64)
    # Most pieces of a steep edge lie within one pixel; the others are cut further. The outermost parts carry
    # what lies beyond the box.
    long = np.flatnonzero(beyond - first > 1)
    short = np.flatnonzero(beyond - first <= 1)
    cut, column = _ragged_ranges(first[long], (beyond - first)[long])
    piece = long[cut]
    begins = np.where(column == first[piece], left[piece], column)
    ends = np.where(column + 1 >= beyond[piece], right[piece], column + 1)
    share = (ends - begins) / (right - left)[piece]
    column = np.concatenate([first[short], column])
    middle = np.concatenate([0.5 * (left[short] + right[short]), 0.5 * (begins + ends)])
    signed = np.concatenate([height_of_piece[short], height_of_piece[piece] * share])
    piece = np.concatenate([short, piece])
    right_share = np.where(column < 0, 0.0, np.minimum(np.maximum(middle - column, 0.0), 1.0))
    signed[column >= width] = 0.0
    pixel = row[piece] * (width + 1) + np.minimum(np.maximum(column, 0), width - 1)
    owner = edge[piece]
    return tuple(
        _accumulate_coverage(pixel, signed * weight[owner], right_share, width, height) for weight in weights
    )


def _accumulate_coverage(
    pixel: NDArray[np.int64],
    area: NDArray[np.float64],
    right_share: NDArray[np.float64],
    width: int,
    height: int,
) -> NDArray[np.float32]:
    """Sum areas along the rows of an image (height, width): each pixel has all areas up to its column.

    These are its own areas and those of all pixels left of it in its row [px2].

    Args:
        pixel: (n,) pixel of each area, as row * (width + 1) + column.
        area: (n,) signed areas [px2].
        right_share: (n,) fraction of each area that is added to the pixel's right neighbour instead.
        width: width of the image.
        height: height of the image.
    """
    size = height * (width + 1)
    right = area * right_share
    jumps = np.bincount(pixel, area - right, size) + np.bincount(pixel + 1, right, size)
    # The difference of an integral image's rows is 10 times faster than numpy's cumsum.
    total = cv2.integral(jumps.reshape(height, width + 1)[:, :width], sdepth=cv2.CV_64F)
    return np.asarray(cv2.subtract(total[1:, 1:], total[:-1, 1:], dtype=cv2.CV_32F), np.float32)


def _ragged_ranges(
    first: NDArray[np.int64], count: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All integers of n ranges, one range after the other, with the number of the range of each.

    Args:
        first: (n,) first integer of each range.
        count: (n,) number of consecutive integers in each range; none if negative.

    Returns:
        For each of the m integers in all ranges: number of its range (m,), and the integer (m,).
    """
    count = np.maximum(count, 0)
    index = np.repeat(np.arange(len(count)), count)
    return index, np.arange(len(index)) + np.repeat(first - (np.cumsum(count) - count), count)
