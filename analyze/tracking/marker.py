"""Finding 36h11 markers in an image, and checking who a known square is.

OpenCV finds the squares and reads their code; its corners serve as a start only. Measured on OpenCV 5.0 with rendered tags of known
corners: CORNER_REFINE_APRILTAG is biased by +0.45 px in x and y, SUBPIX and CONTOUR have no bias but 0.2-0.5 px of noise; the edge
fit of `edges` has 0.011 px and none.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array

_CELLS = 8
_WRONG_CELLS = 6
"""cells that may read wrong in a square whose place is already known; two ids differ in 11 or more"""


@dataclass(frozen=True)
class Sighting:
    """A marker as OpenCV sees it: raw px, good to about half a pixel."""

    marker_id: int
    corners_px: Array
    """(4, 2) top-left, top-right, bottom-right, bottom-left of the marker"""


@cache
def _dictionary() -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


@cache
def _detector() -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    # One wrong bit of 36: enough for noise, and random patches do not become markers.
    parameters.errorCorrectionRate = 0.3
    parameters.minMarkerPerimeterRate = 0.05
    # Two windows suit tags of 30 to 200 px; the constant keeps sensor noise on flat areas from becoming thousands of contours.
    parameters.adaptiveThreshWinSizeMin = 15
    parameters.adaptiveThreshWinSizeMax = 39
    parameters.adaptiveThreshWinSizeStep = 24
    parameters.adaptiveThreshConstant = 10
    # The default 0.125 merges a large tag with quads of its own code and then keeps the wrong one (4 % of 120 px tags were missed).
    parameters.minMarkerDistanceRate = 0.05
    return cv2.aruco.ArucoDetector(_dictionary(), parameters)


@cache
def _cells(marker_id: int) -> NDArray[np.bool_]:
    return np.asarray(cv2.aruco.generateImageMarker(_dictionary(), marker_id, _CELLS)) > 127


def detect(image: NDArray[np.uint8], origin: tuple[int, int] = (0, 0)) -> list[Sighting]:
    """All markers in `image`; `origin` (column, row) is added to their corners.

    One marker found twice in the same place (outer and inner contour) is reported once, the larger one.
    """
    corners, ids, _ = _detector().detectMarkers(np.ascontiguousarray(image))
    if ids is None:
        return []
    found: list[Sighting] = []
    for quad, marker_id in sorted(zip(corners, np.ravel(ids), strict=True), key=lambda item: -cv2.contourArea(item[0][0])):
        points = np.asarray(quad[0], dtype=float) + origin
        centre, reach = points.mean(axis=0), 0.5 * np.ptp(points, axis=0).max()
        if any(s.marker_id == marker_id and np.max(np.abs(s.corners_px.mean(axis=0) - centre)) < reach for s in found):
            continue
        found.append(Sighting(int(marker_id), points))
    return found


def is_marker(image: NDArray[np.uint8], corners_px: Array, marker_id: int) -> bool:
    """Whether the square with these raw corners (4, 2) shows this marker, in this orientation."""
    centre = (np.arange(_CELLS) + 0.5) / _CELLS
    x, y = np.meshgrid(centre, centre)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    H = cv2.getPerspectiveTransform(square, corners_px.astype(np.float32))
    points = np.stack([x, y, np.ones_like(x)], axis=-1) @ H.T
    column = np.rint(points[..., 0] / points[..., 2]).astype(int)
    row = np.rint(points[..., 1] / points[..., 2]).astype(int)
    if column.min() < 0 or row.min() < 0 or column.max() >= image.shape[1] or row.max() >= image.shape[0]:
        return False
    grey = image[row, column].astype(float)
    code = _cells(marker_id)
    threshold = 0.5 * (grey[code].mean() + grey[~code].mean())
    return int(np.count_nonzero((grey > threshold) != code)) <= _WRONG_CELLS
