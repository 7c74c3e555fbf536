"""Print the summary of an archive's results, or write it as HTML, CSV or Parquet."""

from __future__ import annotations

import math
from dataclasses import asdict, fields
from itertools import groupby
from pathlib import Path

import pyarrow as pa
from markupsafe import Markup
from rich.box import SIMPLE_HEAD
from rich.table import Table

from analyze.batch.control_output import (
    CONTROL_COLUMNS,
    chance_text,
    control_figures,
    control_rows,
    limits_text,
    print_control,
    signal_text,
)
from analyze.batch.query_output import plain_console, save_answer
from analyze.batch.summary import Repeated, Summary
from analyze.errors import ArchiveError
from analyze.report.archive_plots import outcomes_figure, scatter_figure
from analyze.report.page import figure_element, page_environment
from analyze.result.digits import decimals, number, signed
from schemas.output_file import write_text
from schemas.terminal import Terminal
from schemas.wording import counted

SUFFIXES = (".html", ".csv", ".parquet")
_TYPES = {"str": pa.string(), "int": pa.int64(), "float": pa.float64()}
_REPEATED = [(each.name, _TYPES[str(each.type)]) for each in fields(Repeated) if each.name != "drift_freedom"]
_OBJECTS = [
    ("object", pa.string()),
    ("object_sha256", pa.string()),
    *((name, pa.int64()) for name in ("sessions", "strikes", "used", "stated_times")),
]
_FAILURES = [("failure", pa.string()), ("recordings", pa.int64()), ("example", pa.string())]


MAX_SHOWN = 20
"""largest number of outstanding quantities that are printed; files contain all"""


def render_summary(summary: Summary) -> None:
    """Print a summary of an archive's results on standard output.

    Tables: measured quantities that vary over an object's sessions beyond chance (scatter, or drift with
    time), what is out of control in the control charts, objects, repeatability per object, and failures.
    """
    console = plain_console()
    print_control(console, summary.control)
    if summary.standing_out:
        _print_standing_out(console, summary)
    objects = Table(title="Objects", title_justify="left")
    for heading in ("object", "", "sessions", "strikes", "used", "stated times"):
        objects.add_column(heading, justify="left" if heading in {"object", ""} else "right")
    for name, sha256, sessions, strikes, used, stated in summary.objects:
        objects.add_row(name, sha256[:8], str(sessions), str(strikes), str(used), str(stated or ""))
    console.print(objects)
    for name, sha256, sessions, _, _, stated in summary.objects:
        if 0 < stated < sessions:
            console.print(
                f"{name} ({sha256[:8]}): in {stated} of {counted(sessions, 'session')} the frame times "
                "come from no rig's clock (time_source)"
            )
    if summary.repeated:
        console.print("\nRepeatability from session to session (n sessions; scatter and stated: 1 sd)")
    for (name, sha256), rows in groupby(summary.repeated, key=lambda each: (each.object, each.object_sha256)):
        repeated = _compact_table(f"{name} ({sha256[:8]})")
        for heading in ("quantity", "n", "mean", "scatter", "stated", "chi²/dof", "drift/day"):
            repeated.add_column(heading, justify="left" if heading == "quantity" else "right", no_wrap=True)
        for each in rows:
            *others, drift = cells(each)
            repeated.add_row(each.quantity, str(each.sessions), *others, drift.removesuffix(f" {each.unit}"))
        console.print(repeated)
        console.print()
    _print_failures(console, summary)


def _print_standing_out(console: Terminal, summary: Summary) -> None:
    table = _compact_table("What stands out", width=78)
    for heading in ("object", "quantity", ""):
        table.add_column(heading, overflow="fold")
    for each in summary.standing_out[:MAX_SHOWN]:
        table.add_row(f"{each.object} ({each.object_sha256[:8]})", each.quantity, stands_out_text(each))
    console.print(table)
    if len(summary.standing_out) > MAX_SHOWN:
        console.print(f"... and {len(summary.standing_out) - MAX_SHOWN} more: --save summary.html shows all")
    console.print()


def _compact_table(title: str, width: int | None = None) -> Table:
    box, padding = SIMPLE_HEAD, (0, 1, 0, 0)
    return Table(title=title, title_justify="left", box=box, show_edge=False, padding=padding, width=width)


def _print_failures(console: Terminal, summary: Summary) -> None:
    """Print a table of the recordings without a result by kind of failure, or one line if none failed."""
    if not summary.failures:
        console.print(f"{counted(summary.recordings, 'recording')}, none failed")
        return
    table = Table(title="No result", title_justify="left")
    table.add_column("why")
    table.add_column("recordings", justify="right")
    table.add_column("for example", overflow="fold")
    for kind, many, example in summary.failures:
        table.add_row(kind, str(many), example)
    console.print(table)


def cells(each: Repeated) -> tuple[str, str, str, str, str]:
    """Texts for the table cells of a quantity's repeatability.

    Mean and standard deviations have as many decimals as give the smaller of the two standard deviations two
    significant digits, none if it is 10 or more; the drift as many as give them to its half width; chi-square
    has one.

    Returns:
        Mean with unit; standard deviation from session to session; median of the standard deviations that the
        sessions' results state; chi-square per degree of freedom; drift per day ± half width of its 95 %
        interval, with unit. NaN is shown as "–".
    """
    digits = decimals(min(sd for sd in (each.scatter, each.stated) if not math.isnan(sd)))
    places = decimals(each.drift_half)
    drift = (
        "–"
        if math.isnan(each.drift)
        else f"{signed(each.drift, places)} ± {number(each.drift_half, places)} {each.unit}"
    )
    return (
        f"{number(each.mean, digits)} {each.unit}",
        _number(each.scatter, digits),
        _number(each.stated, digits),
        _number(each.chi_square, 1),
        drift,
    )


def stands_out_text(each: Repeated) -> str:
    """Text on a quantity that varies from session to session more than chance explains.

    It states whether the values scatter or drift (have a trend over time), their sd from session to session,
    the median sd that the sessions state, and the drift per day if they drift, in the quantity's unit.
    """
    _, scatter, stated, _, drift = cells(each)
    drifts = f" by {drift} a day" if each.stands_out.endswith("drifts") else ""
    return (
        f"{each.stands_out}{drifts} (scatter {scatter}, stated {stated} {each.unit}, "
        f"{counted(each.sessions, 'session')})"
    )


def save_summary(summary: Summary, path: Path) -> list[Path]:
    """Write a summary of an archive's results as HTML, CSV or Parquet, by the path's suffix.

    As CSV or Parquet, `path` holds the table of repeatability; the tables of objects, failures and control
    charts are written beside it as `<stem>-objects`, `<stem>-failures` and `<stem>-control` with the same
    suffix.

    Returns:
        Paths of the files written, `path` first; the only one for HTML.

    Raises:
        ArchiveError: the suffix is unknown.
        OutputError: a file cannot be written.
    """
    if path.suffix not in SUFFIXES:
        raise ArchiveError(f"{path}: unknown file type {path.suffix!r}: use {', '.join(SUFFIXES)}")
    if path.suffix == ".html":
        write_text(
            path,
            page_environment()
            .get_template("archive.html")
            .render(
                summary=summary,
                cells=cells,
                stands_out_text=stands_out_text,
                figures=_figures(summary),
                control=control_figures(summary.control),
                signal_text=signal_text,
                limits_text=limits_text,
                chance=chance_text(summary.control),
            ),
        )
        return [path]
    written: list[Path] = []
    for name, columns, rows in (
        ("", _REPEATED, [asdict(each) for each in summary.repeated]),
        ("-objects", _OBJECTS, [dict(zip(dict(_OBJECTS), row, strict=True)) for row in summary.objects]),
        ("-failures", _FAILURES, [dict(zip(dict(_FAILURES), row, strict=True)) for row in summary.failures]),
        ("-control", CONTROL_COLUMNS, list(control_rows(summary.control))),
    ):
        # An empty table is written too, so that an earlier summary's file is not mistaken for this one's.
        place = path.with_name(f"{path.stem}{name}{path.suffix}")
        save_answer(pa.Table.from_pylist(rows, pa.schema(columns)), place)
        written.append(place)
    return written


def _figures(summary: Summary) -> list[tuple[Markup, str]]:
    """Plots of the page, each with its caption: scatter over stated sd, and outcomes of the recordings."""
    ratios: dict[str, list[float]] = {}
    for each in summary.repeated:
        if each.scatter > 0 and each.stated > 0:
            ratios.setdefault(each.quantity, []).append(each.scatter / each.stated)
    failures = [(kind.replace("_", " "), many) for kind, many, _ in summary.failures]
    outcomes = outcomes_figure(summary.recordings, failures)
    found = [(figure_element(outcomes), "Recordings with a result, and without one by reason.")]
    if ratios:
        caption = "A point is one object: right of the line its sessions scatter more than they state."
        found.insert(0, (figure_element(scatter_figure(ratios)), caption))
    return found


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"
