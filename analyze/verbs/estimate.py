"""What is made of the strikes: `analyze estimate`, `score` and `report`."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.verbs.options import compared, estimated, files_argument, one_line, with_estimate_options

if TYPE_CHECKING:
    from analyze.report.csv_table import CsvTable


@click.command()
@files_argument
@with_estimate_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--voxels", type=click.Path(path_type=Path), help="Also write the evenest map of the mass, cell by cell (CSV).")
@one_line
def estimate(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], as_json: bool, voxels: Path | None) -> None:
    """Centre of mass, moments of inertia and region masses from a recording, or from several of one object."""
    from analyze.output_file import refuse_unwritable
    from analyze.reading.file_series import row_of
    from analyze.report.summary import render_summary
    from analyze.report.voxel_map import write_voxels

    if voxels is not None:
        refuse_unwritable(voxels, *(part for file in files for part in row_of(file).files))
    answer = estimated(files, object_file, exclude)
    if voxels is not None:
        write_voxels(answer.voxels, voxels)
        click.echo(
            f"voxels: {voxels}: {len(answer.voxels.points)} cells, of which {answer.voxels.directions} numbers were measured", err=True
        )
    if as_json:
        click.echo(answer.json())
    else:
        render_summary(answer)


@click.command()
@files_argument
@with_estimate_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def score(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], as_json: bool) -> None:
    """Truth beside estimate, for virtual recordings."""
    from analyze.pipeline.score import refuse_without_truth, render_score, score_estimate

    refuse_without_truth(files)
    result = score_estimate(files[0], estimated(files, object_file, exclude))
    if as_json:
        click.echo(json.dumps(result, allow_nan=False))
    else:
        render_score(result)


@click.command()
@files_argument
@with_estimate_options
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Where to write; default FILE with .html; needed for several files.")
@click.option("--compare", is_flag=True, help="Repeated sessions of one object side by side: how well they repeat, whether they agree.")
@click.option("--json", "as_json", is_flag=True, help="Print all that it shows as JSON; the page is written only where -o asks for it.")
@click.option("--csv", "csv_folder", metavar="FOLDER", type=click.Path(path_type=Path), help="Also write its tables as CSV files there.")
@one_line
def report(
    files: Sequence[Path],
    object_file: Path | None,
    exclude: tuple[str, ...],
    output: Path | None,
    compare: bool,
    as_json: bool,
    csv_folder: Path | None,
) -> None:
    """One HTML file with the answer, its reasons and its plots; of several recordings one answer, or with --compare one each."""
    from analyze.output_file import refuse_unwritable
    from analyze.reading.file_series import row_of
    from analyze.report.csv_table import make_folder, write_tables

    if compare and len(files) < 2:
        raise click.UsageError("--compare takes two recordings or more: name them all, as in --compare a.mcap b.mcap -o compared.html")
    if output is None and not as_json:
        if len(files) > 1:
            raise click.UsageError("several recordings make one report: say where with -o, as in -o joint.html")
        output = files[0].with_suffix(".html")
    if output is not None:
        refuse_unwritable(output, *(part for file in files for part in row_of(file).files))
    if csv_folder is not None:
        make_folder(csv_folder)
    page = _comparison(files, object_file, exclude) if compare else _answer(files, object_file, exclude)
    if output is not None:
        page.write(output)
        click.echo(f"report: {output}", err=as_json)
    if csv_folder is not None:
        tables = page.tables()
        write_tables(tables, csv_folder)
        click.echo(f"tables: {csv_folder}: {', '.join(table.name for table in tables)}", err=as_json)
    if as_json:
        click.echo(page.json())


@dataclass(frozen=True)
class _Page:
    """What a report can be written as."""

    write: Callable[[Path], None]
    tables: Callable[[], list[CsvTable]]
    json: Callable[[], str]


def _answer(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...]) -> _Page:
    from analyze.pipeline.score import score_if_virtual
    from analyze.report.report import verdict_in_words, write_report
    from analyze.report.report_document import report_json
    from analyze.report.report_tables import report_tables

    answer = estimated(files, object_file, exclude)
    score = score_if_virtual(files, answer)
    return _Page(
        lambda output: write_report(answer, output, score),
        lambda: report_tables(answer),
        lambda: report_json(answer, verdict_in_words(answer), score),
    )


def _comparison(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...]) -> _Page:
    from analyze.report.comparison_page import comparison_json, comparison_tables, write_comparison

    found = compared(files, object_file, exclude)
    return _Page(lambda output: write_comparison(found, output), lambda: comparison_tables(found), lambda: comparison_json(found))
