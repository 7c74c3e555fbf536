"""Families (sets) of square tags, from OpenCV's dictionaries of bit patterns."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from analyze.errors import TagError
from schemas.tags import TagFamily

FAMILIES = {family.value: int(getattr(cv2.aruco, family.opencv)) for family in TagFamily}
"""OpenCV's number of its predefined dictionary (set of bit patterns), by family such as "36h11"."""
ON_OBJECTS, ON_BOARDS = "36h11", "5x5_100"
"""Default families of tags on objects and on calibration boards.

They differ, so that a board in view is never mistaken for an object.
"""
QUIET_CELLS = 1
"""Width of the white rim, in cells, that a detector needs around the black square."""


@cache
def dictionary(family: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary (set of bit patterns) of a tag family such as "36h11".

    Raises:
        TagError: the family is unknown.
    """
    if family not in FAMILIES:
        raise TagError(f"{family}: unknown tag family: choose {', '.join(FAMILIES)}")
    return cv2.aruco.getPredefinedDictionary(FAMILIES[family])


def count(family: str) -> int:
    """Number of tags in a family; their ids begin at 0.

    Raises:
        TagError: the family is unknown.
    """
    return len(dictionary(family).bytesList)


@cache
def cells(family: str, tag_id: int) -> NDArray[np.bool_]:
    """Cells (squares of the code) of a tag as an array (n, n), True for white.

    The outermost ring of cells is the tag's black border. Row 0 is the top. The array is read-only.

    Raises:
        TagError: the family is unknown, or has no such id.
    """
    if not 0 <= tag_id < count(family):
        raise TagError(f"{family} has no tag {tag_id}: its ids are 0 to {count(family) - 1}")
    side = dictionary(family).markerSize + 2
    found = np.asarray(cv2.aruco.generateImageMarker(dictionary(family), tag_id, side)) > 127
    found.setflags(write=False)
    return found
