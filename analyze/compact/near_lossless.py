"""Images changed within the camera's noise: exact where they show structure, local means where they do not.

What an image tells of a motion is the squared gradient of its grey values over the variance of their noise,
summed over its pixels (Fisher information of a displacement). Edges hold nearly all of it: their pixels stay
as they are, with their noise. Flat parts hold none, and most of the noise, which is what no coding shortens.
"""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_CHANGE_SD = 5.0
"""largest change of a pixel over the standard deviation of the noise"""
_OUTLIER_STEP_SD = 4.0
"""step of the grey values of pixels that differ more from their local mean, over the noise"""
_WHITE = 255
_BLUR_PX = 1.5
"""1 sigma of the blur by which gradients are measured [px]"""
_GRADIENT_SDS = 5.0
"""least gradient of structure over the standard deviation of one by noise: a false one in some images"""
_MARGIN_PX = 4
"""distance from structure up to which pixels are exact [px]: fits of edges use what is beside them"""
_SQUARE_PX = 8
"""edge of a square with one local mean [px]"""
_MEAN_BLUR_SQUARES = 0.5
"""1 sigma of the blur of the local means [squares]"""


def within_noise(
    image: NDArray[np.uint8], noise_sd: float, kept: NDArray[np.bool_] | None, information_share: float
) -> NDArray[np.uint8]:
    """Image (h, w) with local means for the pixels without structure; none changes beyond `MAX_CHANGE_SD`.

    Args:
        image: (h, w) grey values.
        noise_sd: standard deviation of a pixel's noise [grey].
        kept: (h, w) True where the image counts; None for all of it.
        information_share: share of the information on motion that exact pixels hold.
    """
    exact = _structure(image, noise_sd, kept, information_share)
    flat = ~exact if kept is None else kept & ~exact
    means = _local_means(image, flat)
    off = image.astype(np.int16) - means
    far = np.abs(off) > MAX_CHANGE_SD * noise_sd
    step = _OUTLIER_STEP_SD * noise_sd
    means[far] = np.clip(means[far] + np.rint(np.rint(off[far] / step) * step), 0, _WHITE).astype(np.uint8)
    return np.where(exact, image, means)


def _structure(
    image: NDArray[np.uint8], noise_sd: float, kept: NDArray[np.bool_] | None, information_share: float
) -> NDArray[np.bool_]:
    """True (h, w) near the steepest pixels, which hold the given share of the information on motion."""
    soft = cv2.GaussianBlur(image.astype(np.float32), (0, 0), _BLUR_PX)
    energy = cv2.Sobel(soft, cv2.CV_32F, 1, 0, ksize=1, scale=0.5) ** 2
    energy += cv2.Sobel(soft, cv2.CV_32F, 0, 1, ksize=1, scale=0.5) ** 2
    if kept is not None:
        energy *= kept
    by_noise = noise_sd / (math.sqrt(8.0 * math.pi) * _BLUR_PX**2)
    steep = energy > (_GRADIENT_SDS * by_noise) ** 2
    found = np.sort(energy[steep])[::-1]
    if len(found):
        held = np.cumsum(found, dtype=np.float64)
        last = int(np.searchsorted(held, information_share * held[-1]))
        steep &= energy >= found[min(last, len(found) - 1)]
    size = 2 * _MARGIN_PX + 1
    near = cv2.dilate(steep.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)))
    return near.astype(np.bool_)


def _local_means(image: NDArray[np.uint8], flat: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Mean (h, w) [grey] of the flat pixels in and about each square, rounded; 0 far from all of them."""
    height, width = image.shape
    squares = -(-width // _SQUARE_PX), -(-height // _SQUARE_PX)
    weight = np.zeros((squares[1] * _SQUARE_PX, squares[0] * _SQUARE_PX), np.float32)
    weight[:height, :width] = flat
    weighted = weight.copy()
    weighted[:height, :width] *= image
    total, count = (
        cv2.GaussianBlur(
            cv2.resize(values, squares, interpolation=cv2.INTER_AREA), (0, 0), _MEAN_BLUR_SQUARES
        )
        for values in (weighted, weight)
    )
    means = np.rint(total / np.maximum(count, np.finfo(np.float32).tiny)).astype(np.uint8)
    return np.kron(means, np.ones((_SQUARE_PX, _SQUARE_PX), np.uint8))[:height, :width]
