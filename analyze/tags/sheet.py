"""Where tags, cutting lines, words and rulers stand on paper. Pure; millimetres from the page's lower left corner, y up."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import TagError
from analyze.geometry.polyhedron import BoolArray
from analyze.tags import families

PAPERS = {"A4": (210.0, 297.0), "Letter": (215.9, 279.4)}
"""width and height [mm]"""
MARGIN = 12.0
"""no printer is asked to print nearer to the paper's edge"""
RULER_MM = 100
RULER_SIDE, RULER_FOOT, HEADING = 14.0, 24.0, 9.0
"""room for the ruler up the page, the one across it with its words, and the heading"""
STRIP = 4.5
"""below each tag: family, id, size and which way is up"""
GAP = 3.0
SMALLEST_MM = 5.0
LEAST_SQUARES = 3


@dataclass(frozen=True)
class Tag:
    """One to print."""

    family: str
    id: int
    size_mm: float
    """edge of the black square"""


@dataclass(frozen=True)
class Rect:
    """A field that is filled black."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class PlacedTag:
    """A tag on a page."""

    tag: Tag
    x: float
    """left edge of the black square"""
    y: float
    """its lower edge"""

    @property
    def quiet(self) -> float:
        """Width of the white rim [mm]."""
        return families.QUIET_CELLS * self.tag.size_mm / len(families.cells(self.tag.family, self.tag.id))

    @property
    def black(self) -> list[Rect]:
        """Fields of the black cells."""
        return black_fields(families.cells(self.tag.family, self.tag.id), self.x, self.y, self.tag.size_mm)


@dataclass(frozen=True)
class Board:
    """A ChArUco board: squares as on a chess board, a tag in every white one (OpenCV's pattern since 4.6: upper left is black)."""

    family: str
    columns: int
    rows: int
    square_mm: float
    marker_mm: float


@dataclass(frozen=True)
class Page:
    """One sheet."""

    width: float
    height: float
    heading: str
    tags: tuple[PlacedTag, ...] = ()
    fields: tuple[Rect, ...] = ()
    """black fields of a board"""
    caption: str = ""
    caption_at: tuple[float, float] = (0.0, 0.0)
    origin: tuple[float, float] | None = None
    """of a board: its frame's origin, x to the right and y up"""


def parse_ids(text: str) -> list[int]:
    """Ids as people write them: `0-11`, `3`, `0-3,7`.

    Raises:
        TagError: not understood.
    """
    found: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,5})\s*(?:-\s*(\d{1,5})\s*)?", part)
        if match is None:
            raise TagError(f"--ids {text}: not understood: write 0-11, or 0,3,7")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise TagError(f"--ids {text}: {part.strip()} runs backwards: write {last}-{first}")
        found.extend(range(first, last + 1))
    return list(dict.fromkeys(found))


def tag_pages(tags: Sequence[Tag], paper: str, heading: str) -> list[Page]:
    """Tags in rows, in their order, on as many pages as they need.

    Raises:
        TagError: no such paper, family or id, or a tag that is too small, or too large for the paper.
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
                f"tag {tag.id}: {tag.size_mm:g} mm, with its white rim {wide:.1f} mm, is too large for {paper}: "
                f"at most {most:.0f} mm, or another --paper"
            )
        if x > left and x + wide > right:
            x, y, row = left, y - row - GAP, 0.0
        if y - wide - STRIP < bottom and pages[-1]:
            pages.append([])
            x, y, row = left, top, 0.0
        pages[-1].append(PlacedTag(tag, x + rim * tag.size_mm, y - wide + rim * tag.size_mm))
        x, row = x + wide + GAP, max(row, wide + STRIP)
    return [Page(width, height, f"{heading}, page {i} of {len(pages)}", tuple(page)) for i, page in enumerate(pages, start=1)]


def board_page(board: Board, paper: str) -> Page:
    """The board in the middle of a page, turned if it only fits so.

    Raises:
        TagError: no such paper or family; too few squares, too small, too many tags, or too large for the paper.
    """
    width, height = _paper(paper)
    refuse_impossible(board)
    left, right = MARGIN + RULER_SIDE, width - MARGIN
    top, bottom = height - MARGIN - HEADING, MARGIN + RULER_FOOT + STRIP
    wide, high = board.columns * board.square_mm, board.rows * board.square_mm
    if wide > right - left or high > top - bottom:
        most = np.floor(min((right - left) / board.columns, (top - bottom) / board.rows))
        raise TagError(
            f"a board of {board.columns}x{board.rows} squares of {board.square_mm:g} mm is {wide:g} x {high:g} mm, too large for {paper}: "
            f"at most {most:.0f} mm a square, or fewer squares"
        )
    x, y = left + (right - left - wide) / 2, bottom + (top - bottom - high) / 2
    fields: list[Rect] = []
    tag_id = 0
    for row in range(board.rows):
        for column in range(board.columns):
            corner = (x + column * board.square_mm, y + high - (row + 1) * board.square_mm)
            if (row + column) % 2 == 0:
                fields.append(Rect(*corner, board.square_mm, board.square_mm))
                continue
            inset = (board.square_mm - board.marker_mm) / 2
            fields.extend(black_fields(families.cells(board.family, tag_id), corner[0] + inset, corner[1] + inset, board.marker_mm))
            tag_id += 1
    size = f"{board.columns}x{board.rows}, squares {board.square_mm:g} mm, tags {board.marker_mm:g} mm"
    caption = f"ChArUco {size}, {board.family}, ids 0-{tag_id - 1}"
    return Page(
        width,
        height,
        "Percuss: calibration board, glue it flat on glass or aluminium",
        (),
        tuple(fields),
        caption,
        (x + 16.0, y - 4.0),
        (x, y),
    )


def refuse_impossible(board: Board) -> None:
    """Say why there can be no such board, whatever the paper.

    Raises:
        TagError: no such family; too few squares, too small, or too many tags.
    """
    if min(board.columns, board.rows) < LEAST_SQUARES:
        raise TagError(
            f"a board of {board.columns}x{board.rows} squares has too few corners: give at least {LEAST_SQUARES}x{LEAST_SQUARES}"
        )
    _refuse_small("the board's tag", board.marker_mm)
    needed = board.columns * board.rows // 2
    if needed > families.count(board.family):
        raise TagError(f"a board of {board.columns}x{board.rows} needs {needed} tags, {board.family} has {families.count(board.family)}")
    cell = board.marker_mm / len(families.cells(board.family, 0))
    if board.square_mm < board.marker_mm + 2 * families.QUIET_CELLS * cell:
        least = board.marker_mm + 2 * families.QUIET_CELLS * cell
        raise TagError(f"squares of {board.square_mm:g} mm leave no white rim round tags of {board.marker_mm:g} mm: {least:.1f} mm or more")


def black_fields(cells: BoolArray, x: float, y: float, size: float) -> list[Rect]:
    """Black cells of a tag whose lower left corner is (x, y), run by run along its rows."""
    many = len(cells)
    cell = size / many
    fields: list[Rect] = []
    for row in range(many):
        padded = np.concatenate([[True], cells[row], [True]]).astype(int)
        starts, ends = np.flatnonzero(np.diff(padded) < 0), np.flatnonzero(np.diff(padded) > 0)
        fields.extend(
            Rect(x + int(a) * cell, y + (many - 1 - row) * cell, int(b - a) * cell, cell) for a, b in zip(starts, ends, strict=True)
        )
    return fields


def _paper(name: str) -> tuple[float, float]:
    if name not in PAPERS:
        raise TagError(f"{name}: no such paper: choose {' or '.join(PAPERS)}")
    return PAPERS[name]


def _refuse_small(what: str, size_mm: float) -> None:
    if not size_mm >= SMALLEST_MM:
        raise TagError(f"{what}: {size_mm:g} mm is too small to be printed and seen: {SMALLEST_MM:g} mm or more (sizes are in millimetres)")
