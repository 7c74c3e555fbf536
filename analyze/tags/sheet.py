"""Layout of tags, cutting lines, text and rulers on paper, in mm from the lower left corner, y up."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.errors import TagError
from analyze.geometry.polyhedron import BoolArray
from analyze.tags import families
from schemas.wording import counted

PAPERS = {"A4": (210.0, 297.0), "Letter": (215.9, 279.4)}
"""Width and height [mm] of each paper."""
MARGIN = 12.0
"""Margin [mm] of the paper that is left white, because printers may not reach it."""
RULER_MM = 100
"""Length [mm] of the printed rulers."""
RULER_SIDE, RULER_FOOT, HEADING = 14.0, 24.0, 9.0
"""Room [mm] inside the margins for the vertical ruler, the horizontal ruler and its text, and the heading."""
STRIP = 4.5
"""Height [mm] of the strip below each tag, with id, size and family; it marks the tag's lower edge."""
GAP = 3.0
"""Gap [mm] between tags."""
MIN_TAG_MM = 5.0
"""Least edge length [mm] of the black square of a tag that can be printed and detected."""
MIN_SQUARES = 3
"""Least number of a board's columns and rows."""


@dataclass(frozen=True)
class Tag:
    """Tag to be printed: family, id, and edge length [mm] of its black square."""

    family: str
    """Tag family such as "36h11"."""
    id: int
    """Number of the tag in its family, from 0."""
    size_mm: float
    """Edge length [mm] of the black square."""


@dataclass(frozen=True)
class Rect:
    """Black rectangle on a page: lower left corner and size [mm]."""

    x: float
    """Left edge, from the page's left one [mm]."""
    y: float
    """Lower edge, from the page's lower one [mm]."""
    width: float
    """Size across [mm]."""
    height: float
    """Size upwards [mm]."""


@dataclass(frozen=True)
class PlacedTag:
    """Tag with its position on a page, from the page's lower left corner [mm]."""

    tag: Tag
    """Tag to be printed."""
    x: float
    """Left edge of the black square, from the page's left one [mm]."""
    y: float
    """Lower edge of the black square, from the page's lower one [mm]."""

    @property
    def quiet_zone(self) -> float:
        """Width [mm] of the white rim around the tag's black square, which a detector needs."""
        return families.QUIET_CELLS * self.tag.size_mm / len(families.cells(self.tag.family, self.tag.id))

    @property
    def black(self) -> list[Rect]:
        """Black rectangles of the tag on the page [mm], one for each run of black cells in a row."""
        cells = families.cells(self.tag.family, self.tag.id)
        return black_rectangles(cells, self.x, self.y, self.tag.size_mm)


@dataclass(frozen=True)
class Board:
    """ChArUco board: a chess board with a tag in every white square.

    The upper left square is black, as in OpenCV's pattern since 4.6. The tags' ids count from 0, row by row
    from the upper left.
    """

    family: str
    """Tag family."""
    columns: int
    """Number of squares across."""
    rows: int
    """Number of squares from top to bottom."""
    square_mm: float
    """Edge length [mm] of a square."""
    marker_mm: float
    """Edge length [mm] of a tag's black square."""


@dataclass(frozen=True)
class Stroke:
    """Straight line on a page, or in a drawing that is moved to one."""

    start: tuple[float, float]
    """One end (x, y) [mm]."""
    end: tuple[float, float]
    """Other end (x, y) [mm]."""
    width: float
    """Width [mm]."""
    grey: bool = False
    """True to draw it in grey."""
    dash: bool = False
    """True to draw it dashed."""

    def moved(self, x: float, y: float) -> Stroke:
        """Copy of the line, moved by (x, y) [mm]."""
        start, end = ((point[0] + x, point[1] + y) for point in (self.start, self.end))
        return replace(self, start=start, end=end)


@dataclass(frozen=True)
class Label:
    """One line of text on a page, or in a drawing that is moved to one."""

    x: float
    """Start, middle or end of the text [mm], by `side`."""
    y: float
    """Base line of the text [mm]."""
    text: str
    """The text."""
    points: float
    """Font size [1/72 inch]."""
    side: str = "left"
    """Which side of the text is at `x`: "left", "center" or "right"."""
    bold: bool = False
    """True for bold letters."""

    def moved(self, x: float, y: float) -> Label:
        """Copy of the text, moved by (x, y) [mm]."""
        return replace(self, x=self.x + x, y=self.y + y)


@dataclass(frozen=True)
class Page:
    """Contents of one sheet of paper; lengths in mm, positions from the lower left corner, y up."""

    width: float
    """Width of the paper [mm]."""
    height: float
    """Height of the paper [mm]."""
    heading: str
    """Text at the top."""
    tags: tuple[PlacedTag, ...] = ()
    """Tags with their positions; empty for a board."""
    black: tuple[Rect, ...] = ()
    """Black squares and tag cells of a board; empty for sheets of tags."""
    caption: str = ""
    """Text below a board."""
    caption_at: tuple[float, float] = (0.0, 0.0)
    """Start (x, y) of the caption's base line [mm]."""
    origin: tuple[float, float] | None = None
    """Origin (x, y) [mm] of a board's frame, with x to the right and y up; None for sheets of tags."""
    strokes: tuple[Stroke, ...] = ()
    """Further lines, as of the mat."""
    labels: tuple[Label, ...] = ()
    """Further texts, as of the mat."""
    rulers: bool = True
    """True to draw the rulers of sheets and boards at the lower left."""


def parse_ids(text: str) -> list[int]:
    """Parse a text such as `0-11`, `3` or `0-3,7`; return the tag ids in that order, without repetitions.

    Raises:
        TagError: the text is not of this form, or a range runs backwards.
    """
    found: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,5})\s*(?:-\s*(\d{1,5})\s*)?", part)
        if match is None:
            raise TagError(f"--ids {text}: not understood: write ids such as 0-11 or 0,3,7")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise TagError(f"--ids {text}: {part.strip()} runs backwards: write {last}-{first}")
        found.extend(range(first, last + 1))
    return list(dict.fromkeys(found))


def tag_pages(tags: Sequence[Tag], paper: str, heading: str) -> list[Page]:
    """Lay out tags in rows on as many pages as needed, in the order given.

    Args:
        tags: tags to be printed.
        paper: name of the paper, A4 or Letter.
        heading: text at the top of each page; the page's number is added.

    Returns:
        The pages with the tags' positions [mm]; one empty page if there are no tags.

    Raises:
        TagError: paper, family or id is unknown, or a tag is too small or too large for the paper.
    """
    width, height = _paper(paper)
    left, right = MARGIN + RULER_SIDE, width - MARGIN
    top, bottom = height - MARGIN - HEADING, MARGIN + RULER_FOOT
    pages: list[list[PlacedTag]] = [[]]
    x, y, row = left, top, 0.0
    for tag in tags:
        _refuse_small(f"tag {tag.id}", tag.size_mm)
        cells = len(families.cells(tag.family, tag.id))
        rim = families.QUIET_CELLS / cells
        wide = tag.size_mm * (1 + 2 * rim)
        if wide > right - left or wide + STRIP > top - bottom:
            most = np.floor(min(right - left, top - bottom - STRIP) / (1 + 2 * rim))
            raise TagError(
                f"tag {tag.id}: {tag.size_mm:g} mm, with its white rim {wide:.1f} mm, is too large for "
                f"{paper}: choose at most {most:.0f} mm, or another --paper"
            )
        if x > left and x + wide > right:
            x, y, row = left, y - row - GAP, 0.0
        if y - wide - STRIP < bottom and pages[-1]:
            pages.append([])
            x, y, row = left, top, 0.0
        pages[-1].append(PlacedTag(tag, x + rim * tag.size_mm, y - wide + rim * tag.size_mm))
        x, row = x + wide + GAP, max(row, wide + STRIP)
    return [
        Page(width, height, f"{heading}, page {i} of {len(pages)}", tuple(page))
        for i, page in enumerate(pages, start=1)
    ]


def board_page(board: Board, paper: str) -> Page:
    """Lay out a calibration board on one page, in the middle of the space beside the rulers.

    Args:
        board: the board.
        paper: name of the paper, A4 or Letter.

    Returns:
        The page with the board's black rectangles, caption and origin [mm].

    Raises:
        TagError: paper or family is unknown, or the board is impossible or too large for the paper.
    """
    width, height = _paper(paper)
    refuse_impossible(board)
    left, right = MARGIN + RULER_SIDE, width - MARGIN
    top, bottom = height - MARGIN - HEADING, MARGIN + RULER_FOOT + STRIP
    wide, high = board.columns * board.square_mm, board.rows * board.square_mm
    if wide > right - left or high > top - bottom:
        most = np.floor(min((right - left) / board.columns, (top - bottom) / board.rows))
        raise TagError(
            f"a board of {board.columns}x{board.rows} squares of {board.square_mm:g} mm is {wide:g} x "
            f"{high:g} mm, too large for {paper}: choose squares of at most {most:.0f} mm, or fewer squares"
        )
    x, y = left + (right - left - wide) / 2, bottom + (top - bottom - high) / 2
    rectangles: list[Rect] = []
    tag_id = 0
    for row in range(board.rows):
        for column in range(board.columns):
            corner = (x + column * board.square_mm, y + high - (row + 1) * board.square_mm)
            if (row + column) % 2 == 0:
                rectangles.append(Rect(*corner, board.square_mm, board.square_mm))
                continue
            inset = (board.square_mm - board.marker_mm) / 2
            cells = families.cells(board.family, tag_id)
            rectangles += black_rectangles(cells, corner[0] + inset, corner[1] + inset, board.marker_mm)
            tag_id += 1
    size = f"{board.columns}x{board.rows}, squares {board.square_mm:g} mm, tags {board.marker_mm:g} mm"
    caption = f"ChArUco {size}, {board.family}, ids 0-{tag_id - 1}"
    return Page(
        width,
        height,
        "Percuss: calibration board, glue it flat on glass or aluminium",
        (),
        tuple(rectangles),
        caption,
        (x + 16.0, y - 4.0),
        (x, y),
    )


def refuse_impossible(board: Board) -> None:
    """Check that a calibration board can be made; whether it fits on the paper is not checked.

    Raises:
        TagError: the family is unknown, or the board has too few squares, too small or too many tags, or
            squares too small for a white rim around the tags.
    """
    if min(board.columns, board.rows) < MIN_SQUARES:
        raise TagError(
            f"a board of {board.columns}x{board.rows} squares has too few corners: give at least "
            f"{MIN_SQUARES}x{MIN_SQUARES}"
        )
    _refuse_small("the board's tag", board.marker_mm)
    needed = board.columns * board.rows // 2
    if needed > families.count(board.family):
        raise TagError(
            f"a board of {board.columns}x{board.rows} needs {counted(needed, 'tag')}, {board.family} has "
            f"{families.count(board.family)}: choose fewer squares, or another --family"
        )
    cell = board.marker_mm / len(families.cells(board.family, 0))
    least = board.marker_mm + 2 * families.QUIET_CELLS * cell
    if board.square_mm < least:
        raise TagError(
            f"squares of {board.square_mm:g} mm leave no white rim round tags of {board.marker_mm:g} mm: "
            f"choose squares of {least:.1f} mm or more"
        )


def black_rectangles(cells: BoolArray, x: float, y: float, size: float) -> list[Rect]:
    """Black rectangles of a tag on a page, one for each run of black cells in a row of the tag.

    Cells are the tag's black and white squares. Each rectangle has left and lower edge in the frame of
    `x` and `y`, y upwards, and width and height [mm].

    Args:
        cells: (n, n) cells of the tag, True for white, row 0 at the top.
        x: left edge of the tag on the page [mm].
        y: lower edge of the tag on the page [mm].
        size: edge length of the tag [mm].
    """
    many = len(cells)
    cell = size / many
    rectangles: list[Rect] = []
    for row in range(many):
        padded = np.concatenate([[True], cells[row], [True]]).astype(int)
        starts, ends = np.flatnonzero(np.diff(padded) < 0), np.flatnonzero(np.diff(padded) > 0)
        rectangles.extend(
            Rect(x + int(a) * cell, y + (many - 1 - row) * cell, int(b - a) * cell, cell)
            for a, b in zip(starts, ends, strict=True)
        )
    return rectangles


def _paper(name: str) -> tuple[float, float]:
    """Width and height [mm] of the paper of that name, A4 or Letter.

    Raises:
        TagError: the paper is unknown.
    """
    if name not in PAPERS:
        raise TagError(f"{name}: unknown paper: choose {' or '.join(PAPERS)}")
    return PAPERS[name]


def _refuse_small(name: str, size_mm: float) -> None:
    """Check that a tag is large enough to be printed and detected.

    Args:
        name: name of the tag, for the error message.
        size_mm: edge length of its black square [mm].

    Raises:
        TagError: the size is below `MIN_TAG_MM`, or not a number.
    """
    if not size_mm >= MIN_TAG_MM:
        raise TagError(
            f"{name}: {size_mm:g} mm is too small to be printed and detected: "
            f"choose {MIN_TAG_MM:g} mm or more (sizes are in millimetres)"
        )
