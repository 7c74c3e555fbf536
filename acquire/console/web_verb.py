"""The verb `acquire console`: its options; the web server itself is loaded when it is called."""

from __future__ import annotations

from pathlib import Path

import click

from acquire.errors import AcquireError
from schemas.command_line import one_line_errors


@click.command()
@click.argument("rig", type=click.Path(path_type=Path))
@click.option(
    "--recordings",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the recordings.  [default: that of the rig file]",
)
@click.option(
    "--objects",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    default=Path(),
    help="Folder of object files and their plans.  [default: this folder]",
)
@click.option(
    "--port",
    default=8765,
    show_default=True,
    type=click.IntRange(0, 65535),
    help="Port on this computer; 0: any that is free.",
)
@click.option("--no-browser", is_flag=True, help="Do not open the page in a browser.")
@one_line_errors("acquire", AcquireError)
def console(rig: Path, recordings: Path | None, objects: Path, port: int, no_browser: bool) -> None:
    """Serve the operator's page for RIG on this computer, until Ctrl-C. Prints its address."""
    from acquire.console.web.command import ConsoleOptions, run_console

    run_console(ConsoleOptions(rig, recordings, objects, port, browser=not no_browser))
