"""`analyze query`: results of `analyze batch`, queried in SQL."""

from __future__ import annotations

from pathlib import Path

import click

from analyze.verbs.options import one_line, path_option, results_folder_option
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo


@click.command()
@click.argument("sql", metavar="SQL")
@results_folder_option
@click.option("--csv", "as_csv", is_flag=True, help="Print CSV.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, one line per row.")
@path_option("--save", help="The file to write the answer to (.parquet or .csv).")
@one_line
def query(sql: str, output: Path, as_csv: bool, as_json: bool, save: Path | None) -> None:
    """Query the results of `analyze batch` in SQL.

    Tables: recordings, strikes, moments, regions, warnings.
    """
    from analyze.batch.query import run_query
    from analyze.batch.query_output import print_answer, save_answer

    if as_csv and as_json:
        raise click.UsageError("--csv and --json exclude each other: choose one")
    refuse_outputs([save])
    answer = run_query(output, sql)
    if save is not None:
        save_answer(answer, save)
        echo(f"answer: {save}")
        return
    print_answer(answer, "csv" if as_csv else "json" if as_json else "table")
