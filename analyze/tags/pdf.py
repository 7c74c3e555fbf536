"""Writes sheets of tags as a true-to-scale PDF; matplotlib keeps its points of 1/72 inch exact."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from analyze.tags.sheet import MARGIN, RULER_FOOT, RULER_MM, STRIP, Label, Page, PlacedTag, Rect
from schemas.output_file import write_bytes

MM_PER_INCH = 25.4
GREY, INK = "#9aa1a8", "#22262b"
PRINT_CHECK_LINES = (
    "Measure both rulers: each must be 100.0 mm long. If not, print again at 100 % (actual size),",
    "or state measured sizes: a tag's black square as size_m in the object file, or the board's squares.",
)


def write_pdf(pages: Sequence[Page], output: Path) -> None:
    """Write the pages as a PDF; the file appears complete or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    write_bytes(output, pdf_bytes(pages))


def pdf_bytes(pages: Sequence[Page]) -> bytes:
    """Bytes of a PDF file of the pages, the same on every run with the same matplotlib."""
    data = io.BytesIO()
    with (
        mpl.rc_context({"font.family": "DejaVu Sans", "text.parse_math": False}),
        PdfPages(data, metadata={"Creator": "Percuss", "Producer": None, "CreationDate": None}) as file,
    ):
        for page in pages:
            file.savefig(_figure(page))
    return data.getvalue()


def _figure(page: Page) -> Figure:
    """Draw a page, with its rulers; return a matplotlib figure of the paper's size."""
    figure = Figure(figsize=(page.width / MM_PER_INCH, page.height / MM_PER_INCH))
    sheet = _Sheet(figure, page)
    if page.heading:
        sheet.write(MARGIN, page.height - MARGIN - 3.0, page.heading, 10, bold=True)
    for placed in page.tags:
        _draw_tag(sheet, placed)
    if page.black:
        sheet.black(page.black)
    if page.caption:
        sheet.write(*page.caption_at, page.caption, 8)
    if page.origin is not None:
        _draw_origin(sheet, *page.origin)
    for stroke in page.strokes:
        sheet.line(stroke.start, stroke.end, stroke.width, GREY if stroke.grey else INK, stroke.dash)
    for label in page.labels:
        sheet.label(label)
    if page.rulers:
        _draw_rulers(sheet)
    return figure


class _Sheet:
    """Drawing area of a page, with coordinates in millimetres from the lower left corner, y up."""

    def __init__(self, figure: Figure, page: Page) -> None:
        self._figure, self._scale = figure, np.array([1 / page.width, 1 / page.height])

    def black(self, rectangles: Sequence[Rect]) -> None:
        """Fill rectangles (x, y, width, height [mm]) of the page with black.

        They are joined to one outline, so that no hairline shows between them.
        """
        corners = [
            [(f.x, f.y), (f.x + f.width, f.y), (f.x + f.width, f.y + f.height), (f.x, f.y + f.height)]
            for f in rectangles
        ]
        outline = Outline.make_compound_path_from_polys(np.array(corners) * self._scale)
        self._figure.add_artist(
            PathPatch(
                outline, facecolor="black", edgecolor="none", linewidth=0, transform=self._figure.transFigure
            )
        )

    def line(
        self,
        start: tuple[float, float],
        end: tuple[float, float],
        width_mm: float,
        colour: str = INK,
        dash: bool = False,
    ) -> None:
        """Draw a straight line of a width [mm] between two points (x, y) [mm], dashed if `dash`."""
        points = np.array([start, end]) * self._scale
        line = Line2D(
            *points.T,
            color=colour,
            lw=width_mm * 72 / MM_PER_INCH,
            transform=self._figure.transFigure,
            solid_capstyle="butt",
        )
        if dash:
            line.set_dashes([4, 3])
        self._figure.add_artist(line)

    def label(self, label: Label) -> None:
        """Write a text of the page."""
        where = np.array([label.x, label.y]) * self._scale
        weight = "bold" if label.bold else "normal"
        style = {"fontsize": label.points, "fontweight": weight, "ha": label.side, "va": "baseline"}
        self._figure.text(where[0], where[1], label.text, color=INK, **style)

    def write(
        self, x: float, y: float, text: str, points: float, *, bold: bool = False, turned: bool = False
    ) -> None:
        """Write one line of horizontal text on the page.

        Args:
            x: start of the text [mm]; its end if `turned`.
            y: baseline of the text [mm]; its middle if `turned`.
            text: the text.
            points: font size [1/72 inch].
            bold: True for bold letters.
            turned: True to place the text to the left of (x, y), as beside a vertical ruler.
        """
        where = np.array([x, y]) * self._scale
        self._figure.text(
            where[0],
            where[1],
            text,
            fontsize=points,
            fontweight="bold" if bold else "normal",
            ha="right" if turned else "left",
            va="center" if turned else "baseline",
            color=INK,
        )


def _draw_tag(sheet: _Sheet, placed: PlacedTag) -> None:
    """Draw a tag on a sheet, with a text strip below it and cutting lines around both.

    The text is the tag's id, size [mm] and family; family, then size, is left out for lack of room.
    """
    size, rim = placed.tag.size_mm, placed.quiet_zone
    left, right = placed.x - rim, placed.x + size + rim
    low, high = placed.y - rim, placed.y + size + rim
    for start, end in (
        ((left, high), (right, high)),
        ((left, low - STRIP), (left, high)),
        ((right, low - STRIP), (right, high)),
    ):
        sheet.line(start, end, 0.1, GREY)
    sheet.line((left, low - STRIP), (right, low - STRIP), 0.1, GREY)
    sheet.line((left, low), (right, low), 0.1, GREY, dash=True)
    sheet.black(placed.black)
    # The family is last because the strip below a small tag has no room for it. A 6.5 point letter is 1.4 mm
    # wide.
    parts = [f"id {placed.tag.id}", f"{size:g} mm", placed.tag.family]
    room = int((right - left - 1.5) / 1.4)
    while len(parts) > 1 and len(" · ".join(parts)) > room:
        parts.pop()
    sheet.write(left + 1.2, low - STRIP + 1.4, " · ".join(parts), 6.5)


def _draw_origin(sheet: _Sheet, x: float, y: float) -> None:
    """Draw arrows along a calibration board's x and y from its origin (x, y) [mm], outside the squares."""
    away, long, head = 1.0, 9.0, 1.4
    letters = {"x": (x + long + 1.0, y - away - 0.8), "y": (x - away - 0.7, y + long + 1.0)}
    for start, along, name in (
        ((x, y - away), np.array([1.0, 0.0]), "x"),
        ((x - away, y), np.array([0.0, 1.0]), "y"),
    ):
        tail, tip = np.array(start), np.array(start) + long * along
        across = np.array([-along[1], along[0]])
        sheet.line(tuple(tail), tuple(tip), 0.25)
        for side in (1.0, -1.0):
            sheet.line(tuple(tip - head * along + 0.5 * side * head * across), tuple(tip), 0.25)
        sheet.write(*letters[name], name, 8, bold=True)
    sheet.write(x - 4.2, y - 4.4, "0", 8, bold=True)
    sheet.line((x - away, y - away), (x - 2.4, y - 2.4), 0.15)


def _draw_rulers(sheet: _Sheet) -> None:
    """Draw a horizontal and a vertical ruler of 100 mm at the page's lower left, with a text on their use.

    The text asks the user to measure them, which shows whether the print is true to scale.
    """
    across, up = (MARGIN + 14.0, MARGIN + 13.0), (MARGIN + 11.5, MARGIN + RULER_FOOT + 6.0)
    for along, origin in ((np.array([1.0, 0.0]), across), (np.array([0.0, 1.0]), up)):
        start = np.array(origin)
        square = np.array([-along[1], along[0]])
        sheet.line(tuple(start), tuple(start + RULER_MM * along), 0.12)
        for mm in range(RULER_MM + 1):
            tick = 4.5 if mm % 10 == 0 else 3.2 if mm % 5 == 0 else 2.0
            at = start + mm * along
            sheet.line(tuple(at), tuple(at + tick * square), 0.12)
            if mm % 10 == 0:
                text = f"{mm} mm" if mm == RULER_MM and along[0] else str(mm)
                x, y = at + 5.4 * square
                sheet.write(float(x) - (0.7 if along[0] else 0.0), float(y), text, 6.5, turned=not along[0])
    for number, text in enumerate(PRINT_CHECK_LINES):
        sheet.write(MARGIN, MARGIN + 6.0 - 4.0 * number, text, 8)
