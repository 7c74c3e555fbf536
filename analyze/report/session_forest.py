"""Forest plot of one quantity over an object's sessions, with their mean and what a new one would report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from analyze.least_squares.intervals import SIGMAS_95
from analyze.report.style import BLUE, INK, MUTED, RED, SKY, style

PANEL_WIDTH = 3.1
"""width of a panel [in]"""
MAX_HEIGHT = 9.0
"""largest height of the rows together [in]"""
CROWDED = 16
"""number of sessions from which on not every one has its date beside it"""


@dataclass(frozen=True)
class ForestRow:
    """One session in a forest plot."""

    label: str
    """date of the session"""
    value: float
    """its value"""
    sd: float
    """its stated sd"""
    odd: bool
    """True if it stands out"""


def session_forest_figure(
    title: str, rows: Sequence[ForestRow], mean: tuple[float, float], prediction_half: float
) -> Figure:
    """Figure of the sessions' values with their stated 95 % intervals, in order of time, the mean last.

    Args:
        title: name and unit of the quantity.
        rows: sessions by start time.
        mean: estimate over all sessions, and half width of its 95 % interval (dark band).
        prediction_half: half width, about the mean, of the 95 % interval of what a new session would report
            (light band); NaN if unknown.
    """
    count, (centre, half) = len(rows), mean
    pitch = 0.24 if count < CROWDED else min(0.13, MAX_HEIGHT / count)
    with style():
        figure = Figure(figsize=(PANEL_WIDTH, 0.9 + pitch * (count + 1)), layout="constrained")
        axes = figure.subplots()
        axes.grid(visible=False, axis="y")
        if math.isfinite(prediction_half):
            axes.axvspan(centre - prediction_half, centre + prediction_half, color=SKY, alpha=0.14, lw=0)
        axes.axvspan(centre - half, centre + half, color=SKY, alpha=0.3, lw=0)
        axes.axvline(centre, color=BLUE, lw=0.9)
        for place, row in enumerate(rows):
            colour, reach = RED if row.odd else INK, SIGMAS_95 * row.sd
            axes.plot([row.value - reach, row.value + reach], [place, place], color=colour, lw=1.3)
            axes.plot(row.value, place, "s" if row.odd else "o", color=colour, ms=5 if row.odd else 3.6)
        axes.plot([centre - half, centre + half], [count, count], color=BLUE, lw=1.8)
        axes.plot(centre, count, "D", color=BLUE, ms=5)
        every = 1 if count < CROWDED else math.ceil(count / CROWDED)
        ticks = [*range(0, count - (every > 1), every), count]
        axes.set_yticks(ticks, [*(rows[i].label for i in ticks[:-1]), "mean"])
        axes.tick_params(axis="y", length=0, labelcolor=MUTED)
        axes.set_ylim(count + 0.6, -0.6)
        axes.ticklabel_format(axis="x", useOffset=False, style="plain")
        axes.xaxis.set_major_locator(MaxNLocator(4))
        figure.suptitle(title, x=0.0, ha="left", fontsize=9, fontweight="bold")
    return figure
