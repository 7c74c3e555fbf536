"""Pages of the mat: its tags, pivot line, rulers, angle marks and words, in mm from the lower left corner."""

from __future__ import annotations

import math
from collections.abc import Iterator

from analyze.tags import families
from analyze.tags.mat import MAT_FAMILY, MAT_MARGIN_MM, Mat
from analyze.tags.sheet import Label, Page, Rect, Stroke, black_rectangles

_PIVOT_MM, _FINE_MM = 0.35, 0.12
"""widths of the pivot line and of fine marks [mm]"""
_ARROW_MM = 3.0
"""length of an arrow's head [mm]"""
_TIP_X, _ROOM_INSIDE = 12.0, 60.0
"""start of the arrow that shows where objects tip, and of its text [mm], inside angle marks of at least this
radius [mm]; outside smaller ones"""


def mat_pages(mat: Mat) -> list[Page]:
    """Pages of a mat, one per sheet of paper, from left to right."""
    return [_page(mat, sheet) for sheet in range(len(mat.middles))]


def _page(mat: Mat, sheet: int) -> Page:
    """One sheet: what lies in it of the mat's drawing in W, moved to the page."""
    left = mat.middles[sheet] - mat.width / 2
    low, high = mat.sheet_edges(sheet)
    black = tuple(_black(mat, sheet, left))
    strokes = tuple(
        stroke.moved(-left, mat.height / 2)
        for stroke in (*_marks(mat), *_seams(mat, sheet))
        if low - 1e-6 <= min(stroke.start[0], stroke.end[0])
        and max(stroke.start[0], stroke.end[0]) <= high + 1e-6
    )
    labels = tuple(
        label.moved(-left, mat.height / 2) for label in _labels(mat, sheet) if low <= label.x <= high
    )
    return Page(mat.width, mat.height, "", black=black, strokes=strokes, labels=labels, rulers=False)


def _black(mat: Mat, sheet: int, left: float) -> Iterator[Rect]:
    """Yield the black rectangles of a sheet's tags on its page.

    Args:
        mat: the mat.
        sheet: index of the sheet.
        left: x in W of the page's left edge [mm].
    """
    for tag in mat.tags:
        if tag.sheet == sheet:
            cells = families.cells(MAT_FAMILY.value, tag.id)
            x, y = tag.x - tag.width / 2 - left, tag.y - tag.height / 2 + mat.height / 2
            for part in black_rectangles(cells, 0.0, 0.0, 1.0):
                yield Rect(
                    x + part.x * tag.width,
                    y + part.y * tag.height,
                    part.width * tag.width,
                    part.height * tag.height,
                )


def _marks(mat: Mat) -> Iterator[Stroke]:
    """Yield the lines of the whole mat in W: pivot line, ruler across it, angle marks, arrows."""
    long, across = mat.ruler, _across(mat)
    yield Stroke((0.0, -long - 3.0), (0.0, long + 3.0), _PIVOT_MM)
    for sheet in range(len(mat.middles)):
        low, high = mat.sheet_edges(sheet)
        yield Stroke((max(low, -across), 0.0), (min(high, across), 0.0), _FINE_MM)
    for mm in range(-round(long), round(long) + 1):
        tick = _tick(mm)
        yield Stroke((0.0, float(mm)), (tick, float(mm)), _FINE_MM)
    for mm in range(-round(across), round(across) + 1):
        yield Stroke((float(mm), 0.0), (float(mm), -_tick(mm)), _FINE_MM)
    for degree in range(360):
        reach = 4.5 if degree % 10 == 0 else 3.0 if degree % 5 == 0 else 1.6
        # Headings are positive anticlockwise, seen from above.
        sine, cosine = -math.sin(math.radians(degree)), math.cos(math.radians(degree))
        ends = [((mat.radius - each) * sine, (mat.radius - each) * cosine) for each in (reach, 0.0)]
        yield Stroke(ends[0], ends[1], _FINE_MM, grey=True)
    yield from _arrow((_tip_x(mat), -11.5), (_tip_x(mat) + 22.0, -11.5))
    yield from _arrow((-9.0, -mat.ruler + 2.0), (-9.0, -mat.ruler + 14.0))


def _tick(mm: int) -> float:
    """Length of a ruler's tick at a whole millimetre [mm]."""
    return 4.0 if mm % 10 == 0 else 2.8 if mm % 5 == 0 else 1.6


def _across(mat: Mat) -> float:
    """Half length of the ruler across the pivot line, whole tens that fit between the tags [mm]."""
    return 10.0 * math.floor((mat.free[0] - 4.0) / 10.0)


def _tip_x(mat: Mat) -> float:
    """Start of the arrow that shows where objects tip, and of its text [mm]."""
    return _TIP_X if mat.radius > _ROOM_INSIDE else mat.radius + 6.0


def _arrow(tail: tuple[float, float], tip: tuple[float, float]) -> Iterator[Stroke]:
    """Yield the three lines of an arrow in W."""
    long = math.dist(tail, tip)
    x, y = (tip[0] - tail[0]) / long * _ARROW_MM, (tip[1] - tail[1]) / long * _ARROW_MM
    yield Stroke(tail, tip, 0.3)
    for side in (-0.4, 0.4):
        yield Stroke((tip[0] - x - side * y, tip[1] - y + side * x), tip, 0.3)


def _seams(mat: Mat, sheet: int) -> Iterator[Stroke]:
    """Yield where a sheet is cut or glued, in W: lines along its inner sides, with crosses to register them.

    The outer sheets are cut along their line; it comes to lie on that of the middle sheet.
    """
    for other in (sheet - 1, sheet + 1):
        if not 0 <= other < len(mat.middles):
            continue
        x = mat.sheet_edges(sheet)[0 if other < sheet else 1]
        inwards = 1.0 if other < sheet else -1.0
        half = mat.height / 2 - MAT_MARGIN_MM
        yield Stroke((x, -half), (x, half), _FINE_MM, dash=sheet != mat.reference)
        for y in (-0.85 * half, -0.4 * half, 0.4 * half, 0.85 * half):
            yield Stroke((x, y), (x + inwards * 6.0, y), _FINE_MM)
            for step in (2.0, 4.0):
                yield Stroke((x + inwards * step, y - 1.5), (x + inwards * step, y + 1.5), _FINE_MM)


def _labels(mat: Mat, sheet: int) -> Iterator[Label]:
    """Yield the words and numbers of a sheet, in W."""
    for mm in range(-round(mat.ruler), round(mat.ruler) + 1, 10):
        if mm:
            yield Label(4.8, mm - 0.8, f"{mm}".replace("-", "−"), 5.5)
    across = round(_across(mat))
    for mm in range(-across, across + 1, 10):
        if mm:
            yield Label(float(mm), -6.6, f"{mm}".replace("-", "−"), 5.5, "center")
    for degree in range(30, 360, 30):
        if degree % 90 == 0:
            continue
        sine, cosine = -math.sin(math.radians(degree)), math.cos(math.radians(degree))
        shown = degree if degree <= 180 else degree - 360
        yield Label(
            (mat.radius - 8.5) * sine,
            (mat.radius - 8.5) * cosine - 0.9,
            f"{shown}°".replace("-", "−"),
            6,
            "center",
        )
    yield Label(_tip_x(mat), -15.6, "objects tip this way", 7, bold=True)
    yield Label(-10.5, -mat.ruler + 8.0, "camera at", 7, "right", bold=True)
    yield Label(-10.5, -mat.ruler + 4.6, "this end", 7, "right", bold=True)
    yield from _words(mat)
    if sheet != mat.reference:
        low, high = mat.sheet_edges(sheet)
        name = "left" if sheet < mat.reference else "right"
        middle, cut = (low + high) / 2, "Cut along the dashed line, and glue it on the middle sheet's line."
        yield Label(
            middle, mat.free[1] - 5.0, f"Percuss mat {mat.paper}, {name} sheet", 9, "center", bold=True
        )
        yield Label(middle, mat.free[1] - 9.6, cut, 6, "center")


def _words(mat: Mat) -> Iterator[Label]:
    """Yield the mat's name and how to use it, left of the angle marks."""
    x = max(-mat.free[0] + 3.0, mat.sheet_edges(mat.reference)[0] + 8.0)
    y = mat.free[1] - 5.0
    sheets = ", middle sheet" if len(mat.middles) > 1 else ""
    yield Label(x, y, f"Percuss mat {mat.paper}{sheets}", 9, bold=True)
    ruler = f"{mat.ruler_mm:.1f} mm"
    lines = (
        f"Print at 100 %: on the pivot line, −{mat.ruler:g} to {mat.ruler:g}",
        f"must be {ruler} long.",
        "Tape the sheet flat on the table.",
        "Put the object on it: pivot edge on the line.",
    )
    for number, line in enumerate(lines):
        yield Label(x, y - 4.6 - 3.2 * number, line, 6)
