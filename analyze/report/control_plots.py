"""Plot of a control chart: sessions over time with their limits, and the EWMA with its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from analyze.report.style import BLUE, INK, MUTED, ORANGE, RED, SKY, style

if TYPE_CHECKING:
    from analyze.types import Array

WIDTH = 3.9
"""width of a plot [in]"""
HEADROOM = 0.08
"""space over and under what is drawn, as a fraction of its height"""


@dataclass(frozen=True)
class ChartLine:
    """What a control chart shows of n sessions, in the quantity's unit."""

    name: str
    """name of the quantity"""
    unit: str
    """its unit"""
    days: Array
    """(n,) start times [days since 1970]"""
    value: Array
    """(n,) values"""
    centre: float
    """mean of the baseline"""
    half: Array
    """(n,) half width of the sessions' limits"""
    ewma: Array
    """(n,) exponentially weighted moving average"""
    ewma_half: Array
    """(n,) half width of its limits"""
    baseline: int
    """number of sessions of the baseline"""


def control_figure(line: ChartLine) -> Figure:
    """Figure of a control chart over time.

    Points are sessions, hollow in the baseline, red squares outside their limits (dashed); the line is the
    EWMA, the band its limits, orange where it is outside them.
    """
    outside = np.abs(line.value - line.centre) > line.half
    drifted = np.abs(line.ewma - line.centre) > line.ewma_half
    base = np.arange(len(line.value)) < line.baseline
    with style():
        figure = Figure(figsize=(WIDTH, 2.15), layout="constrained")
        axes = figure.subplots()
        low, high = line.centre - line.ewma_half, line.centre + line.ewma_half
        axes.fill_between(line.days, low, high, color=SKY, alpha=0.18, lw=0)
        axes.axhline(line.centre, color=MUTED, lw=0.7)
        for sign in (-1, 1):
            axes.plot(line.days, line.centre + sign * line.half, color=MUTED, lw=0.8, ls=(0, (4, 3)))
        axes.plot(line.days, line.ewma, color=BLUE, lw=1.4)
        axes.plot(line.days, np.where(drifted, line.ewma, np.nan), color=ORANGE, lw=2.4)
        first, later = base & ~outside, ~base & ~outside
        axes.plot(line.days[first], line.value[first], "o", mfc="white", mec=INK, ms=3.2, mew=0.8)
        axes.plot(line.days[later], line.value[later], "o", color=INK, ms=3.0, mew=0)
        axes.plot(line.days[outside], line.value[outside], "s", color=RED, ms=4.8, mew=0)
        every = np.concatenate([line.value, line.centre - line.half, line.centre + line.half])
        room = HEADROOM * float(np.ptp(every))
        axes.set_ylim(float(every.min()) - room, float(every.max()) + room)
        locator = AutoDateLocator(minticks=3, maxticks=6)
        axes.xaxis.set_major_locator(locator)
        axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
        axes.ticklabel_format(axis="y", useOffset=False)
        figure.suptitle(f"{line.name} [{line.unit}]", x=0.0, ha="left", fontsize=9, fontweight="bold")
    return figure
