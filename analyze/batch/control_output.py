"""Control charts of an archive in words, as rows of a table, and as figures of a page."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow as pa
from markupsafe import Markup
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table

from analyze.batch.control_rows import ControlSummary, SessionChart
from analyze.batch.sessions import start_seconds
from analyze.report.control_plots import ChartLine, control_figure
from analyze.report.page import figure_element
from analyze.result.digits import decimals, number, signed
from schemas.terminal import Terminal
from schemas.wording import counted

MAX_DATES = 3
"""largest number of sessions outside their limits that a text names"""
MAX_CHARTS = 12
"""largest number of an object's charts that a page draws; those of rigs are all drawn"""

LATEST = 5
"""largest number of latest sessions over which a drift is stated"""
_TEXTS = ("subject", "quantity", "unit", "created", "url")
_NUMBERS = ("value", "stated_sd", "centre", "low", "high", "ewma", "ewma_low", "ewma_high")
_FLAGS = ("baseline", "outside", "drifted")
CONTROL_COLUMNS: list[tuple[str, pa.DataType]] = [
    *((name, pa.string()) for name in _TEXTS),
    *((name, pa.float64()) for name in _NUMBERS),
    *((name, pa.bool_()) for name in _FLAGS),
]
"""columns of the table of charts, one row per chart and session; values in `unit`"""


def signal_text(each: SessionChart) -> str:
    """Text on what is out of control in a chart; "" if nothing is.

    It names the sessions outside their limits and the time in which the EWMA was outside its own, with the
    distance from the baseline's mean in the chart's unit.
    """
    chart, said = each.chart, []
    if chart.unsteady:
        said.append(f"drift within the baseline, {_day(each, 0)} to {_day(each, chart.baseline - 1)}")
    outside = np.flatnonzero(chart.outside)
    if len(outside):
        shown = [
            f"{_day(each, i)} ({_away(each, float(chart.value[i]))})" for i in outside[-MAX_DATES:].tolist()
        ]
        more = f" and {len(outside) - MAX_DATES} earlier" if len(outside) > MAX_DATES else ""
        said.append(f"outside its limits on {', '.join(shown)}{more}")
    runs = _runs(chart.drifted)
    if runs:
        first, last = runs[-1]
        if last == len(chart.value) - 1:
            # The EWMA counts outliers at their limit: it shows that there is a drift, not how large it is.
            latest = chart.value[max(first, last + 1 - LATEST) :]
            said.append(
                f"drift since {_day(each, first)}: mean of the last {counted(len(latest), 'session')} "
                f"{_away(each, float(latest.mean()))}"
            )
        elif last > first:
            said.append(f"drift from {_day(each, first)} to {_day(each, last)}, then back")
        elif not chart.outside[first]:
            said.append(f"mean outside its limits on {_day(each, first)}")
    return "; ".join(said)


def limits_text(each: SessionChart) -> str:
    """Text on where the limits of a chart come from: number of sessions, and what gives the sd."""
    chart = each.chart
    left_out = f" without {counted(chart.outliers, 'outlier')}" if chart.outliers else ""
    by = "stated sd" if chart.by_stated else "moving range"
    return f"{counted(chart.baseline, 'session')}{left_out}, {by}"


def chance_text(control: ControlSummary) -> str:
    """Sentence on the number of charts, and of the signals that chance alone gives; "" without charts."""
    if not control.charts:
        return ""
    expected = number(control.expected_false_alarms, 1)
    return (
        f"{counted(len(control.charts), 'chart')}, {len(control.out_of_control)} out of control; chance "
        f"alone gives at most {expected} signals in all of them"
    )


def print_control(console: Terminal, control: ControlSummary) -> None:
    """Print what is out of control as a table, and why charts are missing; nothing without any session."""
    found = control.out_of_control
    for subject in dict.fromkeys(each.subject for each in found):
        table = Table(
            title=f"Out of control: {subject}",
            title_justify="left",
            box=SIMPLE_HEAD,
            show_edge=False,
            show_header=False,
            padding=(0, 1, 0, 0),
            width=78,
        )
        table.add_column(width=26)
        table.add_column(overflow="fold")
        for each in found:
            if each.subject == subject:
                table.add_row(each.quantity, f"{signal_text(each)} [{each.severity:.1f} x limit]")
        console.print(table)
        console.print()
    if control.charts:
        console.print(f"Control charts: {chance_text(control)}.")
    for note in control.missing:
        console.print(f"{note[:1].upper()}{note[1:]}.")
    if control.charts or control.missing:
        console.print()


def control_rows(control: ControlSummary) -> Iterator[dict[str, Any]]:
    """Yield the rows of the table of charts, with the columns of `CONTROL_COLUMNS`."""
    for each in control.charts:
        chart = each.chart
        for i in range(len(chart.value)):
            centre, stated = chart.centre, each.stated_sd[i]
            yield {
                "subject": each.subject,
                "quantity": each.quantity,
                "unit": each.unit,
                "created": each.created[i],
                "url": each.urls[i],
                "value": float(chart.value[i]),
                "stated_sd": None if math.isnan(stated) else stated,
                "centre": centre,
                "low": centre - float(chart.half[i]),
                "high": centre + float(chart.half[i]),
                "ewma": float(chart.ewma[i]),
                "ewma_low": centre - float(chart.ewma_half[i]),
                "ewma_high": centre + float(chart.ewma_half[i]),
                "baseline": i < chart.baseline,
                "outside": bool(chart.outside[i]),
                "drifted": bool(chart.drifted[i]),
            }


def control_figures(control: ControlSummary) -> dict[str, list[tuple[Markup, str]]]:
    """Figures of the charts, by subject: element and caption of each.

    All charts of rigs are drawn, and of the objects' those out of control, the worst `MAX_CHARTS`.
    """
    chosen = [each for each in control.charts if each.of_rig]
    chosen += [each for each in control.out_of_control if not each.of_rig][:MAX_CHARTS]
    found: dict[str, list[tuple[Markup, str]]] = {}
    for each in chosen:
        chart = each.chart
        line = ChartLine(
            each.quantity,
            each.unit,
            np.array([start_seconds(text) for text in each.created]) / 86400.0,
            chart.value,
            chart.centre,
            chart.half,
            chart.ewma,
            chart.ewma_half,
            chart.baseline,
        )
        caption = signal_text(each) or "in control"
        found.setdefault(each.subject, []).append((figure_element(control_figure(line)), caption))
    return found


def _day(each: SessionChart, i: int) -> str:
    """Date of a session, with the minute where the chart has several on that day."""
    day = each.created[i][:10]
    several = sum(other.startswith(day) for other in each.created) > 1
    return each.created[i][:16].replace("T", " ") if several else day


def _away(each: SessionChart, value: float) -> str:
    """Distance of a value from the centre, with sign and unit, as "+0.31 %"."""
    digits = decimals(float(np.median(each.chart.half)))
    space = "" if each.unit == "°" else " "
    return f"{signed(value - each.chart.centre, digits)}{space}{each.unit}"


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each run of true values in flags (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(start), int(stop) - 1) for start, stop in edges.reshape(-1, 2)]
