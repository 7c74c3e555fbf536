"""Plots of an archive's summary: scatter over what sessions state, and what became of the recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from analyze.report.style import BLUE, INK, MUTED, RED, style

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

WIDTH = 4.2
"""width of a plot [in]"""


def scatter_figure(ratios: Mapping[str, Sequence[float]]) -> Figure:
    """Figure of the scatter from session to session over the sd that sessions state, a row per quantity.

    A point is one object. Points right of 1 scatter more than stated; the scale is logarithmic.

    Args:
        ratios: scatter over stated sd of each object, above 0, by name of the quantity; at least one.
    """
    names = list(ratios)
    with style():
        figure = Figure(figsize=(WIDTH, 0.9 + 0.26 * len(names)), layout="constrained")
        axes = figure.subplots()
        axes.axvline(1.0, color=INK, lw=0.9)
        for row, name in enumerate(names):
            values = np.array(ratios[name])
            axes.plot(values, np.full(len(values), row), "o", color=BLUE, ms=5, alpha=0.6, mew=0)
        every = np.concatenate([np.array(values) for values in ratios.values()])
        axes.set_xscale("log", base=2)
        axes.set_xlim(min(0.25, 0.8 * float(every.min())), max(4.0, 1.25 * float(every.max())))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("scatter over stated sd")
    return figure


def outcomes_figure(results: int, failures: Sequence[tuple[str, int]]) -> Figure:
    """Figure of how many recordings gave a result, and how many failed by kind of failure.

    Args:
        results: number of recordings with a result.
        failures: kinds of failure in words, with their numbers of recordings.
    """
    names = ["result", *(name for name, _ in failures)]
    counts = np.array([results, *(count for _, count in failures)])
    with style():
        figure = Figure(figsize=(WIDTH, 0.8 + 0.3 * len(names)), layout="constrained")
        axes = figure.subplots()
        axes.barh(range(len(names)), counts, height=0.55, color=[BLUE] + [RED] * len(failures))
        for row, count in enumerate(counts):
            axes.annotate(f" {count}", (float(count), row), va="center", color=MUTED)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xlim(0, 1.15 * max(1, int(counts.max())))
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("recordings")
    return figure
