"""SVG elements of a picture, with coordinates in px; colours are the report's (Okabe & Ito 2008)."""

from __future__ import annotations

from xml.sax.saxutils import escape

import numpy as np

from analyze.types import Array

INK, MUTED, GRID = "#22262b", "#66707a", "#dfe3e7"
BLUE, RED, GREEN = "#0072b2", "#d55e00", "#00785a"
STRIKER, PIVOT, CAMERA = BLUE, RED, GREEN
ARROW_HEAD = (4.2, 1.9)
"""Length and half width of an arrow's head, in widths of its shaft."""


def polygon(points: Array, fill: str, stroke: str = "none", width: float = 0.0) -> str:
    """SVG element of a filled polygon.

    Args:
        points: (n, 2) corners [px].
        fill: Colour of the area.
        stroke: Colour of the outline.
        width: Width of the outline [px]; 0 for none.
    """
    line = f' stroke="{stroke}" stroke-width="{width:g}" stroke-linejoin="round"' if width else ""
    return f'<path d="M{_path(points)}Z" fill="{fill}"{line}/>'


def polyline(points: Array, colour: str, width: float, dash: str = "", opacity: float = 1.0) -> str:
    """SVG element of an open line.

    Args:
        points: (n, 2) points of the line [px].
        colour: Colour.
        width: Width [px].
        dash: Lengths of dashes and gaps [px], separated by blanks; empty for a continuous line.
        opacity: Opacity, 0 to 1.
    """
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    faint = f' opacity="{opacity:g}"' if opacity < 1 else ""
    return (
        f'<path d="M{_path(points)}" fill="none" stroke="{colour}" stroke-width="{width:g}" '
        f'stroke-linecap="round" stroke-linejoin="round"{dashes}{faint}/>'
    )


def cut_line(ends: Array, width: float, height: float) -> Array | None:
    """Part (2, 2) [px] of a straight line that lies within a picture; None if none does.

    A page may give a picture more room than it fills, and would show what is drawn beyond its edges.
    Algorithm: Y.-D. Liang and B. A. Barsky, ACM Trans. Graphics 3, 1984.

    Args:
        ends: (2, 2) ends of the line [px].
        width: Width of the picture [px].
        height: Height of the picture [px].
    """
    start, along = ends[0], ends[1] - ends[0]
    first, last = 0.0, 1.0
    for step, room in zip((*-along, *along), (*start, *(np.array([width, height]) - start)), strict=True):
        if step == 0 and room < 0:
            return None
        if step < 0:
            first = max(first, room / step)
        elif step > 0:
            last = min(last, room / step)
    return start + np.outer([first, last], along) if first < last else None


def disc(
    centre: Array, radius: float, fill: str, stroke: str = "none", width: float = 0.0, dash: str = ""
) -> str:
    """SVG element of a filled circle.

    Args:
        centre: (2,) centre [px].
        radius: Radius [px].
        fill: Colour of the area; "none" for a ring.
        stroke: Colour of the outline.
        width: Width of the outline [px]; 0 for none.
        dash: Lengths of the outline's dashes and gaps [px], separated by blanks; empty for a continuous one.
    """
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    line = f' stroke="{stroke}" stroke-width="{width:g}"{dashes}' if width else ""
    return f'<circle cx="{centre[0]:.1f}" cy="{centre[1]:.1f}" r="{radius:g}" fill="{fill}"{line}/>'


def arrow(points: Array, colour: str, width: float) -> list[str]:
    """Two SVG elements: the shaft and the head of an arrow.

    Args:
        points: (n, 2) points of the shaft [px], at least two; the head's tip is at the last one.
        colour: Colour.
        width: Width of the shaft [px].
    """
    tip, before = points[-1], points[-2]
    along = (tip - before) / max(float(np.linalg.norm(tip - before)), 1e-9)
    across = np.array([-along[1], along[0]])
    neck = tip - ARROW_HEAD[0] * width * along
    head = np.array([tip, neck + ARROW_HEAD[1] * width * across, neck - ARROW_HEAD[1] * width * across])
    shaft = np.vstack([points[:-1], neck + 0.5 * width * along])
    # Points of a curve within the head would form a hook.
    far = np.linalg.norm(shaft[:-1] - tip, axis=1) > ARROW_HEAD[0] * width
    shaft = np.vstack([shaft[:-1][far] if far.any() else shaft[:1], shaft[-1:]])
    line = (
        f'<path d="M{_path(shaft)}" fill="none" stroke="{colour}" stroke-width="{width:g}" '
        'stroke-linecap="butt" stroke-linejoin="round"/>'
    )
    return [line, polygon(head, colour)]


def text(
    where: Array | tuple[float, float],
    words: str,
    size: float,
    colour: str = INK,
    anchor: str = "middle",
) -> str:
    """SVG element of one line of bold text, with a white outline that keeps it legible on any background.

    Args:
        where: (2,) position of the anchor on the base line [px].
        words: Text; special characters are escaped.
        size: Font size [px].
        colour: Colour.
        anchor: SVG text-anchor: start, middle or end.
    """
    return (
        f'<text x="{where[0]:.1f}" y="{where[1]:.1f}" font-size="{size:g}" fill="{colour}" '
        f'text-anchor="{anchor}" font-weight="700" stroke="#fff" stroke-width="{0.26 * size:.1f}" '
        f'stroke-linejoin="round" paint-order="stroke">{escape(words)}</text>'
    )


def pill(where: Array | tuple[float, float], words: str, size: float, colour: str) -> str:
    """SVG elements, in one string, of white text on a rounded rectangle of one colour.

    Args:
        where: (2,) centre of the rectangle [px].
        words: Text; special characters are escaped.
        size: Font size [px].
        colour: Colour of the rectangle.
    """
    wide, high = 0.62 * size * len(words) + 0.9 * size, 1.5 * size
    return (
        f'<rect x="{where[0] - wide / 2:.1f}" y="{where[1] - high / 2:.1f}" width="{wide:.1f}" '
        f'height="{high:.1f}" rx="{high / 2:.1f}" fill="{colour}" stroke="#fff" stroke-width="1.5"/>'
        f'<text x="{where[0]:.1f}" y="{where[1] + 0.35 * size:.1f}" font-size="{size:g}" fill="#fff" '
        f'font-weight="700" text-anchor="middle">{escape(words)}</text>'
    )


def measure(
    start: Array, end: Array, words: str, size: float, colour: str, side: float, anchor: str = "middle"
) -> list[str]:
    """SVG elements of a dimension line with ticks and a text beside its middle.

    Args:
        start: (2,) start of the line [px], x right and y down.
        end: (2,) end of the line [px].
        words: Text; special characters are escaped.
        size: Font size [px].
        colour: Colour of line and text.
        side: Distance [px] of the text from the line, to the right if one looks from start to end; negative
            for the left.
        anchor: SVG text-anchor of the text.
    """
    along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
    across = np.array([-along[1], along[0]])
    ticks = [
        polyline(np.array([point - 7 * across, point + 7 * across]), colour, 2) for point in (start, end)
    ]
    middle = (start + end) / 2 + side * across + np.array([0.0, 0.36 * size])
    return [
        polyline(np.array([start, end]), colour, 2),
        *ticks,
        text(middle, words, size, colour, anchor),
    ]


def picture(width: float, height: float, parts: list[str], label: str) -> str:
    """Complete picture as an <svg> element that fills the width of its container.

    Args:
        width: Width of the drawing area [px].
        height: Height of the drawing area [px].
        parts: SVG elements, drawn in this order.
        label: Description for screen readers.
    """
    name = escape(label, {'"': ""})
    box = f"0 0 {width:g} {height:g}"
    opening = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" role="img" aria-label="{name}">'
    return opening + "\n".join(parts) + "</svg>"


def _path(points: Array) -> str:
    return "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
