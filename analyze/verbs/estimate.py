"""`analyze estimate`: the estimate of one object, printed as tables or JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from analyze.verbs.estimate_files import estimate_files
from analyze.verbs.options import files_argument, one_line, path_option, with_estimate_options
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo, json_line
from schemas.wording import counted


@click.command()
@files_argument
@with_estimate_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@path_option("--voxels", help="Also write the most uniform mass distribution that fits, cell by cell (CSV).")
@one_line
def estimate(
    files: Sequence[Path],
    object_file: Path | None,
    exclude: tuple[str, ...],
    no_cache: bool,
    as_json: bool,
    voxels: Path | None,
) -> None:
    """Estimate centre of mass, moments of inertia and region masses from recordings of one object."""
    refuse_outputs([voxels], files)
    answer = estimate_files(files, object_file, exclude, no_cache)
    if voxels is not None:
        # Loads the library of plots.
        from analyze.report.voxel_map import write_voxels

        write_voxels(answer.estimate.voxels, voxels)
        cells, directions = len(answer.estimate.voxels.points), answer.estimate.voxels.directions
        echo(
            f"voxels: {voxels}: {counted(cells, 'cell')}; the strikes determine "
            f"{counted(directions, 'number')} of them",
            err=True,
        )
    if as_json:
        echo(json_line(answer.json()))
    else:
        from analyze.report.summary import render_summary

        render_summary(answer)
