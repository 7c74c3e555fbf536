"""Plot of the tipping angle theta(t) of every strike minus its prediction from all other strikes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from analyze.least_squares.intervals import SIGMAS_95
from analyze.report.style import BLUE, INK, MUTED, RED, style

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from analyze.pipeline.prediction import StrikePrediction

COLUMNS = 3
"""Panels side by side."""
LINEAR_DEG = 0.2
"""Angle [°] up to which the scale is linear; logarithmic beyond, because a band of 0.1° widens to 6°."""
TICKS = (0.2, 1.0, 5.0, 20.0)
"""Labelled angles [°]."""


def prediction_figure(strikes: Sequence[StrikePrediction]) -> Figure:
    """Matplotlib figure of measured minus predicted tipping angle [deg] over time, a panel per strike.

    Balance angle and rate constant are predicted from all other strikes; each predicted motion starts as the
    strike's own first free frames (shaded) do. A 95 % band is drawn: 1.96 sd of the difference. Strikes that
    are not consistent with their prediction are red.

    Raises:
        ValueError: there is no strike.
    """
    if not strikes:
        raise ValueError("no strike has a prediction")
    rows = math.ceil(len(strikes) / COLUMNS)
    columns = min(COLUMNS, len(strikes))
    with style():
        figure = Figure(figsize=(9.4, 0.45 + 1.4 * rows), layout="constrained")
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
        for axes, strike in zip(panels, strikes, strict=False):
            _panel(axes, strike)
        _set_scales(panels[0], strikes)
        for axes in panels[len(strikes) :]:
            axes.set_visible(False)
        for column in range(columns):
            lowest = panels[max(i for i in range(column, len(strikes), columns))]
            lowest.tick_params(labelbottom=True)
            lowest.set_xlabel("time [s]")
        figure.supylabel("measured minus predicted [°]", fontsize=8.5)
    return figure


def prediction_figures(strikes: Sequence[StrikePrediction]) -> list[Figure]:
    """One figure per strike of measured minus predicted tipping angle [deg] over time, with common scales."""
    figures: list[Figure] = []
    with style():
        for strike in strikes:
            figure = Figure(figsize=(3.1, 1.9), layout="constrained")
            axes = figure.subplots()
            _panel(axes, strike)
            _set_scales(axes, strikes)
            axes.set_xlabel("time [s]")
            axes.set_ylabel("difference [°]")
            figures.append(figure)
    return figures


def _set_scales(axes: Axes, strikes: Sequence[StrikePrediction]) -> None:
    """Set limits that fit all strikes, and a vertical scale that is linear up to `LINEAR_DEG`."""
    most = max(
        float(np.max(np.maximum(np.abs(each.motion.offset), SIGMAS_95 * each.motion.sd))) for each in strikes
    )
    limit = 1.15 * max(np.degrees(most), LINEAR_DEG)
    axes.set_yscale("asinh", linear_width=LINEAR_DEG)
    axes.set_ylim(-limit, limit)
    ticks = [tick for tick in TICKS if tick < limit]
    axes.yaxis.set_major_locator(FixedLocator([*(-tick for tick in reversed(ticks)), 0.0, *ticks]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{value:+g}".replace("-", "−") if value else "0")
    )
    axes.set_xlim(0.0, 1.02 * max(float(each.motion.time[-1]) for each in strikes))


def _panel(axes: Axes, strike: StrikePrediction) -> None:
    motion = strike.motion
    colour = BLUE if strike.consistent else RED
    offset, band = np.degrees(motion.offset), np.degrees(SIGMAS_95 * motion.sd)
    axes.axvspan(0.0, float(motion.time[motion.start]), color=MUTED, alpha=0.1, lw=0, zorder=0)
    axes.axhline(0.0, color=INK, lw=0.6, zorder=1)
    axes.fill_between(motion.time, -band, band, color=colour, alpha=0.16, lw=0, zorder=2)
    axes.plot(motion.time, offset, ".-", color=colour, ms=2.6, lw=0.8, zorder=3)
    sigmas = max(strike.left_out.sigmas, strike.motion_sigmas)
    label = f"{sigmas:.1f} sd" if strike.consistent else f"{sigmas:.1f} sd: not predicted"
    axes.set_title(strike.left_out.strike_id, fontsize=8.5)
    axes.set_title(
        label,
        loc="right",
        fontsize=8,
        fontweight="normal" if strike.consistent else "bold",
        color=MUTED if strike.consistent else RED,
    )
