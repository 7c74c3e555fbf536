"""`analyze archive object`: one object over all its sessions."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from analyze.verbs.options import one_line, path_option, results_folder_option
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo


@click.command("object")
@click.argument("name", metavar="NAME")
@results_folder_option
@path_option("--save", help="The file to write the answer to (.html, .json or .csv).")
@one_line
def object_(name: str, output: Path, save: Path | None) -> None:
    """Estimate one object over all its sessions: mean, sd between sessions, and what a new one would report.

    NAME is the object's name, or the first letters of its hash. Sessions with another object file are those
    of another object.
    """
    from analyze.batch.object_output import render_object, save_object
    from analyze.batch.object_sessions import object_over_sessions
    from analyze.batch.query import read_recording_rows, read_result_texts
    from analyze.batch.result_rows import BULKY_COLUMNS

    refuse_outputs([save])
    rows = read_recording_rows(output, BULKY_COLUMNS)
    found = object_over_sessions(rows, name, partial(read_result_texts, output))
    if save is None:
        render_object(found)
        return
    for path in save_object(found, save):
        echo(f"object: {path}")
