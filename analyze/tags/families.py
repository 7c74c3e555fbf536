"""Families of square tags, by the dictionaries of OpenCV."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from analyze.errors import TagError
from schemas.tags import TagFamily

FAMILIES = {family.value: int(getattr(cv2.aruco, family.opencv)) for family in TagFamily}
ON_OBJECTS, ON_BOARDS = "36h11", "5x5_100"
"""unless another is asked for: two, so that a board in view is never taken for an object"""
QUIET_CELLS = 1
"""white cells that a detector needs around the black square"""


@cache
def dictionary(family: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of a family.

    Raises:
        TagError: there is no such family.
    """
    if family not in FAMILIES:
        raise TagError(f"{family}: no such tag family: choose {', '.join(FAMILIES)}")
    return cv2.aruco.getPredefinedDictionary(FAMILIES[family])


def count(family: str) -> int:
    """How many tags the family has; their ids begin at 0."""
    return len(dictionary(family).bytesList)


@cache
def cells(family: str, tag_id: int) -> NDArray[np.bool_]:
    """The tag as cells (n, n), True is white; row 0 is its upper edge, the outermost ring is its black border.

    Raises:
        TagError: there is no such family, or no such id in it.
    """
    if not 0 <= tag_id < count(family):
        raise TagError(f"{family} has no tag {tag_id}: its ids are 0 to {count(family) - 1}")
    side = dictionary(family).markerSize + 2
    found = np.asarray(cv2.aruco.generateImageMarker(dictionary(family), tag_id, side)) > 127
    found.setflags(write=False)
    return found
