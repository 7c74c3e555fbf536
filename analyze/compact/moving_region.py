"""Moving region of a strike's images, and the noise of their pixels.

The region is the convex hull of all pixels that change beyond noise in some images, with a margin: it holds
the object wherever it is in these, with the plain parts of its faces, which do not change.
"""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from bisect import bisect_left
from itertools import islice, pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

SQUARE_PX = 8
"""edge of the squares that make up a region [px]"""
_REDUCTION, _REDUCED_SQUARE = 4, 2
"""pixels of an image in one, each way, of the reduced images in which changes are sought; edge of a square
there"""
_FINE = 16
"""steps of a grey level in the reduced images: rounding would hide what blur leaves of the noise"""
_BLUR_PX = 3.0
"""1 sigma of the blur, the reduction's included, by which noise is held down [px]"""
_CHANGED_SDS = 8.0
"""range of the blurred values in a strike, over their noise, from which on a pixel has changed"""
_LEAST_CHANGE = 3.0
"""the same [grey]: lamps flicker"""
_LEAST_REDUCED_PX = 3
"""changed pixels in one piece, in the reduced images, below which they are noise"""
BLOCK, _GROUP, _BESIDE = 8, 4, 4
"""number of images with one region, of those in a group, and of the groups before and after them that count
too: near its turning point an object hardly moves, and only its edges would be seen"""
_MOVING_SHARE = 0.25
"""size of a block's region, over the largest one of the strike, from which on the object moves all over"""
_MARGIN = 0.025
"""margin of the region, over the image's width"""
_LEAST_NOISE = 0.5
"""least noise [grey]: rounding to whole grey levels has 0.3"""


def noise_sd(images: Iterable[NDArray[np.uint8]]) -> float:
    """Standard deviation of the pixels' noise [grey], by the differences of images (h, w) that follow on.

    It is the median over the pixels, so that what moves hardly counts.
    """
    spread: list[float] = []
    for one, other in pairwise(images):
        off = cv2.absdiff(one, other)
        # Of whole grey levels a median is a whole number: the mean of those near it has fractions.
        spread.append(float(np.mean(np.minimum(off, 4 * np.median(off) + 2))))
    return max(float(np.median(spread)) * math.sqrt(math.pi) / 2.0, _LEAST_NOISE) if spread else _LEAST_NOISE


def whole_squares(squares: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """True (h, w) for the pixels of an image in squares (h / `SQUARE_PX`, w / `SQUARE_PX`, rounded up)."""
    return np.kron(squares, np.ones((SQUARE_PX, SQUARE_PX), np.bool_))[: shape[0], : shape[1]]


def moving_regions(images: Iterable[NDArray[np.uint8]], noise: float) -> list[NDArray[np.bool_]] | None:
    """True for the squares where the object may be, in every block of `BLOCK` images; None if all rests.

    While it moves it is where the images of the block and of some beside it differ. While it rests, or hardly
    moves, so that only some of its edges are seen to change, it is where it moves before and afterwards too.

    Args:
        images: (h, w) images of one strike, taken one by one.
        noise: standard deviation of a pixel's noise [grey].
    """
    limit = max(_CHANGED_SDS * noise / (2.0 * math.sqrt(math.pi) * _BLUR_PX), _LEAST_CHANGE)
    least: list[NDArray[np.uint16]] = []
    most: list[NDArray[np.uint16]] = []
    stream = iter(images)
    while reduced := [_reduced(image) for image in islice(stream, _GROUP)]:
        least.append(np.min(reduced, axis=0))
        most.append(np.max(reduced, axis=0))
    changed: list[NDArray[np.bool_]] = []
    for first in range(0, len(least), BLOCK // _GROUP):
        near = slice(max(first - _BESIDE, 0), first + BLOCK // _GROUP + _BESIDE)
        changed.append(_changed(least[near], most[near], limit))
    sizes = [int(np.count_nonzero(region)) for region in changed]
    moving = [number for number, size in enumerate(sizes) if size > _MOVING_SHARE * max(sizes)]
    if not moving:
        return None
    at_rest: dict[int, NDArray[np.bool_]] = {}  # one array for all blocks of a rest
    found: list[NDArray[np.bool_]] = []
    for number, region in enumerate(changed):
        after = bisect_left(moving, number)
        if moving[after : after + 1] != [number]:
            if after not in at_rest:
                beside = moving[max(after - 1, 0) : after + 1]
                at_rest[after] = np.any([changed[each] for each in beside], axis=0)
            resting = at_rest[after]
            found.append(resting | region if sizes[number] else resting)
        else:
            found.append(region)
    return found


def _reduced(image: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Image (h / 4, w / 4) [grey / 16], blurred, made up to whole squares."""
    height, width = image.shape
    whole = cv2.copyMakeBorder(image, 0, -height % SQUARE_PX, 0, -width % SQUARE_PX, cv2.BORDER_REPLICATE)
    size = whole.shape[1] // _REDUCTION, whole.shape[0] // _REDUCTION
    small = cv2.resize(whole.astype(np.uint16) * _FINE, size, interpolation=cv2.INTER_AREA)
    left_px = math.sqrt(_BLUR_PX**2 - _REDUCTION**2 / 12.0)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), left_px / _REDUCTION), np.uint16)


def _changed(
    least: Sequence[NDArray[np.uint16]], most: Sequence[NDArray[np.uint16]], limit: float
) -> NDArray[np.bool_]:
    """Hull, with a margin and in whole squares, of what changes in reduced images; empty if nothing does.

    Args:
        least: least values (h, w) of groups of images [grey / 16].
        most: largest values (h, w) of the same.
        limit: change beyond noise [grey].
    """
    span = np.max(most, axis=0) - np.min(least, axis=0)
    changed = (span > _FINE * limit).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(changed)
    large = [number for number in range(1, count) if stats[number, cv2.CC_STAT_AREA] >= _LEAST_REDUCED_PX]
    rows, columns = np.nonzero(np.isin(labels, large))
    region = np.zeros(changed.shape, np.uint8)
    if len(rows):
        cv2.fillConvexPoly(region, cv2.convexHull(np.column_stack([columns, rows]).astype(np.int32)), 1)
    margin = max(round(_MARGIN * changed.shape[1]), 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    high, across = (size // _REDUCED_SQUARE for size in changed.shape)
    return (
        cv2.dilate(region, kernel)
        .reshape(high, _REDUCED_SQUARE, across, _REDUCED_SQUARE)
        .any(axis=(1, 3))
    )
