"""The command `analyze advise`: answer so far and next strike of a recording that is being written."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from analyze.verbs.options import one_line


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@one_line
def advise(file: Path) -> None:
    """State the answer so far of a growing recording, and the next strike (started by `acquire`).

    JSON lines on standard input and output.
    """
    from analyze.verbs.advise.serve import advise_session

    advise_session(file, sys.stdin, sys.stdout)
