"""Printed design of a virtual object's surface: rectangles of grey on flat panels, as on a package.

A design consists of a coloured block with a name in large letters, a logo of bars and blocks, a stepped
gradient, a bar code and lines of small text, drawn from a seed. The design belongs to the camera's images
only; no file that an estimator reads contains it.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np

MOST_CONTRAST = {"print": 90.0, "light": 12.0, "blank": 0.0}
"""largest step in grey level between a face and its print, by kind of print; a face has 150"""
_NAMES = ("TELMO", "FIHLE", "HELTI", "LOFTI", "TILIA", "NELLI", "ETHEL", "LEFTI", "MILET", "HEFTI")
_WORDS = ("net", "wt", "mix", "oat", "fine", "best", "kcal", "salt", "per", "lot", "ml", "use", "by", "new")
_MARGIN = 0.07
"""border of a panel without print, as a fraction of its shorter edge"""
_SMALL_TEXT_M = 0.006
"""height of a line of small text, with its gap [m]"""


class PrintKind(StrEnum):
    """Kind of print on a virtual object."""

    PRINT = "print"
    """strong print, up to 90 grey levels"""
    LIGHT = "light"
    """pale print, up to 12 grey levels"""
    BLANK = "blank"
    """faces of one grey"""


@dataclass(frozen=True)
class Packaging:
    """Surface of a virtual object as the camera sees it: kind of print, its seed, and gloss."""

    kind: PrintKind = PrintKind.BLANK
    seed: int = 0
    glossy: bool = False
    """True if faces show a soft highlight, which stays with camera and lamp"""

    @property
    def is_plain(self) -> bool:
        """True if faces have one grey and no gloss."""
        return self.kind is PrintKind.BLANK and not self.glossy


BLANK = Packaging()
"""faces of one grey, without gloss"""


@dataclass(frozen=True)
class Patches:
    """Rectangles of print on a flat chart of the surface; where they overlap, their steps add up."""

    low: np.ndarray
    """(n, 2) lower left corners [m]"""
    high: np.ndarray
    """(n, 2) upper right corners [m]"""
    step: np.ndarray
    """(n,) grey levels against the unprinted face"""


@dataclass(frozen=True)
class Panel:
    """Upright rectangle of the chart that gets a design of its own [m]."""

    left: float
    bottom: float
    right: float
    top: float

    @property
    def width(self) -> float:
        """Extent along u [m]."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Extent along v [m]."""
        return self.top - self.bottom

    def part(self, left: float, bottom: float, right: float, top: float) -> Panel:
        """Part of the panel, its borders as fractions of width and height."""
        return Panel(
            self.left + left * self.width,
            self.bottom + bottom * self.height,
            self.left + right * self.width,
            self.bottom + top * self.height,
        )


def design(panels: tuple[Panel, ...], packaging: Packaging, name: str) -> Patches:
    """Print on panels of an object's surface.

    Args:
        panels: the panels; each has its own design, with a name common to all.
        packaging: kind and seed of the print.
        name: name of the object, from which the designs depend too.

    Returns:
        Rectangles of all panels; none for a blank object.
    """
    rng = np.random.default_rng((packaging.seed, zlib.crc32(name.encode()), 0x9A17))
    brand = str(rng.choice(_NAMES))
    found: list[tuple[float, ...]] = []
    for panel in panels:
        edge = _MARGIN * min(panel.width, panel.height)
        inner = Panel(panel.left + edge, panel.bottom + edge, panel.right - edge, panel.top - edge)
        found += _panel(inner, brand, rng)
    if packaging.kind is PrintKind.BLANK or not found:
        return Patches(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    table = np.array(found)
    return Patches(table[:, :2], table[:, 2:4], table[:, 4] * MOST_CONTRAST[packaging.kind])


def _panel(panel: Panel, brand: str, rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Rectangles (left, bottom, right, top [m], step over the most contrast) of one panel."""
    if panel.height < 0.6 * panel.width:
        return _title(panel.part(0.0, 0.3, 1.0, 1.0), brand, rng) + _steps(panel.part(0, 0, 1, 0.18), rng)
    title = panel.part(0.0, rng.uniform(0.68, 0.72), 1.0, 1.0)
    found = _title(title, brand, rng)
    found += _steps(panel.part(0.0, 0.6, 1.0, 0.65), rng)
    logo, text = panel.part(0.05, 0.3, 0.5, 0.56), panel.part(0.56, 0.3, 1.0, 0.56)
    found += _logo(logo, rng) + _text_lines(text, rng)
    if rng.random() < 0.5:
        found += _bar_code(panel.part(0.08, 0.04, 0.5, 0.22), rng)
        found += _word_bars(panel.part(0.56, 0.02, 1.0, 0.24), 0, rng)
    else:
        found += _word_bars(panel.part(0.0, 0.1, 1.0, 0.26), 0, rng) + _steps(panel.part(0, 0, 1, 0.06), rng)
    return found


def _title(panel: Panel, brand: str, rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Block of colour with the name in large letters, and a stripe."""
    depth = rng.uniform(0.75, 1.0)
    dark = -depth
    found = [_rectangle(panel, dark)]
    found += _text(panel.part(0.08, 0.36, 0.92, 0.88), brand, depth, thickness=2)
    found.append(_rectangle(panel.part(0.08, 0.2, 0.92, 0.24), 0.8 * depth))
    word = str(rng.choice(_WORDS))
    return found + _text(panel.part(0.12, 0.02, 0.88, 0.17), word, 0.9 * depth, thickness=1)


def _steps(panel: Panel, rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Gradient across a strip, in ten steps."""
    edges = np.linspace(0.0, 1.0, 11)
    levels = np.linspace(-0.1, -1.0, 10)
    levels = levels if rng.random() < 0.5 else levels[::-1]
    return [_rectangle(panel.part(edges[i], 0, edges[i + 1], 1), float(levels[i])) for i in range(10)]


def _logo(panel: Panel, rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Logo of blocks in a frame: a random chequer, or nested frames."""
    if rng.random() < 0.5:
        tone = -rng.uniform(0.6, 1.0)
        signs = (1.0, -1.0, 1.0, -0.7)
        return [
            _rectangle(panel.part(0.12 * i, 0.12 * i, 1 - 0.12 * i, 1 - 0.12 * i), tone * sign)
            for i, sign in enumerate(signs)
        ]
    tones = rng.choice([0.0, -0.45, -0.8, 0.35], (4, 4), p=[0.3, 0.25, 0.3, 0.15])
    return [
        _rectangle(panel.part(i / 4, j / 4, (i + 1) / 4, (j + 1) / 4), float(tones[i, j]))
        for i in range(4)
        for j in range(4)
        if tones[i, j]
    ]


def _bar_code(panel: Panel, rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Bar code on a white ground."""
    found = [_rectangle(panel.part(-0.06, -0.06, 1.06, 1.06), 0.5)]
    at = 0.0
    while at < 0.96:
        wide = float(rng.choice([0.02, 0.04, 0.06]))
        found.append(_rectangle(panel.part(at, 0.0, min(at + wide, 1.0), 1.0), -1.4))
        at += wide + float(rng.choice([0.025, 0.05]))
    return found


def _text_lines(panel: Panel, rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Small print: a word in letters, below it lines of words drawn as bars."""
    lines = _line_count(panel)
    title = panel.part(0, 1 - 1.4 / lines, 0.7, 1)
    found = _text(title, str(rng.choice(_WORDS)), -0.8, thickness=1)
    return found + _word_bars(panel, 2, rng)


def _word_bars(panel: Panel, first: int, rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Words of small print as bars, from a line on."""
    lines = _line_count(panel)
    found: list[tuple[float, ...]] = []
    for line in range(first, lines):
        bottom, at = 1.0 - (line + 0.8) / lines, 0.0
        end = rng.uniform(0.6, 1.0)
        while at < end - 0.05:
            wide = float(rng.uniform(0.12, 0.45)) * min(1.0, 0.03 / panel.width)
            found.append(_rectangle(panel.part(at, bottom, min(at + wide, 1.0), bottom + 0.45 / lines), -0.7))
            at += wide + 0.04
    return found


def _line_count(panel: Panel) -> int:
    return max(2, int(panel.height / _SMALL_TEXT_M))


def _text(panel: Panel, text: str, step: float, thickness: int) -> list[tuple[float, ...]]:
    """Text as rectangles, as large as fits into a panel, in its middle."""
    scale = 0.7 * thickness if thickness > 1 else 0.75
    (wide, tall), base = cv2.getTextSize(text, cv2.FONT_HERSHEY_PLAIN, scale, thickness)
    image = np.zeros((tall + base + 4, wide + 4), np.uint8)
    cv2.putText(image, text, (2, tall + 1), cv2.FONT_HERSHEY_PLAIN, scale, 255, thickness, cv2.LINE_8)
    rows, columns = np.nonzero(image)
    image = image[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] > 0
    cell = min(panel.width / image.shape[1], panel.height / image.shape[0])
    left = 0.5 * (panel.left + panel.right - cell * image.shape[1])
    top = 0.5 * (panel.bottom + panel.top + cell * image.shape[0])
    return [
        (left + cell * a, top - cell * bottom, left + cell * b, top - cell * first, step)
        for first, bottom, a, b in filled_rectangles(image)
    ]


def filled_rectangles(image: np.ndarray) -> list[tuple[int, int, int, int]]:
    """Rectangles (first row, end row, first column, end column) that cover the True cells of an image once.

    Runs along the rows are merged with equal runs in the rows below.
    """
    open_runs: dict[tuple[int, int], int] = {}
    found: list[tuple[int, int, int, int]] = []
    for number, row in enumerate(np.vstack([image, np.zeros((1, image.shape[1]), bool)])):
        steps = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
        runs = set(zip(steps[::2].tolist(), steps[1::2].tolist(), strict=True))
        ended = [run for run in open_runs if run not in runs]
        found += [(open_runs.pop(run), number, *run) for run in ended]
        for run in runs:
            open_runs.setdefault(run, number)
    return found


def _rectangle(panel: Panel, step: float) -> tuple[float, ...]:
    return panel.left, panel.bottom, panel.right, panel.top, step
