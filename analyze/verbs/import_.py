"""`analyze import`: a recording made from videos, image folders, MCAP files or ROS 2 bags."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.verbs.options import force_option, one_line, pass_options, path_option
from analyze.verbs.outputs import refuse_outputs
from schemas.command_line import NumberRange

if TYPE_CHECKING:
    from analyze.importing.options import ImportOptions


@dataclass(frozen=True)
class _ImportArguments:
    """Values of the arguments and options of `analyze import`."""

    sources: tuple[Path, ...]
    """videos, folders of images, MCAP files or ROS 2 bags"""
    object_path: Path
    """object file (TOML)"""
    plan_path: Path | None
    """strike plan that was carried out (JSON); None for strikes that nobody planned"""
    camera_path: Path | None
    """file with the lens; None for the calibration in the source"""
    output: Path | None
    """recording to write (.mcap); None only with `dry_run`"""
    strikes: tuple[str, ...]
    """ids of the planned strikes that the sources show; empty for files' names and images"""
    edges: tuple[str, ...]
    """edges that the user states for strikes without a plan"""
    capture_fps: float | None
    """frame rate of the capture [Hz]; None for the rate that the file states"""
    capture_fps_sd: float | None
    """standard deviation of the frame rate [Hz]; None for the default"""
    times: tuple[Path, ...]
    """CSV files with the times of a folder's images or a video's frames, one per source; empty to look for
    them"""
    topic: str | None
    """topic of the images in an MCAP file or bag; None for the only one"""
    tosses: tuple[Path, ...]
    """videos or folders of images that show a toss each"""
    mat_ruler_mm: float | None
    """length of the mat's ruler as measured on the print [mm]; None for the nominal one"""
    whole: bool
    """True to take each source as one strike"""
    yes: bool
    """True to write without confirmation where a source was split into strikes, or nobody planned them"""
    force: bool
    """True to replace the recording if it exists"""
    dry_run: bool
    """True to show the strikes and write nothing"""


@click.command("import")
@click.argument("sources", metavar="[SOURCE...]", nargs=-1, type=click.Path(path_type=Path))
@path_option("--object", "object_path", required=True, help="The object file (TOML).")
@path_option(
    "--plan",
    "plan_path",
    help="The plan that was struck, made by `analyze plan`.  [default: nobody planned the strikes; their "
    "faces and edges are found in the images, and you are asked whether they are right]",
)
@path_option(
    "--camera",
    "camera_path",
    help="The lens: a file of `analyze calibrate -o`, a rig file, or a calibration of OpenCV, Kalibr or ROS "
    "(YAML, JSON).  [default: the calibration in the MCAP file or bag]",
)
@path_option("-o", "--output", help="The recording to write (.mcap).")
@force_option
@click.option(
    "--strike",
    "strikes",
    multiple=True,
    metavar="ID",
    help="Planned strike that a source shows, once per source; with a single source, once per strike in it; "
    "- leaves one out, auto lets the images show it.  [default: as the files are named, else auto]",
)
@click.option(
    "--edge",
    "edges",
    multiple=True,
    metavar="ID=EDGE",
    help="Without a plan: edge over which the object tips in a strike, by the sides that meet in it "
    "(s1=+x,bottom) or by its id (s1=p0e1).  [default: as the images show it]",
)
@click.option(
    "--capture-fps",
    type=NumberRange(1, 1_000_000),
    help="For slow motion: frames per second at which it was captured.  "
    "[default: the rate that the file states, else the rate at which it plays]",
)
@click.option(
    "--capture-fps-sd",
    type=NumberRange(0, 100_000, min_open=True),
    metavar="HZ",
    help="Standard deviation of the frame rate, as `analyze frame-rate` measures it.  [default: 0.2 % of it]",
)
@path_option(
    "--times",
    multiple=True,
    metavar="CSV",
    help="Times of the images of a folder (columns name,time_s) or of a video's frames (time_s, time_ms, "
    "timestamp_ns, a row per frame), once per source; - for the video's own.  [default: the CSV in the "
    "folder; the one beside the video with its name]",
)
@click.option(
    "--topic",
    metavar="NAME",
    help="For an MCAP file or ROS 2 bag: topic of the images.  [default: the only one]",
)
@path_option(
    "--toss",
    "tosses",
    multiple=True,
    help="A video or folder of images of a toss, with the camera where it stands for the strikes; once per"
    " toss.",
)
@click.option(
    "--mat-ruler-mm",
    type=NumberRange(10, 2000),
    metavar="MM",
    help="Length of the ruler on the mat's pivot line, as measured on the print.  [default: as it should be]",
)
@click.option(
    "--whole", is_flag=True, help="Take each source as one strike, from its first to its last image."
)
@click.option(
    "--yes",
    is_flag=True,
    help="Write without confirmation where one source was split into strikes, or nobody planned them.",
)
@click.option("--dry-run", is_flag=True, help="Show which part would become which strike, and write nothing.")
@one_line
@pass_options(_ImportArguments)
def import_(arguments: _ImportArguments) -> None:
    """Make a recording from another camera's images.

    SOURCE: videos, folders of images with a CSV of their times, MCAP files or ROS 2 bags; one for each
    strike, or one for the whole session, which is split where a tag at rest begins to tip.
    """
    from analyze.importing.prepare import prepare
    from analyze.importing.table import render_import, render_written
    from analyze.importing.write_recording import write_recording
    from analyze.progress import ProgressBar

    options = _import_options(arguments)
    with ProgressBar() as progress:
        prepared = prepare(options, progress)
    with prepared:
        shown = render_import(prepared)
        if arguments.dry_run or arguments.output is None:
            return
        if (prepared.was_split or prepared.found is not None) and not arguments.yes:
            _confirm_strikes()
        with ProgressBar() as progress:
            written = write_recording(prepared, arguments.output, progress, replace=arguments.force)
        render_written(written, shown)


def _import_options(arguments: _ImportArguments) -> ImportOptions:
    """Options of the import, after a check of the output.

    Raises:
        click.UsageError: neither an output nor --dry-run is given.
        OutputError: the output cannot be written, exists already, or would replace an input.
    """
    from analyze.importing.options import ImportOptions
    from analyze.importing.writer import refuse_taken
    from analyze.sources.open_source import SourceOptions

    output, camera = arguments.output, arguments.camera_path
    if output is None and not arguments.dry_run:
        raise click.UsageError(
            "no output is named: give the recording to write with -o FILE.mcap, or --dry-run"
        )
    if arguments.edges and arguments.plan_path is not None:
        raise click.UsageError("--edge states edges of strikes without a plan: leave out --edge, or --plan")
    if not arguments.sources and not arguments.tosses:
        raise click.UsageError("no video is named: give those of strikes as arguments, of tosses with --toss")
    films = [*arguments.sources, *arguments.tosses, *arguments.times]
    inputs = [*films, arguments.object_path, arguments.plan_path, camera]
    refuse_outputs([output], inputs=inputs, force=arguments.force)
    if output is not None:
        refuse_taken(output, replace=arguments.force)
    return ImportOptions(
        arguments.sources,
        arguments.object_path,
        arguments.plan_path,
        camera,
        arguments.strikes,
        arguments.whole,
        SourceOptions(arguments.capture_fps, topic=arguments.topic),
        arguments.capture_fps_sd,
        None if output is None or arguments.dry_run else output.parent,
        arguments.times,
        arguments.tosses,
        arguments.edges,
        arguments.mat_ruler_mm,
    )


def _confirm_strikes() -> None:
    """Ask on the terminal whether the strikes printed before are right; the answer "no" ends the program.

    Raises:
        click.UsageError: standard input is no terminal.
    """
    if not sys.stdin.isatty():
        raise click.UsageError(
            "the strikes found cannot be confirmed without a terminal: look at them with --dry-run, then add "
            "--yes"
        )
    click.confirm("Are these the strikes?", abort=True, err=True)
