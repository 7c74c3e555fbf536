"""`analyze archive scrub`: read every byte and compare it with its hashes."""

from __future__ import annotations

import re
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from analyze.verbs.archive.selection import json_option, print_json_lines, with_selection
from analyze.verbs.options import one_line, results_folder_option
from schemas.command_line import INTERRUPTED, LOSS, NumberRange
from schemas.plain_text import echo
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.catalogue.listing import Selection
    from analyze.catalogue.scrub import ScrubReport
    from analyze.catalogue.table import Row

_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0}
_SHOWN = ("url", "scrub", "scrub_reason", "scrubbed_at", "sha256", "size_bytes")


class _Duration(click.ParamType):
    """Time span with its unit, as 90s, 30m or 8h; converted to seconds."""

    name = "time"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        if isinstance(value, float):
            return value
        match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", str(value))
        if match is None:
            self.fail(f"{value!r} is not a time: write 90s, 30m or 8h", param, ctx)
        return float(match[1]) * _UNITS[match[2]]


@click.command()
@results_folder_option
@with_selection
@click.option(
    "--for", "seconds", type=_Duration(), metavar="TIME", help="Begin no recording after TIME: 30m or 8h."
)
@click.option(
    "--older-than",
    "days",
    type=NumberRange(0),
    default=0.0,
    metavar="DAYS",
    help="Only recordings that were not read in this many days.",
)
@json_option
@one_line
def scrub(output: Path, selection: Selection, seconds: float | None, days: float, as_json: bool) -> None:
    """Read every byte of the recordings and compare it with its hashes; what is oldest first.

    Outcomes are kept: a scrub that was interrupted, or ended by --for, goes on where it stopped.
    """
    from analyze.catalogue.listing import list_recordings
    from analyze.catalogue.scrub import scrub as scrub_recordings
    from analyze.catalogue.table import open_catalogue
    from analyze.progress import ProgressBar

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    urls = list_recordings(output, selection).column("url").to_pylist()
    # The outcomes are printed before the catalogue is saved, for the disk may be full.
    with open_catalogue(output) as catalogue:
        known = [url for url in urls if url in catalogue.rows]
        with ProgressBar() as progress:
            report = scrub_recordings(
                catalogue, known, output, seconds=seconds, older_than_days=days, progress=progress
            )
        _print_report(report, list(catalogue.rows.values()), as_json=as_json)
    if report.interrupted:
        raise click.exceptions.Exit(INTERRUPTED)
    if report.problems:
        raise click.exceptions.Exit(LOSS)


def _print_report(report: ScrubReport, rows: list[Row], *, as_json: bool) -> None:
    """Print the outcomes: as lines of JSON or in numbers, and a line per problem.

    Args:
        report: outcomes of the scrub.
        rows: rows of the catalogue, among which whole copies are sought.
        as_json: True for one line of JSON per recording that was read.
    """
    if as_json:
        print_json_lines({name: row.get(name) for name in _SHOWN} for row in report.rows)
    else:
        outcomes = [row["scrub"] for row in report.rows]
        counts = ", ".join(f"{outcomes.count(each)} {each}" for each in sorted(set(outcomes)))
        read = f"{counted(len(outcomes), 'recording')} read ({report.size_bytes / 1e9:.2f} GB)"
        echo(f"{read}{': ' if counts else ''}{counts}; {report.left} left")
    whole = _whole_copies(rows, [row["url"] for row in report.problems])
    for row in report.problems:
        copy = whole.get(row["url"])
        echo(f"{row['scrub_reason']}" + (f" (a whole one is {copy})" if copy else ""), err=True)


def _whole_copies(rows: list[Row], damaged: list[str]) -> dict[str, str]:
    """Copy of each of these recordings with the same content that was whole at its latest scrub."""
    from analyze.catalogue.copies import SAME_CONTENT, find_copies

    found: dict[str, str] = {}
    for group in find_copies(rows):
        if group.kind == SAME_CONTENT and group.best["scrub"] == "whole":
            found |= {row["url"]: group.best["url"] for row in group.others if row["url"] in damaged}
    return found
