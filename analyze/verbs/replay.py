"""`analyze replay`: a recording or a running session, shown in the viewer rerun or written to a file."""

from __future__ import annotations

import os
import sys
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.verbs.options import chosen_cache, one_line, pass_options, path_option, with_estimate_options
from analyze.verbs.outputs import refuse_outputs
from schemas.command_line import PROBLEM
from schemas.plain_text import echo

if TYPE_CHECKING:
    from analyze.reading.recording_file import RecordingFile
    from analyze.replay.run import ReplayResult
    from analyze.replay.target import ToFile, ToViewer


@dataclass(frozen=True)
class _ReplayArguments:
    """Values of the arguments and options of `analyze replay`."""

    file: Path
    """recording, or the file of a session that still runs"""
    object_file: Path | None
    """object file to use instead of the recording's; None for the recording's"""
    exclude: tuple[str, ...]
    """ids of strikes to leave out of the estimate"""
    no_cache: bool
    """True to use and keep no results of earlier commands"""
    save: Path | None
    """file for rerun to write (.rrd); None to write none"""
    screenshot: Path | None
    """picture of the page to write (PNG); None to write none"""
    animation: Path | None
    """animation of one strike to write (WebP, GIF or MP4); None to write none"""
    web: bool
    """True to show the recording in the browser"""
    no_browser: bool
    """True to serve the page without opening a browser"""
    page: str | None
    """page to show first: answer, session or a strike's id; None for the default"""
    every_frame: bool
    """True to show every image, False for 60 a second"""
    lossless: bool
    """True to keep every pixel (PNG), False for JPEG"""
    headless_port: int | None
    """port on which to run the viewer without a screen; None for a window"""

    @property
    def outputs(self) -> tuple[Path, ...]:
        """Files to write instead of showing the recording; empty if none are named."""
        named = (self.save, self.screenshot, self.animation)
        return tuple(path for path in named if path is not None)


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@with_estimate_options
@path_option("--save", help="Write a .rrd file instead of opening the viewer.")
@path_option("--screenshot", help="Write a picture of the front page (PNG); needs no screen.")
@path_option(
    "--animation",
    help="Write a moving picture of one strike (.webp, .gif or .mp4): the tip and its fitted curve, in slow "
    "motion, for pages and talks. --page chooses the strike.",
)
@click.option(
    "--web", is_flag=True, help="Show it in the browser, served on this computer only, until Ctrl-C."
)
@click.option("--no-browser", is_flag=True, help="With --web: print the address without opening a browser.")
@click.option("--page", metavar="PAGE", help="Page to show first: answer, session, or a strike's id.")
@click.option("--every-frame", is_flag=True, help="Show every image of a strike; default: 60 a second.")
@click.option("--lossless", is_flag=True, help="Keep every pixel (PNG); default: JPEG.")
@click.option("--headless-port", type=int, hidden=True, help="Run the viewer without a screen on this port.")
@one_line
@pass_options(_ReplayArguments)
def replay(arguments: _ReplayArguments) -> None:
    """Show a recording in rerun; follows a session that still runs."""
    from analyze.reading.recording_file import find_recording

    if arguments.web and arguments.outputs:
        raise click.UsageError(
            "--web shows the recording; --save, --screenshot and --animation write files: choose one"
        )
    if arguments.no_browser and not arguments.web:
        raise click.UsageError("--no-browser needs --web: add it")
    recording = find_recording(arguments.file)
    refuse_outputs(arguments.outputs, [recording.path])
    if arguments.animation is not None:
        _animate(recording, arguments.animation, arguments)
    if arguments.animation is None or len(arguments.outputs) > 1:
        _replay_in_rerun(recording, arguments)


def _replay_in_rerun(recording: RecordingFile, arguments: _ReplayArguments) -> None:
    """Show the recording in rerun's viewer, or write its replay and its picture; exit if it has problems."""
    from analyze.replay.target import ToFile, ToViewer, ViewerClosed

    with ExitStack() as stack:
        # A window opens while the rest is loaded.
        target = _open_target(stack, recording, arguments)
        try:
            replayed = _replay(recording, target, arguments)
        except ViewerClosed:
            return
        for problem in replayed.problems:
            echo(f"analyze: {problem}", err=True)
        if isinstance(target, ToFile) and arguments.screenshot is not None:
            from analyze.replay.picture import screenshot as take_picture

            take_picture(target.output, arguments.screenshot, replayed.moment_s, replayed.timeline)
        if isinstance(target, ToViewer):
            with suppress(KeyboardInterrupt):  # everything is shown: Ctrl-C is the way to end
                target.wait()
    for path in (arguments.save, arguments.screenshot):
        if path is not None:
            echo(f"replay: {path}")
    if replayed.problems:
        sys.exit(PROBLEM)


def _animate(recording: RecordingFile, output: Path, arguments: _ReplayArguments) -> None:
    """Write the animation of one strike, with a progress bar, and print what it shows.

    Raises:
        ReplayError: the recording is still being written, has no such strike, or the strike no fitted motion;
            or the suffix of `output` names no format of animations.
        RecordingError, ShapeError, PlanError, OutputError: a file cannot be read, used or written.
    """
    from analyze.progress import ProgressBar
    from analyze.replay.animation import animate_strike

    with ProgressBar() as progress:
        shown = animate_strike(recording, output, arguments.page, arguments.object_file, progress)
    echo(f"animation: {output}: {shown}")


def _open_target(
    stack: ExitStack, recording: RecordingFile, arguments: _ReplayArguments
) -> ToFile | ToViewer:
    """Open the destination of the replay that the options choose, and return it.

    It is a file with --save or --screenshot (a temporary file with --screenshot alone), else rerun's viewer
    in the browser with --web, else in a window. It stays open until `stack` is closed.
    """
    from analyze.replay.target import to_browser, to_file, to_window

    if arguments.outputs:
        return stack.enter_context(to_file(arguments.save))
    size = recording.path.stat().st_size
    if not arguments.web:
        return stack.enter_context(to_window(size, arguments.headless_port))
    browser = to_browser(
        size, lambda address: echo(f"replay: {address}"), open_browser=not arguments.no_browser
    )
    return stack.enter_context(browser)


def _replay(recording: RecordingFile, target: ToFile | ToViewer, arguments: _ReplayArguments) -> ReplayResult:
    """Send the recording to `target`, the file or viewer that receives the replay, with a progress bar.

    Returns:
        Problems of the recording or its estimate, one line of text each; and the time to show first [s on the
        page's timeline].

    Raises:
        RecordingError: nothing of the recording can be read.
        ReplayError: the target does not accept data, or the options name a strike or page (such as "answer")
            that a complete recording does not have.
        ViewerClosed: the user closed the viewer before everything was sent.
    """
    # rerun's own log would add lines to the one that names a problem.
    os.environ.setdefault("RUST_LOG", "off")
    from analyze.progress import ProgressBar
    from analyze.replay.pictures import ImageChoice
    from analyze.replay.run import replay_recording
    from analyze.replay.sender import ReplayOptions

    choice = ImageChoice(arguments.every_frame, arguments.lossless)
    options = ReplayOptions(
        arguments.object_file,
        frozenset(arguments.exclude),
        choice,
        arguments.page,
        chosen_cache(arguments.no_cache),
    )
    with ProgressBar() as progress:
        return replay_recording(recording, target, options, progress)
