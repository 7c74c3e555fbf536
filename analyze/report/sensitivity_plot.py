"""Plots and text on the sensitivity of the centre of mass c to single strikes and kinds of error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from analyze.estimation.sensitivity import ErrorSource
from analyze.least_squares.intervals import SIGMAS_95
from analyze.report.style import BLUE, CYCLE, INK, MUTED, style

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.sensitivity import Sensitivity
    from analyze.types import Array

TENTH_DEG = float(np.radians(0.1))
MIN_SHARE = 0.005
"""Share of the variance below which a kind of error is not drawn."""
REMEDIES = {
    ErrorSource.NOISE: "more strikes, or a larger marker nearer to the camera",
    ErrorSource.SCATTER: "more strikes, and an edge that does not slip",
    ErrorSource.TILT: "an edge struck again with the object turned by 180°, or a level reading in the rig",
    ErrorSource.SCALE: "the object measured along one length, and its shape corrected",
    ErrorSource.ROUNDING: "the edges' rounding measured (edge_radius_m), or upright and lying tips together",
    ErrorSource.PLACE: "a finer scan, or strikes over other edges and faces",
    ErrorSource.ANGLE: "strikes over other edges, or with the object turned on the table",
    ErrorSource.K: "strikes that pass upright, in which φ determines c and k contributes little",
    ErrorSource.PRIOR: "strikes about axes in new directions",
    ErrorSource.MASS: "object and markers weighed more precisely",
    ErrorSource.FIXTURE: "a lighter fixture, weighed by itself, and the object's place in it measured",
}
"""Remedy that reduces each kind of error, as the end of a sentence."""


@dataclass(frozen=True)
class SourceRow:
    """Contribution of one kind of error to the uncertainty of the centre of mass, for a bar of the figure.

    It is given as half width [m] of a 95 % interval and as share of the variance, both along the direction in
    which the whole uncertainty is largest.
    """

    source: ErrorSource
    """Kind of error."""
    half: float
    """Half width [m] of the 95 % interval from this kind of error alone."""
    share: float
    """Share of the variance, 0 to 1."""


def worst_direction(covariance: Array) -> Array:
    """Direction of the largest uncertainty of the centre of mass: unit vector (3,) in the object frame O.

    Its component of largest magnitude is positive.

    Args:
        covariance: (3, 3) covariance of the centre of mass [m²].
    """
    worst = np.linalg.eigh(covariance)[1][:, -1]
    return worst * np.sign(worst[int(np.argmax(np.abs(worst)))])


def source_rows(sensitivity: Sensitivity, covariance: Array) -> list[SourceRow]:
    """Contribution of each kind of error to the uncertainty of the centre of mass, largest first.

    One row per kind: its name, half width [m] of the 95 % interval from this kind alone, and its share of the
    variance, both in the direction in which the centre of mass is least certain.

    Args:
        sensitivity: covariance of the centre of mass by kind of error.
        covariance: (3, 3) covariance of the centre of mass [m²] from all kinds together.
    """
    worst = worst_direction(covariance)
    whole = float(worst @ covariance @ worst)
    rows = [
        SourceRow(each.source, SIGMAS_95 * float(np.sqrt(max(variance, 0.0))), variance / whole)
        for each in sensitivity.shares
        for variance in [float(worst @ each.covariance @ worst)]
    ]
    return sorted(rows, key=lambda row: -row.share)


def largest_source_text(rows: Sequence[SourceRow]) -> str:
    """Sentences on the largest contributions to the uncertainty of the centre of mass, and a remedy.

    They name kinds of error with their shares of the variance; the remedy is that for the first.

    Args:
        rows: at least one kind of error, the largest first; the second is named if its share of the
            variance is above 15 %.
    """
    first, *others = rows
    text = f"{100 * first.share:.0f} % of the variance is {first.source.value}"
    if others and others[0].share > 0.15:
        text += f", {100 * others[0].share:.0f} % {others[0].source.value}"
    return f"{text}. Most effective remedy: {REMEDIES[first.source]}."


def sources_figure(rows: Sequence[SourceRow], half: float) -> Figure:
    """Figure of 95 % half widths of the centre of mass as bars: all errors together, then each kind.

    Args:
        rows: kinds of error, from `source_rows`; those with less than 0.5 % of the variance are not drawn.
        half: half width [m] of the 95 % interval from all kinds together.
    """
    shown = [row for row in rows if row.share >= MIN_SHARE]
    names = ["all together", *(row.source.value for row in shown)]
    values = 1e3 * np.array([half, *(row.half for row in shown)])
    place = np.arange(len(names))
    with style():
        figure = Figure(figsize=(4.2, 0.75 + 0.27 * len(names)), layout="constrained")
        axes = figure.subplots()
        axes.barh(place, values, height=0.62, color=[INK, *[BLUE] * len(shown)])
        digits = 2 if values[0] >= 0.05 else 3
        for y, value, row in zip(place, values, [None, *shown], strict=True):
            share = "" if row is None else f"  {100 * row.share:.0f} %"
            axes.annotate(
                f"±{value:.{digits}f}{share}",
                (value, y),
                (3, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
            )
        axes.set_yticks(place, names)
        axes.set_ylim(len(names) - 0.5, -0.6)
        axes.set_xlim(0, 1.32 * values.max())
        axes.set_xlabel("half width of the 95 % interval [mm]")
        axes.grid(visible=False, axis="y")
    return figure


def influence_figure(sensitivity: Sensitivity) -> Figure:
    """Figure of the shift [mm] of the centre of mass along x, y, z if a strike's phi were 0.1° larger.

    phi is the balance angle. One bar per strike, in the colour of its pivot axis.
    """
    strikes = sensitivity.strikes
    moved = 1e3 * TENTH_DEG * np.array([strike.by_phi for strike in strikes]).reshape(-1, 3)
    names = sorted({strike.axis_id for strike in strikes})
    colours = [CYCLE[names.index(strike.axis_id) % len(CYCLE)] for strike in strikes]
    place = np.arange(len(strikes))
    reach = 1.1 * float(np.abs(moved).max(initial=1e-6))
    with style():
        figure = Figure(figsize=(4.2, 0.75 + 0.27 * (len(strikes) + 1)), layout="constrained")
        panels = figure.subplots(1, 3, sharey=True, sharex=True)
        for axes, along, name in zip(panels, moved.T, "xyz", strict=True):
            axes.barh(place, along, height=0.62, color=colours)
            axes.axvline(0.0, color=MUTED, lw=0.7)
            axes.set_title(name)
            axes.grid(visible=False, axis="y")
        panels[0].set_yticks(place, [strike.strike_id for strike in strikes])
        panels[0].set_ylim(len(strikes) - 0.5, -0.6)
        panels[0].set_xlim(-reach, reach)
        tick = _round_number(0.85 * reach)
        panels[0].set_xticks([-tick, 0.0, tick], [f"−{tick:g}", "0", f"{tick:g}"])
        figure.supxlabel("shift of c [mm] if φ is larger by 0.1°", fontsize=8.5)
    return figure


def _round_number(most: float) -> float:
    """Largest of the numbers 1, 2 and 5 times a power of ten that is not above `most`; 0 for 0."""
    if most <= 0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(most))
    return float(next(each for each in (5.0, 2.0, 1.0) if each * power <= most * (1 + 1e-9)) * power)
