"""The command `analyze inspect`: contents and health of a recording or any MCAP file."""

from __future__ import annotations

import json
from pathlib import Path

import click

from analyze.verbs.options import one_line
from schemas.plain_text import echo


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def inspect(file: Path, as_json: bool) -> None:
    """Show the contents of a recording or any MCAP file: topics, rates, gaps, clocks, health, session."""
    from analyze.progress import ProgressBar
    from analyze.verbs.inspect.recording import inspect_recording
    from analyze.verbs.inspect.table import render_inspection

    with ProgressBar() as progress:
        inspection = inspect_recording(file, progress)
    if as_json:
        echo(json.dumps(inspection, allow_nan=False))
    else:
        render_inspection(inspection)
