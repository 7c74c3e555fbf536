"""What is made of the strikes: `analyze estimate`, `score`, `report` and `replay`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click

from analyze.commands.options import estimated, files_argument, one_line, with_estimate_options


@click.command()
@files_argument
@with_estimate_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--voxels", type=click.Path(path_type=Path), help="Also write the evenest map of the mass, cell by cell (CSV).")
@one_line
def estimate(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], as_json: bool, voxels: Path | None) -> None:
    """Centre of mass, moments of inertia and region masses from a recording, or from several of one object."""
    from analyze.file_row import row_of
    from analyze.output_file import refuse_unwritable
    from analyze.results.summary import render_summary
    from analyze.results.voxels import write_voxels

    if voxels is not None:
        refuse_unwritable(voxels, *(part for file in files for part in row_of(file).files))
    answer = estimated(files, object_file, exclude)
    if voxels is not None:
        write_voxels(answer.voxels, voxels)
        click.echo(
            f"voxels: {voxels}: {len(answer.voxels.points)} cells, of which {answer.voxels.directions} numbers were measured", err=True
        )
    if as_json:
        click.echo(answer.json())
    else:
        render_summary(answer)


@click.command()
@files_argument
@with_estimate_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def score(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], as_json: bool) -> None:
    """Truth beside estimate, for virtual recordings."""
    from analyze.score import refuse_without_truth, render_score, score_estimate

    refuse_without_truth(files)
    result = score_estimate(files[0], estimated(files, object_file, exclude))
    if as_json:
        click.echo(json.dumps(result, allow_nan=False))
    else:
        render_score(result)


@click.command()
@files_argument
@with_estimate_options
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Where to write; default FILE with .html; needed for several files.")
@one_line
def report(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], output: Path | None) -> None:
    """One HTML file with the answer, its reasons and its plots."""
    from analyze.file_row import row_of
    from analyze.output_file import refuse_unwritable
    from analyze.results.report import write_report
    from analyze.score import score_if_virtual

    if output is None and len(files) > 1:
        raise click.UsageError("several recordings make one report: say where with -o, as in -o joint.html")
    output = output or files[0].with_suffix(".html")
    refuse_unwritable(output, *(part for file in files for part in row_of(file).files))
    answer = estimated(files, object_file, exclude)
    write_report(answer, output, score_if_virtual(files, answer))
    click.echo(f"report: {output}")


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@with_estimate_options
@click.option("--save", type=click.Path(path_type=Path), help="Write a .rrd instead of opening the viewer.")
@click.option("--screenshot", type=click.Path(path_type=Path), help="Write a PNG of the view; needs no screen.")
@one_line
def replay(file: Path, object_file: Path | None, exclude: tuple[str, ...], save: Path | None, screenshot: Path | None) -> None:
    """See what happened, in rerun."""
    from analyze.file_row import row_of
    from analyze.output_file import refuse_unwritable
    from analyze.replay import replay_recording

    for path in (save, screenshot):
        if path is not None:
            refuse_unwritable(path, *row_of(file).files)
    replay_recording(file, estimated((file,), object_file, exclude), save, screenshot)
    for path in (save, screenshot):
        if path is not None:
            click.echo(f"replay: {path}")
