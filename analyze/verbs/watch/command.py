"""The command `analyze watch`: follow a recording while it grows."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from analyze.verbs.options import one_line


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@one_line
def watch(file: Path) -> None:
    """Follow a recording while it grows; JSON lines on standard input and output (started by `acquire`)."""
    from analyze.verbs.watch.follow import watch_recording

    watch_recording(file, sys.stdin, sys.stdout)
