"""A recording itself: `analyze inspect` and `analyze watch`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from analyze.verbs.options import one_line


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def inspect(file: Path, as_json: bool) -> None:
    """What is in a recording, or in any MCAP file: topics, rates, gaps, clocks, health, session."""
    from analyze.progress import StrikeProgress
    from analyze.verbs.inspect.recording import inspect_recording
    from analyze.verbs.inspect.table import render_inspection

    with StrikeProgress() as progress:
        found = inspect_recording(file, lambda done, total: progress("reading", done, total))
    if as_json:
        click.echo(json.dumps(found, allow_nan=False))
    else:
        render_inspection(found)


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@one_line
def watch(file: Path) -> None:
    """Follow a recording while it grows; JSON lines on standard output (started by `acquire`)."""
    from analyze.verbs.watch import watch as watch_recording

    watch_recording(file, sys.stdin, sys.stdout)
