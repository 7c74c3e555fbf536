"""Layout of the mat: a printed sheet on the table with tags around the object's place, in the world frame W.

The mat defines W: origin in its middle, z out of the print, the pivot line along y, objects tip towards +x
and the camera stands at -y. Its tags are of the family 5x5_1000, from id 500 on, where tags of objects
(36h11) and of calibration boards (5x5_100) are not; any two differ in 8 cells of 25 or more, however they are
turned. Each paper has ids of its own, so that an image shows which mat it is. Tags are twice as long along y
as they are wide: a camera that looks flat across the table sees them foreshortened to about squares.

A mat of three sheets (A4x3) is glued together from sheets that are each exact; the middle sheet defines W,
the place of the outer ones on it is estimated with the camera's pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from analyze.errors import TagError
from analyze.types import Array
from schemas.tags import TagFamily, marker_name

MAT_FAMILY = TagFamily.ARUCO_5X5_1000
"""Tag family of the mat."""
_IDS = (
    *(500, 501, 502, 503, 504, 505, 507, 511, 516, 520, 521, 522, 526, 528, 530, 537, 549, 550, 553, 558),
    *(565, 569, 571, 583, 594, 597, 601, 605, 613, 625, 641, 655, 672, 688, 693, 739, 797, 828, 906, 908),
)
"""ids of the family, from 500 on, that differ from each other in 8 cells or more, in any orientation"""
MAT_MARGIN_MM = 12.0
"""Margin [mm] of each sheet that is left white, because printers may not reach it."""


@dataclass(frozen=True)
class MatTag:
    """Tag of the mat, of any ratio of its sides, with its place in W."""

    id: int
    """number in the family `MAT_FAMILY`"""
    x: float
    """middle in W [mm]"""
    y: float
    """middle in W [mm]"""
    width: float
    """size along x [mm]"""
    height: float
    """size along y [mm]"""
    sheet: int
    """index of the sheet of paper on which it is printed"""

    @property
    def name(self) -> int | str:
        """Name of the tag as markers have it, such as "5x5_1000-500"."""
        return marker_name(MAT_FAMILY, self.id)

    @property
    def corners(self) -> Array:
        """Corners (4, 3) in W [m]: top-left, top-right, bottom-right, bottom-left as printed, +y at top."""
        half = np.array([self.width, self.height, 0.0]) / 2
        signs = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
        return np.asarray((np.array([self.x, self.y, 0.0]) + signs * half) / 1000, dtype=np.float64)


@dataclass(frozen=True)
class Mat:
    """A mat: its tags, the sheets of paper that it is printed on, and its rulers, in W."""

    paper: str
    """name of the paper: A4, A3 or A4x3"""
    width: float
    """size of each sheet along x [mm]"""
    height: float
    """size of each sheet along y [mm]"""
    middles: tuple[float, ...]
    """x of the middle of each sheet [mm]; their y is 0"""
    reference: int
    """index of the sheet that defines W"""
    tags: tuple[MatTag, ...]
    """its tags"""
    free: tuple[float, float]
    """half sizes along x and y of the area without tags [mm]"""
    ruler: float
    """half length of the ruler along y, on the pivot line [mm]"""
    radius: float
    """radius of the circle of angle marks [mm]"""

    @property
    def ruler_mm(self) -> float:
        """Length of the ruler on the pivot line as it should be printed [mm]."""
        return 2 * self.ruler

    def sheet_edges(self, sheet: int) -> tuple[float, float]:
        """Least and largest x [mm] of the printed part of a sheet, without its margins."""
        half = self.width / 2 - MAT_MARGIN_MM
        return self.middles[sheet] - half, self.middles[sheet] + half


_LANDSCAPE_A4, _LANDSCAPE_A3 = (297.0, 210.0), (420.0, 297.0)
_PORTRAIT_A4 = (210.0, 297.0)


@dataclass(frozen=True)
class _Frame:
    """Tags around a free area, as the four sides of a frame with numbers and sizes [mm]."""

    x: float
    """half size of the printed area along x"""
    y: float
    """half size of the printed area along y"""
    side: tuple[float, float]
    """width and height of the tags in the left and right columns"""
    many: int
    """number of tags in each column"""
    row: tuple[float, float]
    """width and height of the tags in the front and back rows"""
    places: tuple[float, ...]
    """x of the middles of the tags in the front and back rows"""

    @property
    def free(self) -> tuple[float, float]:
        """Half sizes along x and y of the area inside the tags' white rims."""
        return self.x - 9 / 7 * self.side[0], self.y - 9 / 7 * self.row[1]

    def rectangles(self) -> list[tuple[float, float, float, float]]:
        """Middle and size (x, y, width, height) of every tag, from the left column to the back row."""
        width, height = self.side
        x, pitch = self.x - 9 / 14 * width, 2 * self.y / self.many
        heights = [self.y - pitch * (n + 0.5) for n in range(self.many)]
        columns = [(sign * x, y, width, height) for sign in (-1, 1) for y in heights]
        y = self.y - 9 / 14 * self.row[1]
        return columns + [(x, sign * y, *self.row) for sign in (-1, 1) for x in self.places]


_FRAMES = {
    "A4": _Frame(136.5, 93.0, (30.0, 66.0), 2, (24.0, 34.0), (-77.0, -42.0, 42.0, 77.0)),
    "A3": _Frame(198.0, 136.5, (36.0, 68.0), 3, (32.0, 44.0), (-116.0, -52.0, 52.0, 116.0)),
    "A4x3": _Frame(279.0, 136.5, (40.0, 68.0), 3, (32.0, 48.0), (-160.0, -60.0, 60.0, 160.0)),
}
_SHEETS = {
    "A4": (_LANDSCAPE_A4, (0.0,), 0),
    "A3": (_LANDSCAPE_A3, (0.0,), 0),
    "A4x3": (_PORTRAIT_A4, (-186.0, 0.0, 186.0), 1),
}
_RULERS = {"A4": (90.0, 47.5), "A3": (130.0, 77.5), "A4x3": (130.0, 67.5)}
MAT_PAPERS = tuple(_FRAMES)
"""Names of the papers of mats; A4x3 is three sheets A4 side by side."""


@cache
def mat(paper: str) -> Mat:
    """The mat on a paper.

    Args:
        paper: A4, A3, or A4x3 (three sheets A4 side by side).

    Raises:
        TagError: the paper is unknown.
    """
    if paper not in _FRAMES:
        raise TagError(f"{paper}: unknown paper of a mat: choose {', '.join(MAT_PAPERS)}")
    frame, (size, middles, reference) = _FRAMES[paper], _SHEETS[paper]
    first = sum(len(_FRAMES[other].rectangles()) for other in MAT_PAPERS[: MAT_PAPERS.index(paper)])
    tags = tuple(
        MatTag(tag_id, x, y, wide, high, int(np.argmin([abs(x - middle) for middle in middles])))
        for tag_id, (x, y, wide, high) in zip(_IDS[first:], frame.rectangles(), strict=False)
    )
    ruler, radius = _RULERS[paper]
    return Mat(paper, size[0], size[1], middles, reference, tags, frame.free, ruler, radius)


@cache
def mat_of_tag(name: int | str) -> Mat | None:
    """The mat that carries the tag of this name; None if no mat does."""
    mats = map(mat, MAT_PAPERS)
    return next((each for each in mats if any(tag.name == name for tag in each.tags)), None)
