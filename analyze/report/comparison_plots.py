"""Plots that compare sessions (recordings of one object): estimates, and balance angles edge by edge."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from analyze.report.style import BLUE, INK, MUTED, RED, SKY, style

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from schemas.comparison import QuantityPrecision

PANEL_WIDTH = 3.1
"""width of a panel [in]; the page puts as many side by side as fit"""
MAX_LABEL_CHARACTERS = 20
"""characters of all numbers under a panel above which only the first and the last are written"""


def forest_figure(
    quantity: QuantityPrecision, names: Sequence[str], factor: float, unit: str, odd: int | None = None
) -> Figure:
    """Figure of each session's estimate of one quantity with its 95 % interval.

    A session is one recording of the object. Line and band are the joint estimate from all strikes and its
    95 % interval, where there is one.

    Args:
        quantity: quantity to be drawn.
        names: names of the sessions, in order.
        factor: conversion from SI to `unit`.
        unit: unit of the axis.
        odd: index of the session that is marked as deviating; None if there is none.
    """
    count = len(names)
    with style():
        figure = Figure(figsize=(PANEL_WIDTH, 0.95 + 0.24 * (count + 1)), layout="constrained")
        axes = figure.subplots()
        _forest(axes, quantity, factor, odd, count)
        figure.suptitle(quantity.name, x=0.0, ha="left", fontsize=9, fontweight="bold")
        axes.set_xlabel(f"[{unit}]")
        _few_ticks(axes)
        axes.set_yticks(range(count + 1), [*names, "joint"])
        axes.set_ylim(count + 0.5, -0.5)
    return figure


def _few_ticks(axes: Axes) -> None:
    """Label a panel's horizontal axis with numbers that do not touch, written out without an offset."""
    axes.ticklabel_format(axis="x", useOffset=False, style="plain")
    low, high = axes.get_xlim()
    ticks = [tick for tick in MaxNLocator(3).tick_values(low, high) if low <= tick <= high]
    labels = axes.xaxis.get_major_formatter().format_ticks(ticks)
    if sum(map(len, labels)) > MAX_LABEL_CHARACTERS:
        ticks = [ticks[0], ticks[-1]]
    axes.set_xticks(ticks)


def _forest(axes: Axes, quantity: QuantityPrecision, factor: float, odd: int | None, count: int) -> None:
    axes.grid(visible=False, axis="y")
    joint = quantity.together
    if joint is not None and isinstance(joint.value, float) and joint.interval95:
        ends: list[float] = joint.interval95  # type: ignore[assignment] - a scalar's interval here
        low, high = (factor * float(end) for end in ends)
        axes.axvspan(low, high, color=SKY, alpha=0.18, lw=0)
        axes.axvline(factor * joint.value, color=BLUE, lw=0.9)
        axes.plot([low, high], [count, count], color=BLUE, lw=1.6)
        axes.plot(factor * joint.value, count, "D", color=BLUE, ms=5.5)
    for row in quantity.sessions:
        place, is_odd = row.session - 1, row.session - 1 == odd
        colour = RED if is_odd else INK
        if row.interval95 is not None:
            axes.plot(
                [factor * end for end in row.interval95],
                [place, place],
                color=colour,
                lw=1.6,
                solid_capstyle="butt",
            )
        axes.plot(factor * row.value, place, "s" if is_odd else "o", color=colour, ms=6 if is_odd else 5)


def angles_figures(
    quantities: Sequence[QuantityPrecision], names: Sequence[str], odd: int | None = None
) -> list[Figure]:
    """Figures of balance angles phi [°] of strikes minus the sessions' mean, one per edge and heading.

    Each point is a strike that tipped over, in the row of its session. The heading is the direction on the
    table in which the object was struck. All figures have the same scale.

    Args:
        quantities: values of phi [rad] by session and their mean, one entry per pivot edge and heading.
        names: names of the sessions, in order.
        odd: index of the session that is marked as deviating; None if there is none.
    """
    count = len(names)
    reach = 1.15 * max(
        (math.degrees(max(abs(v - q.mean) for row in q.sessions for v in row.results)) for q in quantities),
        default=0.0,
    )
    figures: list[Figure] = []
    with style():
        for quantity in quantities:
            figure = Figure(figsize=(PANEL_WIDTH, 0.9 + 0.22 * count), layout="constrained")
            axes = figure.subplots()
            axes.grid(visible=False, axis="y")
            axes.axvline(0.0, color=MUTED, lw=0.7)
            for row in quantity.sessions:
                is_odd = row.session - 1 == odd
                off = np.degrees(np.array(row.results) - quantity.mean)
                axes.plot(
                    off,
                    np.full(len(off), row.session - 1),
                    "s" if is_odd else "o",
                    color=RED if is_odd else INK,
                    ms=4.5,
                    alpha=0.75,
                    mew=0,
                )
            title = f"{quantity.name}: {math.degrees(quantity.mean):.2f}°"
            figure.suptitle(title, x=0.0, ha="left", fontsize=9, fontweight="bold")
            axes.set_yticks(range(count), names)
            axes.set_ylim(count - 0.5, -0.5)
            axes.set_xlim(-reach, reach)
            axes.set_xlabel("φ minus the mean of the edge [°]")
            _few_ticks(axes)
            figures.append(figure)
    return figures
