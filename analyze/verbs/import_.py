"""`analyze import`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from analyze.verbs.options import one_line
from schemas.command_line import NumberRange


@click.command("import")
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--object", "object_path", required=True, type=click.Path(path_type=Path), help="The object file (TOML).")
@click.option("--plan", "plan_path", required=True, type=click.Path(path_type=Path), help="What was struck: `analyze plan` makes it.")
@click.option(
    "--camera",
    "camera_path",
    type=click.Path(path_type=Path),
    help="The lens: what `analyze calibrate -o` wrote, a rig file, or a calibration of OpenCV, Kalibr or ROS (YAML, JSON).  "
    "[default: the calibration in the MCAP file or bag]",
)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="The recording to write (.mcap).")
@click.option(
    "--strike",
    "strikes",
    multiple=True,
    metavar="ID",
    help="Which planned strike a source is, or a tip in the only source; once for each, - leaves one out.  [default: the plan's order]",
)
@click.option(
    "--capture-fps",
    type=NumberRange(1, 1_000_000),
    help="Slow motion: frames per second at which it was captured.  [default: as the file says, else as it plays]",
)
@click.option(
    "--capture-fps-sd",
    type=NumberRange(0, 100_000, min_open=True),
    metavar="HZ",
    help="How well the frame rate is known, 1 sigma, as `analyze calibrate --drop` says.  [default: 0.2 % of it]",
)
@click.option(
    "--times", type=click.Path(path_type=Path), metavar="CSV", help="Of a folder of images: columns name,time_s.  [default: the one in it]"
)
@click.option("--topic", metavar="NAME", help="Of an MCAP file or ROS 2 bag: the topic of images.  [default: the only one]")
@click.option("--whole", is_flag=True, help="Each source is one strike from its first to its last image: look for nothing.")
@click.option("--yes", is_flag=True, help="Write without asking where one source was split into strikes.")
@click.option("--dry-run", is_flag=True, help="Show what would become which strike, and write nothing.")
@one_line
def import_(
    sources: tuple[Path, ...],
    object_path: Path,
    plan_path: Path,
    camera_path: Path | None,
    output: Path | None,
    strikes: tuple[str, ...],
    capture_fps: float | None,
    capture_fps_sd: float | None,
    times: Path | None,
    topic: str | None,
    whole: bool,
    yes: bool,
    dry_run: bool,
) -> None:
    """Make a recording of what another camera filmed: videos, folders of images with a CSV of their times, MCAP files and ROS 2 bags.

    One source for each strike, or one for the whole session: it is split where a tag that rested begins to tip.
    """
    from analyze.importing.run import ImportOptions, prepare
    from analyze.importing.table import render_import, render_written
    from analyze.importing.write_recording import write
    from analyze.importing.writer import refuse_taken
    from analyze.output_file import refuse_unwritable
    from analyze.progress import StrikeProgress
    from analyze.sources.open_source import SourceOptions

    if output is None and not dry_run:
        raise click.UsageError("-o FILE.mcap says where to write the recording (or --dry-run)")
    if output is not None:
        refuse_unwritable(output, *sources, object_path, plan_path, *([] if camera_path is None else [camera_path]))
        refuse_taken(output)
    how = SourceOptions(capture_fps, times, topic)
    aside = None if output is None or dry_run else output.parent
    options = ImportOptions(sources, object_path, plan_path, camera_path, strikes, whole, how, capture_fps_sd, aside)
    with StrikeProgress() as progress:
        prepared = prepare(options, progress)
    with prepared:
        said = render_import(prepared)
        if dry_run or output is None:
            return
        if prepared.was_split and not yes:
            if not sys.stdin.isatty():
                raise click.UsageError("nobody is there to say whether these are the strikes: look at them with --dry-run, then give --yes")
            click.confirm("Are these the strikes?", abort=True, err=True)
        with StrikeProgress() as progress:
            written = write(prepared, output, progress)
        render_written(written, said)
