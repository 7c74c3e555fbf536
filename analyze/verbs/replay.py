"""`analyze replay`."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack, suppress
from pathlib import Path

import click

from analyze.verbs.options import one_line, with_estimate_options
from schemas.command_line import PROBLEM


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@with_estimate_options
@click.option("--save", type=click.Path(path_type=Path), help="Write a .rrd instead of opening the viewer.")
@click.option("--screenshot", type=click.Path(path_type=Path), help="Write a PNG of the front page; needs no screen.")
@click.option("--web", is_flag=True, help="Show it in the browser, served on this computer only, until Ctrl-C.")
@click.option("--no-browser", is_flag=True, help="With --web: print the address, open nothing.")
@click.option("--page", metavar="PAGE", help="What stands in front: answer, session, or a strike's id.")
@click.option("--every-frame", is_flag=True, help="Show every image of a strike; else 60 a second.")
@click.option("--lossless", is_flag=True, help="Keep every pixel (PNG); else JPEG.")
@click.option("--headless-port", type=int, hidden=True, help="The viewer without a screen, on this port: for measurements.")
@one_line
def replay(
    file: Path,
    object_file: Path | None,
    exclude: tuple[str, ...],
    save: Path | None,
    screenshot: Path | None,
    web: bool,
    no_browser: bool,
    page: str | None,
    every_frame: bool,
    lossless: bool,
    headless_port: int | None,
) -> None:
    """See what happened, in rerun; follows a session that still runs."""
    from analyze.progress import StrikeProgress
    from analyze.replay.place import find
    from analyze.replay.target import ToFile, ToViewer, ViewerClosed, to_browser, to_file, to_window

    if web and (save is not None or screenshot is not None):
        raise click.UsageError("--web shows, --save and --screenshot write: choose one")
    if no_browser and not web:
        raise click.UsageError("--no-browser goes with --web")
    place = find(file)
    if save is not None or screenshot is not None:
        _refuse_unwritable(place.path, save, screenshot)
    with ExitStack() as stack:
        size = place.path.stat().st_size
        target: ToFile | ToViewer
        if save is not None or screenshot is not None:
            target = stack.enter_context(to_file(save))
        elif web:
            target = stack.enter_context(to_browser(size, lambda address: click.echo(f"replay: {address}"), open_browser=not no_browser))
        else:
            # The window opens while the rest is loaded.
            target = stack.enter_context(to_window(size, headless_port))
        # What goes wrong is told by us, in one line.
        os.environ.setdefault("RUST_LOG", "off")
        from analyze.replay.pictures import ImageChoice
        from analyze.replay.run import replay_recording
        from analyze.replay.sender import ReplayOptions

        options = ReplayOptions(object_file, frozenset(exclude), ImageChoice(every_frame, lossless), page)
        try:
            with StrikeProgress() as progress:
                replayed = replay_recording(place, target, options, progress)
        except ViewerClosed:
            return
        for problem in replayed.problems:
            click.echo(f"analyze: {problem}", err=True)
        if isinstance(target, ToFile) and screenshot is not None:
            from analyze.replay.layout import timeline_of
            from analyze.replay.picture import screenshot as take_picture

            take_picture(target.output, screenshot, replayed.moment_s, timeline_of(page))
        if isinstance(target, ToViewer):
            with suppress(KeyboardInterrupt):  # all is shown: that is how it ends
                target.wait()
    for path in (save, screenshot):
        if path is not None:
            click.echo(f"replay: {path}")
    if replayed.problems:
        sys.exit(PROBLEM)


def _refuse_unwritable(recording: Path, *outputs: Path | None) -> None:
    from analyze.output_file import refuse_unwritable
    from analyze.reading.file_series import row_of

    for output in outputs:
        if output is not None:
            refuse_unwritable(output, *row_of(recording).files)
