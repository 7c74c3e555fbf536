"""`analyze archive index`: bring the catalogue up to date."""

from __future__ import annotations

from pathlib import Path

import click

from analyze.verbs.options import one_line, results_folder_option
from schemas.plain_text import echo
from schemas.wording import counted


@click.command()
@click.argument("places", metavar="PATH...", nargs=-1, required=True)
@results_folder_option
@click.option(
    "--exclude", multiple=True, metavar="GLOB", help="Leave out matching recordings; may be repeated."
)
@click.option("--jobs", "-j", type=click.IntRange(1), help="Processes; default: one per core.")
@click.option(
    "--forget-missing",
    is_flag=True,
    help="Remove the rows of recordings gone from PATHs that still hold others.",
)
@one_line
def index(
    places: tuple[str, ...], output: Path, exclude: tuple[str, ...], jobs: int | None, forget_missing: bool
) -> None:
    """Read the heads of new and changed recordings in folders, globs and buckets into the catalogue."""
    from analyze.batch.archive import find_sources
    from analyze.catalogue.index import update_index
    from analyze.catalogue.table import CATALOGUE, open_catalogue
    from analyze.progress import ProgressBar

    sources = find_sources(places, exclude)
    with open_catalogue(output, create=True) as catalogue, ProgressBar() as progress:
        report = update_index(catalogue, sources, places, jobs, progress, forget=forget_missing)
        many = len(catalogue.rows)
    echo(
        f"{output / CATALOGUE}: {counted(many, 'recording')}: {report.new} new, {report.changed} changed, "
        f"{report.unchanged} unchanged, {len(report.moved)} moved, {len(report.missing)} missing"
    )
    for before, now in report.moved:
        echo(f"moved: {before} -> {now}")
    for url in report.missing:
        echo(f"missing{' (forgotten)' if url in report.forgotten else ''}: {url}", err=True)
    if report.unreadable:
        echo(f"{counted(report.unreadable, 'recording')} cannot be read: `analyze archive list` shows why")
