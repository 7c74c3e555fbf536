"""Style of all plots: colour-blind safe colours (Okabe & Ito 2008), plain axes, reproducible SVG."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from schemas.output_file import OutputError, write_bytes

INK = "#22262b"
MUTED = "#7b848e"
GRID = "#e6e9ec"
BLUE = "#0072b2"
ORANGE = "#e69f00"
GREEN = "#009e73"
RED = "#d55e00"
PURPLE = "#cc79a7"
SKY = "#56b4e9"
CYCLE = (BLUE, ORANGE, GREEN, PURPLE, SKY, RED)

BODY = "#f4f6f8"
"""Fill colour of the object's silhouette."""
EMPTY, EMPTY_LINES = "#f4f5f6", "#c9ced3"
"""Colours of a hatched area, where nothing is known."""
DENSITY_MAP = "Blues"
GOOD_TO_BAD = LinearSegmentedColormap.from_list(
    "good to bad", ["#0b6e4f", "#7cc6a4", "#f3f3e6", "#f0b27a", "#c0392b"]
)

PHASES = {
    "rest": "#eef1f4",
    "strike": "#fbe3d3",
    "stage_one": "#e1eefb",
    "stage_two": "#e0f3ec",
    "landing": "#f4e9f1",
}
"""Colours of the bands behind a motion."""

THEMED = {
    "#ffffff": "ground",
    INK: "ink",
    MUTED: "muted",
    GRID: "grid",
    BODY: "body",
    EMPTY: "empty",
    EMPTY_LINES: "empty-lines",
    BLUE: "blue",
    ORANGE: "orange",
    GREEN: "green",
    PURPLE: "purple",
    SKY: "sky",
    RED: "red",
    **{colour: f"phase-{name.replace('_', '-')}" for name, colour in PHASES.items()},
}
"""Colours that pages redefine for dark mode, with the names of their CSS variables less `--plot-`."""
_COLOUR = re.compile(rf"\b(fill|stroke|stop-color): ({'|'.join(THEMED)})\b")

_SETTINGS: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "text.parse_math": False,  # a dollar sign in a name is a dollar sign
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "svg.fonttype": "path",
    "svg.hashsalt": "percuss",
}


@contextmanager
def style() -> Iterator[None]:
    """Apply the plot style within a `with` block; matplotlib's settings are restored afterwards."""
    with mpl.rc_context(_SETTINGS):
        yield


def plain(axes: Axes) -> None:
    """Turn axes into a drawing area with equal scales, without grid and without left and bottom border."""
    axes.set_aspect("equal")
    axes.grid(visible=False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)


FIGURE_FORMATS = (".png", ".svg", ".pdf")


def write_figure(figure: Figure, output: Path) -> None:
    """Write a figure as PNG, SVG or PDF, by the suffix of `output`.

    Raises:
        OutputError: the format is unknown, or the file cannot be written.
    """
    suffix = output.suffix.lower()
    if suffix not in FIGURE_FORMATS:
        raise OutputError(f"{output}: unknown figure format: choose {', '.join(FIGURE_FORMATS)}")
    data = io.BytesIO()
    with style():
        figure.savefig(data, format=suffix[1:], dpi=160)
    write_bytes(output, data.getvalue())


def svg(figure: Figure) -> str:
    """SVG text of a figure: one <svg> element without XML header; the same figure gives the same text."""
    text = io.StringIO()
    with style():
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None, "Creator": None})
    markup = text.getvalue()
    return _themed(markup[markup.index("<svg") :])


def _themed(markup: str) -> str:
    """SVG text in which the colours of `THEMED` follow the page's theme, light or dark."""
    return _COLOUR.sub(lambda found: f"{found[1]}: var(--plot-{THEMED[found[2]]}, {found[2]})", markup)
