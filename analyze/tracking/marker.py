"""Detection of square markers in an image, and verification of a known marker's code.

OpenCV finds the squares and reads their code; its corners serve only as a start for the edge fit of the
module `edges`. Measured on OpenCV 5.0 with rendered tags of known corners: of OpenCV's own methods,
CORNER_REFINE_APRILTAG is biased by +0.45 px in x and y, SUBPIX and CONTOUR have no bias but 0.2-0.5 px of
noise; the edge fit has 0.011 px of noise and no bias.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from schemas.tags import USUAL_FAMILY, TagFamily, family_and_id, marker_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from analyze.types import Array

_OTHER_FAMILIES = tuple(
    TagFamily(name)
    for name in ("36h11", "36h10", "25h9", "mip_36h12", "5x5_100", "6x6_100", "7x7_100", "4x4_50")
)
"""families searched if no marker was found, the most reliable first, to report a printed marker of another
family than the object file states"""
_PERIMETER_RATE = 0.05
"""least perimeter of a marker's outline, over the longer side of the image"""
_UNIT_SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)


@dataclass(frozen=True)
class Sighting:
    """Marker as OpenCV detects it in an image, with corners accurate to about half a pixel."""

    marker_id: int | str
    """name of the marker: its number in family 36h11, otherwise family and number, for example "25h9-3" for
    number 3 of 25h9"""
    corners_px: Array
    """(4, 2) raw px: top-left, top-right, bottom-right, bottom-left of the marker"""


def families_of(names: Iterable[int | str]) -> tuple[TagFamily, ...]:
    """Families (code dictionaries) of the named markers, sorted; the usual 36h11 if no marker is named."""
    return tuple(sorted({family_and_id(name)[0] for name in names})) or (USUAL_FAMILY,)


@cache
def _dictionary(family: TagFamily) -> cv2.aruco.Dictionary:
    """Code dictionary of a marker family in OpenCV; cached."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, family.opencv))


@cache
def _detector(
    families: tuple[TagFamily, ...], perimeter_rate: float = _PERIMETER_RATE
) -> cv2.aruco.ArucoDetector:
    """Detector of OpenCV for the markers of these families, of a least perimeter over the image's; cached."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    # One wrong bit of 36 (none of 16 or 25) allows for noise without turning random patches into markers.
    parameters.errorCorrectionRate = 0.3
    parameters.minMarkerPerimeterRate = perimeter_rate
    # Two windows suit tags of 30 to 200 px; the constant keeps sensor noise on flat areas from becoming
    # thousands of contours.
    parameters.adaptiveThreshWinSizeMin = 15
    parameters.adaptiveThreshWinSizeMax = 39
    parameters.adaptiveThreshWinSizeStep = 24
    parameters.adaptiveThreshConstant = 10
    # The default 0.125 merges a large tag with quads of its own code and then keeps the wrong one (4 % of 120
    # px tags were missed).
    parameters.minMarkerDistanceRate = 0.05
    return cv2.aruco.ArucoDetector([_dictionary(family) for family in families], parameters)


@dataclass(frozen=True)
class _CodePattern:
    """Cells (black and white fields) of one marker, prepared for the verification of its code in an image."""

    code: NDArray[np.bool_]
    """(n,) True for a white cell"""
    centres: Array
    """(n, 3) centres of the cells, homogeneous, with the black square from (0, 0) to (1, 1)"""
    means: Array
    """(2, n) weights for the means of the white and of the black cells"""
    wrong: int
    """number of cells that may be misread"""


@cache
def _code_pattern(name: int | str) -> _CodePattern:
    """White and black cells (fields) of the named marker, in the form used to verify its code; cached.

    The form is the cells' colours, centres, weights for the means of both colours, and the number of cells
    that may be misread.
    """
    family, tag_id = family_and_id(name)
    dictionary = _dictionary(family)
    across = dictionary.markerSize + 2  # with the black border
    white = np.asarray(cv2.aruco.generateImageMarker(dictionary, tag_id, across)).ravel() > 127
    centre = (np.arange(across) + 0.5) / across
    x, y = np.meshgrid(centre, centre)
    means = np.stack([white / white.sum(), ~white / (~white).sum()])
    centres = np.stack([x.ravel(), y.ravel(), np.ones(white.size)], axis=-1)
    return _CodePattern(white, centres, means, wrong_cells(family))


@cache
def wrong_cells(family: TagFamily) -> int:
    """Number of cells (black or white fields) of a known tag that may be misread, for its family; cached.

    It is half the family's code distance, rounded up. The code distance is the least number of cells in which
    two tags, or a tag and itself turned, differ.
    """
    codes = np.asarray(_dictionary(family).bytesList, dtype=np.uint8)
    many = len(codes)
    # (tag, turn by 90 degrees, byte): OpenCV keeps each code in all four orientations.
    codes = codes.reshape(many, 4, -1)
    least = 8 * codes.shape[2]
    for turn in range(4):
        differ = np.bitwise_count(codes[:, None, 0] ^ codes[None, :, turn]).sum(axis=2, dtype=np.int64)
        if turn == 0:
            differ[np.arange(many), np.arange(many)] = least
        least = min(least, int(differ.min()))
    return (least + 1) // 2


def detect(
    image: NDArray[np.uint8],
    families: Sequence[TagFamily] = (USUAL_FAMILY,),
    origin: tuple[int, int] = (0, 0),
    least_perimeter_px: float = 0.0,
) -> list[Sighting]:
    """Detect all markers of some families in an image.

    A marker found twice at the same place (by outer and inner contour) is reported once, by its larger
    contour.

    Args:
        image: (height, width) grey values, of a whole image or a part of it.
        families: families (code dictionaries) that are searched.
        origin: column and row of the part in the whole image [px], added to the corners.
        least_perimeter_px: least perimeter of a marker's outline [px]; in a small part of a textured image
            the thousands of outlines that are too small for a marker take most of the time.

    Returns:
        The markers with name and corners [raw px], the largest first; a name occurs more than once if it is
        in view at several places. Empty if there is none.
    """
    families = tuple(families)
    # Squares are searched once, whatever the number of families; each is then read as every family.
    # In steps, as a detector is kept for each rate.
    rate = max(_PERIMETER_RATE, np.floor(20.0 * least_perimeter_px / max(image.shape)) / 20.0)
    corners, ids, _, which = _detector(families, float(rate)).detectMarkersMultiDict(
        np.ascontiguousarray(image)
    )
    if len(corners) == 0:
        return []
    found: list[Sighting] = []
    numbers: list[int] = np.ravel(which).astype(int).tolist()
    read = zip(corners, np.ravel(ids), numbers, strict=True)
    for quad, tag_id, family in sorted(read, key=lambda item: -cv2.contourArea(item[0][0])):
        name = marker_name(families[family], int(tag_id))
        points = np.asarray(quad[0], dtype=float) + origin
        centre, reach = points.mean(axis=0), 0.5 * np.ptp(points, axis=0).max()
        if any(
            s.marker_id == name and np.max(np.abs(s.corners_px.mean(axis=0) - centre)) < reach for s in found
        ):
            continue
        found.append(Sighting(name, points))
    return found


def marker_of_other_family(image: NDArray[np.uint8], families: Sequence[TagFamily]) -> int | str | None:
    """Name of the largest marker of a family with other codes than `families`; None if there is none.

    The usual families are tried one after the other, the most reliable first; the first that is found is
    taken.

    Args:
        image: (height, width) grey values.
        families: families that were searched before.
    """
    codes = {family.codes for family in families}
    for family in _OTHER_FAMILIES:
        if family.codes not in codes and (seen := detect(image, (family,))):
            return seen[0].marker_id
    return None


def is_marker(image: NDArray[np.uint8], corners_px: Array, name: int | str) -> bool:
    """True if the square with these raw corners (4, 2) shows this marker, in this orientation.

    False if any cell (black or white field) of the marker lies outside the image, or if more cells are
    misread than the family allows.

    Args:
        image: (height, width) grey values.
        corners_px: (4, 2) corners [raw px]: top-left, top-right, bottom-right, bottom-left of the marker.
        name: name of the marker.
    """
    read = _code_pattern(name)
    H = cv2.getPerspectiveTransform(_UNIT_SQUARE, corners_px.astype(np.float32))
    points = read.centres @ H.T
    pixel = np.rint(points[:, :2] / points[:, 2:]).astype(np.intp)
    (left, top), (right, bottom) = pixel.min(axis=0), pixel.max(axis=0)
    if left < 0 or top < 0 or right >= image.shape[1] or bottom >= image.shape[0]:
        return False
    grey = image[pixel[:, 1], pixel[:, 0]].astype(float)
    white, black = read.means @ grey
    return int(np.count_nonzero((grey > 0.5 * (white + black)) != read.code)) <= read.wrong
