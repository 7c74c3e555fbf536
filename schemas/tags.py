"""Families of square tags, and the names of markers in documents."""

from __future__ import annotations

import enum
import re
from typing import Annotated

from pydantic import AfterValidator


class TagFamily(enum.StrEnum):
    """AprilTag families (Olson 2011) and ArUco dictionaries (Garrido-Jurado et al. 2014) of OpenCV.

    Names of ArUco dictionaries begin with the number of cells and end with the number of tags; 4x4_100 holds
    the first hundred tags of 4x4_250. mip_36h12 is an ArUco dictionary too.
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

    @classmethod
    def _missing_(cls, value: object) -> TagFamily | None:
        """Family by AprilTag's or OpenCV's name, such as tag36h11 or DICT_4X4_50; None if unknown."""
        plain = str(value).lower()
        for prefix in ("dict_", "apriltag_", "aruco_", "tag"):
            plain = plain.removeprefix(prefix)
        return next((family for family in cls if family.value == plain), None)

    @property
    def size(self) -> int:
        """Number of tags in the family; ids run from 0 to size - 1."""
        return _COUNTS[self.value] if self.value in _COUNTS else int(self.value.partition("_")[2])

    @property
    def opencv(self) -> str:
        """Name of the family's dictionary in cv2.aruco, for example "DICT_APRILTAG_36h11"."""
        if self is TagFamily.ARUCO_MIP_36H12:
            return "DICT_ARUCO_MIP_36h12"
        return f"DICT_{self.name.removeprefix('ARUCO_')}".replace("H", "h")

    @property
    def codes(self) -> str:
        """Name of the set of codes (black-and-white patterns) from which the family takes its tags.

        Families of one set share tags: 4x4_50 to 4x4_1000 all have the set 4x4, and so on. An AprilTag family
        and mip_36h12 have a set of their own, with the family's name.
        """
        return self.value if self.value in _COUNTS else self.value.partition("_")[0]


_COUNTS = {"36h11": 587, "36h10": 2320, "25h9": 35, "16h5": 30, "mip_36h12": 250}

USUAL_FAMILY = TagFamily.APRILTAG_36H11

_QUALIFIED_NAME = re.compile(r"(.+)-(\d{1,4})")


def marker_name(family: TagFamily, tag_id: int) -> int | str:
    """Name of a marker: its id in the family 36h11, otherwise family and id, for example "25h9-3"."""
    return tag_id if family is USUAL_FAMILY else f"{family}-{tag_id}"


def family_and_id(name: int | str) -> tuple[TagFamily, int]:
    """Family and id of the marker called `name`; a number is an id of the family 36h11.

    Raises:
        ValueError: no marker has this name.
    """
    family, tag_id = USUAL_FAMILY, name
    if isinstance(name, str):
        match = _QUALIFIED_NAME.fullmatch(name)
        if match is None or match[1] not in set(TagFamily) or match[1] == USUAL_FAMILY:
            raise ValueError(
                f"{name!r} is not the name of a marker: use a number for {USUAL_FAMILY}, family and number "
                "for others, as 25h9-3"
            )
        family, tag_id = TagFamily(match[1]), int(match[2])
    if not 0 <= int(tag_id) < family.size:
        raise ValueError(f"{family} has no tag {tag_id}: its ids are 0 to {family.size - 1}")
    return family, int(tag_id)


def name_order(name: int | str) -> tuple[str, int]:
    """Sort key of a marker's name: family and id, with "" for the family 36h11, whose names are numbers.

    Raises:
        ValueError: no marker has this name.
    """
    family, tag_id = family_and_id(name)
    return "" if family is USUAL_FAMILY else family.value, tag_id


def _checked(name: int | str) -> int | str:
    family_and_id(name)
    return name


MarkerName = Annotated[int | str, AfterValidator(_checked)]
"""Name of a marker in documents; see `marker_name`."""
