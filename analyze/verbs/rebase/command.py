"""The command `analyze rebase`: a copy of a recording with an object file that was edited afterwards."""

from __future__ import annotations

import json
from pathlib import Path

import click

from analyze.verbs.options import force_option, one_line, path_option
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo


@click.command()
@click.argument("recording", metavar="RECORDING", type=click.Path(path_type=Path))
@path_option("--object", "object_path", required=True, help="The edited object file (TOML).")
@path_option("-o", "--output", help="The recording to write (.mcap).")
@force_option
@click.option("--dry-run", is_flag=True, help="Show what differs and whether the plan holds; write nothing.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def rebase(
    recording: Path, object_path: Path, output: Path | None, force: bool, dry_run: bool, as_json: bool
) -> None:
    """Copy a recording with an object file edited after the strikes.

    Images are copied unchanged; the plan's pivots follow the edited file; what is replaced stays attached.
    Refused if the edges that were struck are no edges of the edited shape, within its errors.
    """
    from analyze.progress import ProgressBar
    from analyze.reading.file_series import find_series_files
    from analyze.rebase.rebase import output_paths, prepare_rebase, write_rebase
    from analyze.verbs.rebase.table import rebase_json, render_rebase

    if output is None and not dry_run:
        raise click.UsageError(
            "no output is named: give the recording to write with -o FILE.mcap, or --dry-run"
        )
    if output is not None:
        outputs = output_paths(output, len(find_series_files(recording).files))
        refuse_outputs(outputs, [recording], [object_path], force=force)
    prepared = prepare_rebase(recording, object_path)
    if as_json:
        echo(json.dumps(rebase_json(prepared), allow_nan=False))
    else:
        render_rebase(prepared)
    prepared.refuse_moved_edges()
    if output is None or dry_run:
        return
    with ProgressBar() as progress:
        written = write_rebase(prepared, output, progress, replace=force)
    names = ", ".join(map(str, written))
    echo(f"written: {names}: images unchanged; next: `analyze estimate {output}`", err=as_json)
