"""Sessions beside each other: answers with their intervals, and the strikes' angles edge by edge."""

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


def forest_figure(
    quantities: Sequence[QuantityPrecision],
    names: Sequence[str],
    factor: float,
    unit: str,
    odd: int | None = None,
) -> Figure:
    """Each session's answer with its 95 % interval, a panel per quantity; the band and the line are all strikes' together.

    Args:
        quantities: at least one.
        names: of the sessions, in order.
        factor: from SI to `unit`.
        unit: for the axes.
        odd: place of the session that stands out.
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
        panels[0].set_yticks(range(count + 1), [*names, "together"])
        panels[0].set_ylim(count + 0.5, -0.5)
    return figure


def _forest(axes: Axes, quantity: QuantityPrecision, factor: float, odd: int | None, count: int) -> None:
    axes.grid(visible=False, axis="y")
    whole = quantity.together
    if whole is not None and isinstance(whole.value, float) and whole.interval95:
        low, high = (factor * float(end) for end in whole.interval95)  # type: ignore[arg-type] - a scalar's here
        axes.axvspan(low, high, color=SKY, alpha=0.18, lw=0)
        axes.axvline(factor * whole.value, color=BLUE, lw=0.9)
        axes.plot([low, high], [count, count], color=BLUE, lw=1.6)
        axes.plot(factor * whole.value, count, "D", color=BLUE, ms=5.5)
    for row in quantity.sessions:
        place, stands_out = row.session - 1, row.session - 1 == odd
        colour = RED if stands_out else INK
        if row.interval95 is not None:
            axes.plot(
                [factor * end for end in row.interval95],
                [place, place],
                color=colour,
                lw=1.6,
                solid_capstyle="butt",
            )
        axes.plot(
            factor * row.value, place, "s" if stands_out else "o", color=colour, ms=6 if stands_out else 5
        )


def angles_figure(
    quantities: Sequence[QuantityPrecision], names: Sequence[str], odd: int | None = None
) -> Figure:
    """Phi of every strike that went over, less the mean of its edge, by session: a panel per planned strike."""
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
                stands_out = row.session - 1 == odd
                off = np.degrees(np.array(row.results) - quantity.mean)
                place = np.full(len(off), row.session - 1)
                axes.plot(
                    off,
                    place,
                    "s" if stands_out else "o",
                    color=RED if stands_out else INK,
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
        figure.supxlabel("φ less the mean of the edge [°]", fontsize=8.5)
    return figure
