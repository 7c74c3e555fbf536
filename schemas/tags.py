"""Families of square tags, and how a document names one marker."""

from __future__ import annotations

import enum
import re
from typing import Annotated

from pydantic import AfterValidator


class TagFamily(enum.StrEnum):
    """AprilTag families (Olson 2011) and ArUco dictionaries (Garrido-Jurado et al. 2014), as OpenCV has them.

    ArUco's begin with their cells: 4x4_100 is the first hundred of 4x4_250.
    """

    APRILTAG_36H11 = "36h11"
    APRILTAG_36H10 = "36h10"
    APRILTAG_25H9 = "25h9"
    APRILTAG_16H5 = "16h5"
    ARUCO_4X4_50 = "4x4_50"
    ARUCO_4X4_100 = "4x4_100"
    ARUCO_4X4_250 = "4x4_250"
    ARUCO_4X4_1000 = "4x4_1000"
    ARUCO_5X5_50 = "5x5_50"
    ARUCO_5X5_100 = "5x5_100"
    ARUCO_5X5_250 = "5x5_250"
    ARUCO_5X5_1000 = "5x5_1000"
    ARUCO_6X6_50 = "6x6_50"
    ARUCO_6X6_100 = "6x6_100"
    ARUCO_6X6_250 = "6x6_250"
    ARUCO_6X6_1000 = "6x6_1000"
    ARUCO_7X7_50 = "7x7_50"
    ARUCO_7X7_100 = "7x7_100"
    ARUCO_7X7_250 = "7x7_250"
    ARUCO_7X7_1000 = "7x7_1000"
    ARUCO_MIP_36H12 = "mip_36h12"

    @property
    def size(self) -> int:
        """How many tags it has; their ids begin at 0."""
        return _COUNTS[self.value] if self.value in _COUNTS else int(self.value.partition("_")[2])

    @property
    def opencv(self) -> str:
        """OpenCV's name of the dictionary, in cv2.aruco."""
        return f"DICT_{self.name.removeprefix('ARUCO_') if self is not TagFamily.ARUCO_MIP_36H12 else 'ARUCO_MIP_36h12'}".replace("H", "h")

    @property
    def codes(self) -> str:
        """Equal for families that share codes: a tag of one is the same tag of the other."""
        return self.value if self.value in _COUNTS else self.value.partition("_")[0]


_COUNTS = {"36h11": 587, "36h10": 2320, "25h9": 35, "16h5": 30, "mip_36h12": 250}

USUAL_FAMILY = TagFamily.APRILTAG_36H11

_OTHER = re.compile(r"(.+)-(\d{1,4})")


def marker_name(family: TagFamily, tag_id: int) -> int | str:
    """Name of a marker: its number where it is of the usual family, else family and number, as "25h9-3"."""
    return tag_id if family is USUAL_FAMILY else f"{family}-{tag_id}"


def family_and_id(name: int | str) -> tuple[TagFamily, int]:
    """What `name` is the name of.

    Raises:
        ValueError: no marker is called so.
    """
    family, tag_id = USUAL_FAMILY, name
    if isinstance(name, str):
        match = _OTHER.fullmatch(name)
        if match is None or match[1] not in set(TagFamily) or match[1] == USUAL_FAMILY:
            raise ValueError(f"{name!r} names no marker: a number is one of {USUAL_FAMILY}, others are called as 25h9-3")
        family, tag_id = TagFamily(match[1]), int(match[2])
    if not 0 <= int(tag_id) < family.size:
        raise ValueError(f"{family} has no tag {tag_id}: its ids are 0 to {family.size - 1}")
    return family, int(tag_id)


def name_order(name: int | str) -> tuple[str, int]:
    """Sorts names: numbers first, then by family and number."""
    family, tag_id = family_and_id(name)
    return "" if family is USUAL_FAMILY else family.value, tag_id


def _checked(name: int | str) -> int | str:
    family_and_id(name)
    return name


MarkerName = Annotated[int | str, AfterValidator(_checked)]
"""in documents; see `marker_name`"""
