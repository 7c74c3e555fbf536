"""Makes a PDF of tags or of a calibration board, from the user's options (`analyze print-tags`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.errors import TagError
from analyze.reading.object_file import read_spec
from analyze.tags import families
from analyze.tags.families import FAMILIES
from analyze.tags.mat import mat, mat_of_tag
from analyze.tags.mat_pages import mat_pages
from analyze.tags.pdf import write_pdf
from analyze.tags.sheet import Board, Page, Tag, board_page, parse_ids, refuse_impossible, tag_pages
from schemas.tags import TagFamily, marker_name
from schemas.wording import counted

DEFAULT_SIZE_MM = 30.0
"""Default edge length [mm] of a tag's black square."""


@dataclass(frozen=True)
class PrintOptions:
    """Options for printing sheets of tags (`analyze print-tags`)."""

    family: str | None = None
    """Tag family; None for 36h11."""
    ids: str | None = None
    """Ids such as `0-11` or `0,3,7`; None for `0-11`."""
    size_mm: float | None = None
    """Edge length of the black square [mm]; None for 30 mm."""
    object_path: Path | None = None
    """Object file whose tags are printed, in place of `family`, `ids` and `size_mm`; None to use these."""
    paper: str = "A4"
    """Paper, A4 or Letter."""


@dataclass(frozen=True)
class BoardOptions:
    """Options for a calibration board (ChArUco: a chessboard with tags in its white squares)."""

    family: str | None = None
    """Tag family; None for 5x5_100."""
    squares: str = "7x9"
    """Numbers of the board's columns and rows of squares, as columns x rows."""
    square_mm: float = 22.0
    """Edge length of a square [mm]."""
    marker_mm: float | None = None
    """Edge length of the tags' black squares [mm]; None for 0.7 of `square_mm`."""
    paper: str = "A4"
    """Paper, A4 or Letter."""


def print_tags(options: PrintOptions, output: Path) -> str:
    """Write sheets of tags, of an object or of a family, as a PDF.

    Returns:
        Line for the user with file, number and sizes [mm] of the tags, number of pages and paper.

    Raises:
        TagError: a family, id or paper is unknown, the ids are not understood, a size does not fit, or a
            tag is one of the mat's, or the object has none.
        ShapeError: the object file is missing or cannot be used.
        OutputError: the file cannot be written.
    """
    if options.object_path is not None:
        spec = read_spec(options.object_path)
        if not spec.marker:
            raise TagError(
                f"{options.object_path}: has no tags: add a [[marker]] for each, or print the mat (--mat)"
            )
        tags = [Tag(marker.family, marker.id, 1000 * marker.size_m) for marker in spec.marker]
        heading = f"Percuss: tags of {spec.name}"
    else:
        family = options.family or families.ON_OBJECTS
        size = DEFAULT_SIZE_MM if options.size_mm is None else options.size_mm
        tags = [Tag(family, tag_id, size) for tag_id in parse_ids(options.ids or "0-11")]
        heading = f"Percuss: tags {family}"
    _refuse_mats(tags)
    pages = tag_pages(tags, options.paper, heading)
    write_pdf(pages, output)
    sizes = sorted({tag.size_mm for tag in tags})
    return _print_message(
        output,
        f"{counted(len(tags), 'tag')} of {', '.join(f'{size:g}' for size in sizes)} mm",
        pages,
        options.paper,
    )


def print_board(options: BoardOptions, output: Path) -> str:
    """Write a calibration board (ChArUco) as a PDF of one page.

    Returns:
        Line for the user with file, layout and sizes [mm] of the board, and paper.

    Raises:
        TagError: the family or paper is unknown, `squares` is not understood, or the board is impossible or
            does not fit on the paper.
        OutputError: the file cannot be written.
    """
    board = parse_board(options)
    page = board_page(board, options.paper)
    write_pdf([page], output)
    return _print_message(output, page.caption, [page], options.paper)


def print_mat(paper: str, output: Path) -> str:
    """Write a mat, which lies under the object and shows the camera's pose, as a PDF.

    Args:
        paper: A4, A3, or A4x3 (three sheets A4 side by side).
        output: path of the PDF.

    Returns:
        Line for the user with file, free area [mm], number of pages and paper, and the ruler to measure.

    Raises:
        TagError: the paper is unknown.
        OutputError: the file cannot be written.
    """
    layout = mat(paper)
    pages = mat_pages(layout)
    write_pdf(pages, output)
    along, across = (2 * math.floor(half) for half in layout.free)
    sheets = f"{counted(len(pages), 'page')} {paper.partition('x')[0]}"
    return (
        f"{output}: mat with room for {along} x {across} mm; {sheets}: print at 100 %, then measure the "
        f"ruler on the pivot line: {layout.ruler_mm:g} mm"
    )


def parse_board(options: BoardOptions) -> Board:
    """Calibration board that the options describe; whether it fits on the paper is not checked.

    Raises:
        TagError: `squares` is not columns x rows, the family is unknown, or the board is impossible.
    """
    columns, _, rows = options.squares.lower().partition("x")
    if not (columns.isdecimal() and rows.isdecimal() and len(columns) < 4 and len(rows) < 4):
        raise TagError(f"--squares {options.squares}: not understood: write columns x rows, such as 7x9")
    marker = 0.7 * options.square_mm if options.marker_mm is None else options.marker_mm
    board = Board(options.family or families.ON_BOARDS, int(columns), int(rows), options.square_mm, marker)
    refuse_impossible(board)
    return board


def _refuse_mats(tags: Sequence[Tag]) -> None:
    """Check that no tag is one of a mat's, which would be taken for it.

    Raises:
        TagError: a tag belongs to the mat.
    """
    for tag in tags:
        if tag.family in FAMILIES and mat_of_tag(marker_name(TagFamily(tag.family), tag.id)) is not None:
            raise TagError(f"tag {tag.id} of {tag.family} belongs to the mat: choose ids below 500")


def _print_message(output: Path, contents: str, pages: Sequence[Page], paper: str) -> str:
    """Line for the user after a PDF was written: file, contents, number of pages, paper, how to print.

    Args:
        output: path of the PDF.
        contents: words for what is on the pages.
        pages: the pages.
        paper: name of the paper.
    """
    sheets = f"{counted(len(pages), 'page')} {paper}"
    return f"{output}: {contents}; {sheets}: print at 100 %, then measure the rulers"
