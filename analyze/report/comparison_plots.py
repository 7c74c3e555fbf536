"""Plots that compare sessions (recordings of one object): estimates, and balance angles edge by edge."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from analyze.report.style import BLUE, INK, MUTED, RED, SKY, style

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from schemas.comparison import QuantityPrecision

COLUMNS = 3
"""panels side by side"""


def forest_figure(
    quantities: Sequence[QuantityPrecision],
    names: Sequence[str],
    factor: float,
    unit: str,
    odd: int | None = None,
) -> Figure:
    """Figure of each session's estimate with its 95 % interval, one panel per quantity.

    A session is one recording of the object. Line and band are the joint estimate from all strikes and its
    95 % interval, where there is one.

    Args:
        quantities: quantities to be drawn, at least one.
        names: names of the sessions, in order.
        factor: conversion from SI to `unit`.
        unit: unit of the axes.
        odd: index of the session that is marked as deviating; None if there is none.
    """
    rows = math.ceil(len(quantities) / COLUMNS)
    columns = min(COLUMNS, len(quantities))
    count = len(names)
    with style():
        figure = Figure(
            figsize=(9.4 if columns > 1 else 4.6, rows * (0.95 + 0.27 * (count + 1))), layout="constrained"
        )
        panels = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
        for axes, quantity in zip(panels, quantities, strict=False):
            _forest(axes, quantity, factor, odd, count)
            axes.set_title(quantity.name)
            axes.set_xlabel(f"[{unit}]")
            axes.locator_params(axis="x", nbins=5)
        for axes in panels[len(quantities) :]:
            axes.set_visible(False)
        panels[0].set_yticks(range(count + 1), [*names, "joint"])
        panels[0].set_ylim(count + 0.5, -0.5)
    return figure


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


def angles_figure(
    quantities: Sequence[QuantityPrecision], names: Sequence[str], odd: int | None = None
) -> Figure:
    """Figure of balance angles phi [°] of strikes minus the sessions' mean, a panel per edge and heading.

    Each point is a strike that tipped over, in the row of its session. The heading is the direction on the
    table in which the object was struck.

    Args:
        quantities: values of phi [rad] by session and their mean, one entry per pivot edge and heading, at
            least one.
        names: names of the sessions, in order.
        odd: index of the session that is marked as deviating; None if there is none.
    """
    rows = math.ceil(len(quantities) / COLUMNS)
    columns = min(COLUMNS, len(quantities))
    count = len(names)
    reach = 1.15 * max(
        math.degrees(max(abs(v - q.mean) for row in q.sessions for v in row.results)) for q in quantities
    )
    with style():
        figure = Figure(
            figsize=(9.4 if columns > 1 else 4.6, rows * (0.8 + 0.24 * count) + 0.3), layout="constrained"
        )
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
        for axes, quantity in zip(panels, quantities, strict=False):
            axes.grid(visible=False, axis="y")
            axes.axvline(0.0, color=MUTED, lw=0.7)
            for row in quantity.sessions:
                is_odd = row.session - 1 == odd
                off = np.degrees(np.array(row.results) - quantity.mean)
                place = np.full(len(off), row.session - 1)
                axes.plot(
                    off,
                    place,
                    "s" if is_odd else "o",
                    color=RED if is_odd else INK,
                    ms=4.5,
                    alpha=0.75,
                    mew=0,
                )
            axes.set_title(f"{quantity.name.removeprefix('φ ')}: {math.degrees(quantity.mean):.2f}°")
        for axes in panels[len(quantities) :]:
            axes.set_visible(False)
        for column in range(columns):
            panels[max(i for i in range(column, len(quantities), columns))].tick_params(labelbottom=True)
        panels[0].set_yticks(range(count), names)
        panels[0].set_ylim(count - 0.5, -0.5)
        panels[0].set_xlim(-reach, reach)
        figure.supxlabel("φ minus the mean of the edge [°]", fontsize=8.5)
    return figure
