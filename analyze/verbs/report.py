"""`analyze report`: the estimate, or a comparison of sessions, as an HTML page, CSV tables or JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.verbs.estimate_files import compare_files, estimate_files
from analyze.verbs.options import chosen_cache, files_argument, one_line, path_option, with_estimate_options
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo, json_line

if TYPE_CHECKING:
    from analyze.report.csv_table import CsvTable


@click.command()
@files_argument
@with_estimate_options
@path_option(
    "-o", "--output", help="The page to write; default: FILE with .html; required for several files."
)
@click.option(
    "--compare",
    is_flag=True,
    help="Compare repeated sessions of one object: how well they repeat, and whether they agree.",
)
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print the page's content as JSON; the page itself is written only with -o.",
)
@path_option(
    "--csv", "csv_folder", metavar="FOLDER", help="Also write the page's tables as CSV files into FOLDER."
)
@one_line
def report(
    files: Sequence[Path],
    object_file: Path | None,
    exclude: tuple[str, ...],
    no_cache: bool,
    output: Path | None,
    compare: bool,
    as_json: bool,
    csv_folder: Path | None,
) -> None:
    """Write one HTML page with the answer, its reasons and plots.

    Several recordings give one answer together, or with --compare one answer each.
    """
    from analyze.report.csv_table import make_folder, write_tables

    output = _page_path(files, output, compare, as_json)
    refuse_outputs([output], files)
    if csv_folder is not None:
        make_folder(csv_folder)
    make = _comparison if compare else _answer
    page = make(files, object_file, exclude, no_cache)
    if output is not None:
        page.write(output)
        echo(f"report: {output}", err=as_json)
    if csv_folder is not None:
        tables = page.tables()
        write_tables(tables, csv_folder)
        echo(f"tables: {csv_folder}: {', '.join(table.name for table in tables)}", err=as_json)
    if as_json:
        echo(json_line(page.json()))


def _page_path(files: Sequence[Path], output: Path | None, compare: bool, as_json: bool) -> Path | None:
    """Path of the page to write: that of -o, else the recording's with the suffix .html.

    None if only JSON is printed.

    Raises:
        click.UsageError: --compare with fewer than two recordings, or several recordings with neither -o nor
            --json.
    """
    if compare and len(files) < 2:
        raise click.UsageError(
            "--compare needs two recordings or more: name them all, as in --compare a.mcap b.mcap -o "
            "compared.html"
        )
    if output is None and not as_json:
        if len(files) > 1:
            raise click.UsageError("several recordings make one report: name it with -o, as in -o joint.html")
        return files[0].with_suffix(".html")
    return output


@dataclass(frozen=True)
class _Page:
    """One report, to be written as HTML page, CSV tables or JSON; each field is a function that makes one."""

    write: Callable[[Path], None]
    """writes the HTML page to a path"""
    tables: Callable[[], list[CsvTable]]
    """tables of the page, for CSV files"""
    json: Callable[[], str]
    """content of the page as JSON text"""


def _answer(
    files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], no_cache: bool
) -> _Page:
    """Report on the estimate from all recordings together, as three functions.

    One writes the HTML page to a path, one returns its tables for CSV files, one returns JSON text. If all
    recordings are virtual, the HTML and JSON contain the errors against their ground truth.
    """
    # The code's version is read before the code is loaded.
    cache = chosen_cache(no_cache)
    answer = estimate_files(files, object_file, exclude, no_cache)
    from analyze.report.kept_page import write_report_with_cache
    from analyze.result.score import score_if_virtual

    score = score_if_virtual(files, answer)

    # What loads the library of plots is imported only where it is used.
    def tables() -> list[CsvTable]:
        from analyze.report.report_tables import report_tables

        return report_tables(answer)

    def json() -> str:
        from analyze.report.report import answer_summary
        from analyze.report.report_document import report_json

        return report_json(answer, answer_summary(answer), score)

    return _Page(lambda output: write_report_with_cache(answer, output, score, cache), tables, json)


def _comparison(
    files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], no_cache: bool
) -> _Page:
    """Functions that make the report on how well sessions of one object agree (HTML, tables, JSON).

    Each file is one session.
    """
    from analyze.report.comparison_page import comparison_json, comparison_tables, write_comparison

    found = compare_files(files, object_file, exclude, no_cache)
    return _Page(
        lambda output: write_comparison(found, output),
        lambda: comparison_tables(found),
        lambda: comparison_json(found),
    )
