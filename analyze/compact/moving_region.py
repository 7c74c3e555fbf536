"""Moving region of a strike's images, and the noise of their pixels.

The region is the convex hull of all pixels that change beyond noise at some time, with a margin: it holds the
object from its rest to its landing, with the plain parts of its faces, which do not change.
"""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from itertools import islice, pairwise
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

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
"""range of the blurred values in two groups of images, over their noise, from which on a pixel has changed"""
_LEAST_CHANGE = 3.0
"""the same [grey]: lamps flicker"""
_LEAST_REDUCED_PX = 3
"""changed pixels in one piece, in the reduced images, below which they are noise"""
_GROUP = 16
"""number of images in a group; changes are sought from one group to the next, as lamps drift"""
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


def moving_region(images: Iterable[NDArray[np.uint8]], noise: float) -> NDArray[np.bool_] | None:
    """True for the squares in which the object moves or rests in a strike's images; None if nothing moves.

    Args:
        images: (h, w) images of one strike, taken one by one.
        noise: standard deviation of a pixel's noise [grey].
    """
    limit = _FINE * max(_CHANGED_SDS * noise / (2.0 * math.sqrt(math.pi) * _BLUR_PX), _LEAST_CHANGE)
    changed: NDArray[np.bool_] | None = None
    groups: list[tuple[NDArray[np.uint16], NDArray[np.uint16]]] = []
    stream = iter(images)
    while reduced := [_reduced(image) for image in islice(stream, _GROUP)]:
        groups = [*groups[-1:], (np.min(reduced, axis=0), np.max(reduced, axis=0))]
        least, most = (np.array(each) for each in zip(*groups, strict=True))
        beyond = most.max(axis=0) - least.min(axis=0) > limit
        changed = beyond if changed is None else changed | beyond
    return None if changed is None else _hull(changed)


def _reduced(image: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Image (h / 4, w / 4) [grey / 16], blurred, made up to whole squares."""
    height, width = image.shape
    whole = cv2.copyMakeBorder(image, 0, -height % SQUARE_PX, 0, -width % SQUARE_PX, cv2.BORDER_REPLICATE)
    size = whole.shape[1] // _REDUCTION, whole.shape[0] // _REDUCTION
    small = cv2.resize(whole.astype(np.uint16) * _FINE, size, interpolation=cv2.INTER_AREA)
    left_px = math.sqrt(_BLUR_PX**2 - _REDUCTION**2 / 12.0)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), left_px / _REDUCTION), np.uint16)


def _hull(changed: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
    """Convex hull, with a margin and in whole squares, of the changed pixels (h, w) of reduced images."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(changed.astype(np.uint8))
    large = [number for number in range(1, count) if stats[number, cv2.CC_STAT_AREA] >= _LEAST_REDUCED_PX]
    rows, columns = np.nonzero(np.isin(labels, large))
    if not len(rows):
        return None
    region = np.zeros(changed.shape, np.uint8)
    cv2.fillConvexPoly(region, cv2.convexHull(np.column_stack([columns, rows]).astype(np.int32)), 1)
    margin = max(round(_MARGIN * changed.shape[1]), 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    high, across = (size // _REDUCED_SQUARE for size in changed.shape)
    wide = cv2.dilate(region, kernel).reshape(high, _REDUCED_SQUARE, across, _REDUCED_SQUARE)
    return np.asarray(wide.any(axis=(1, 3)), np.bool_)
