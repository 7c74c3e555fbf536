"""Motion of a camera that should stand still, from what its image shows beside the object.

Points of the background along the image's left, right and upper border are followed from one image to
another. If the camera stood still they stay; if it was bumped they move together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from analyze.types import Array

BORDER = 0.16
"""width of the searched strips, relative to the image's width (left, right) and height (top)"""
MIN_POINTS = 12
"""least number of points that must be followed in both images"""
MIN_SHARE = 0.6
"""least share of the followed points that must stay, or move together"""
STILL_PX, TOGETHER_PX = 0.7, 0.7
"""shift up to which a point stays [px], and misfit up to which it moves with the others [px]"""
RETURN_PX = 0.3
"""largest distance from its start [px] at which a point, followed to the later image and back, arrives"""
MAX_TURN = math.radians(8.0)
"""largest rotation of the image [rad]; above it something else was followed"""
SEARCHED_PX = 700
"""largest side of the images that are compared [px]; larger ones are reduced"""


@dataclass(frozen=True)
class CameraShift:
    """Shift and rotation of the background between two images of one camera."""

    pixels: float
    """root mean square shift over the image's borders [px]"""
    turn: float
    """rotation in the image [rad]"""


def camera_shift(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> CameraShift | None:
    """Shift of the background between two images of a camera that should stand still.

    Args:
        before: (height, width) grey values.
        after: (height, width) grey values of the later image, of the same size.

    Returns:
        Root mean square shift [px of the images given] and rotation [rad] of the background in the image, if
        it moved as a whole; None if it stayed, or shows too little for an answer.
    """
    scale = max(1.0, max(before.shape) / SEARCHED_PX)
    first, second = (_reduced(image, scale) for image in (before, after))
    start, end = _followed(first, second)
    if len(start) < MIN_POINTS:
        return None
    moved: Array = np.linalg.norm(end - start, axis=1) * scale
    if np.mean(moved < STILL_PX) > 1 - MIN_SHARE:
        return None
    fit, inside = cv2.estimateAffinePartial2D(start, end, ransacReprojThreshold=TOGETHER_PX)
    # OpenCV gives None where it finds no fit, which its types deny.
    if fit is None or np.mean(inside) < MIN_SHARE:  # pyright: ignore[reportUnnecessaryComparison]
        return None
    turn = math.atan2(float(fit[1, 0]), float(fit[0, 0]))
    if abs(turn) > MAX_TURN:
        return None
    pixels = math.sqrt(float(np.mean(moved[inside[:, 0] > 0] ** 2)))
    return CameraShift(pixels, turn) if pixels > STILL_PX else None


def _reduced(image: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    """Grey image (height, width) with both sides reduced by the factor `scale`; not scaled if it is 1."""
    if scale == 1.0:
        return np.ascontiguousarray(image)
    size = round(image.shape[1] / scale), round(image.shape[0] / scale)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _followed(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> tuple[Array, Array]:
    """Places (n, 2), (n, 2) [px] in two images of the border's points that were followed there and back."""
    none = np.zeros((0, 2)), np.zeros((0, 2))
    height, width = first.shape
    mask = np.zeros(first.shape, np.uint8)
    strip, top = round(BORDER * width), round(BORDER * height)
    mask[:, :strip] = mask[:, -strip:] = mask[:top] = 255
    corners = cv2.goodFeaturesToTrack(first, 120, 0.02, 8, mask=mask)
    # OpenCV gives None where it finds no corner, which its types deny.
    if corners is None:  # pyright: ignore[reportUnnecessaryComparison]
        return none
    # The last argument is only the place for the result.
    there, found, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, corners.copy())
    back, refound, _ = cv2.calcOpticalFlowPyrLK(second, first, there, corners.copy())
    error = np.linalg.norm((back - corners)[:, 0], axis=1)
    kept = (found[:, 0] > 0) & (refound[:, 0] > 0) & (error < RETURN_PX)
    return corners[kept, 0].astype(np.float64), there[kept, 0].astype(np.float64)
