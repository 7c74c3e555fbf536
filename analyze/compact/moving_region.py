"""Moving region of a strike's images, and the noise of their pixels.

The region is the convex hull of all pixels that change beyond noise in some images, with a margin: it holds
the object wherever it is in these, with the plain parts of its faces, which do not change.
"""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from bisect import bisect_left
from itertools import pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

_BLUR_PX = 3.0
"""1 sigma of the blur by which noise is held down [px]"""
_CHANGED = 8.0
"""range of the blurred values in a strike, over their noise, from which on a pixel has changed"""
_LEAST_CHANGE = 3.0
"""the same [grey]: lamps flicker"""
_LEAST_PX = 30
"""changed pixels in one piece below which they are noise"""
BLOCK, _GROUP, _BESIDE = 8, 4, 4
"""number of images with one region, of those in a group, and of the groups before and after them that count
too: near its turning point an object hardly moves, and only its edges would be seen"""
_JPEG_PX = 8
"""edge of a block of JPEG [px]"""
_MARGIN = 0.025
"""margin of the region, over the image's width"""
_LEAST_NOISE = 0.5
"""least noise [grey]: rounding to whole grey levels has 0.3"""


def noise_sd(images: Sequence[NDArray[np.uint8]]) -> float:
    """Standard deviation of the pixels' noise [grey], by the differences of images (h, w) that follow on.

    It is the median over the pixels, so that what moves hardly counts.
    """
    off = [np.abs(after.astype(np.int16) - before) for before, after in pairwise(images)]
    # Of whole grey levels a median is a whole number: the mean of those near it has fractions.
    spread = [float(np.mean(np.minimum(each, 4 * np.median(each) + 2))) for each in off]
    return max(float(np.median(spread)) * math.sqrt(math.pi) / 2.0, _LEAST_NOISE) if off else _LEAST_NOISE


def moving_regions(images: Sequence[NDArray[np.uint8]], noise: float) -> list[NDArray[np.bool_]] | None:
    """True (h, w) where the object may be, in every block of `BLOCK` images of a strike; None if all rests.

    While it moves it is where the images of the block and of some beside it differ. While it rests it is
    where it begins to move, or where it came to rest.

    Args:
        images: (n,) images of one strike.
        noise: standard deviation of a pixel's noise [grey].
    """
    limit = max(_CHANGED * noise / (2.0 * math.sqrt(math.pi) * _BLUR_PX), _LEAST_CHANGE)
    least, most = [], []
    for first in range(0, len(images), _GROUP):
        soft = [cv2.GaussianBlur(image, (0, 0), _BLUR_PX) for image in images[first : first + _GROUP]]
        least.append(np.min(soft, axis=0))
        most.append(np.max(soft, axis=0))
    regions: list[NDArray[np.bool_] | None] = []
    for first in range(0, len(least), BLOCK // _GROUP):
        near = slice(max(first - _BESIDE, 0), first + BLOCK // _GROUP + _BESIDE)
        regions.append(_changed(least[near], most[near], limit))
    moving = [number for number, region in enumerate(regions) if region is not None]
    if not moving:
        return None
    found: list[NDArray[np.bool_]] = []
    for number, region in enumerate(regions):
        if region is None:
            at = bisect_left(moving, number)
            beside = [regions[each] for each in moving[max(at - 1, 0) : at + 1]]
            region = np.any([each for each in beside if each is not None], axis=0)  # noqa: PLW2901
        found.append(region)
    return found


def _changed(
    least: Sequence[NDArray[np.uint8]], most: Sequence[NDArray[np.uint8]], limit: float
) -> NDArray[np.bool_] | None:
    """Hull, with a margin and in whole blocks of JPEG, of what changes in blurred images; None if nothing.

    Args:
        least: least values (h, w) of groups of images.
        most: largest values (h, w) of the same.
        limit: change beyond noise [grey].
    """
    span = np.max(most, axis=0).astype(np.int16) - np.min(least, axis=0)
    changed = (span > limit).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(changed)
    large = [number for number in range(1, count) if stats[number, cv2.CC_STAT_AREA] >= _LEAST_PX]
    rows, columns = np.nonzero(np.isin(labels, large))
    if not len(rows):
        return None
    region = np.zeros(changed.shape, np.uint8)
    cv2.fillConvexPoly(region, cv2.convexHull(np.column_stack([columns, rows]).astype(np.int32)), 1)
    margin = max(round(_MARGIN * changed.shape[1]), 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    wide = cv2.dilate(region, kernel)
    high, across = (-(-size // _JPEG_PX) for size in wide.shape)
    padded = np.zeros((high * _JPEG_PX, across * _JPEG_PX), np.uint8)
    padded[: wide.shape[0], : wide.shape[1]] = wide
    squares = padded.reshape(high, _JPEG_PX, across, _JPEG_PX).any(axis=(1, 3))
    whole = np.kron(squares, np.ones((_JPEG_PX, _JPEG_PX), np.bool_))
    return whole[: wide.shape[0], : wide.shape[1]]
