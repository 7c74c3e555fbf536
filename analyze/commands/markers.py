"""`analyze register`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click

from analyze.commands.options import files_argument, one_line, with_estimate_options


@click.command()
@files_argument
@with_estimate_options
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Write the object file with the places found (TOML).")
@click.option("--table", "find_table", is_flag=True, help="Find the table's tilt and height too: no board was seen on it.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def register(
    files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], output: Path | None, find_table: bool, as_json: bool
) -> None:
    """Where the markers are glued, found from recorded strikes: how the object rested, and over which edges it tipped."""
    from analyze.file_row import row_of
    from analyze.output_file import refuse_unwritable
    from analyze.progress import StrikeProgress
    from analyze.register import RegisterOptions, refuse_undetermined, register_recordings, write_object
    from analyze.register_table import registration_json, render_registration

    if output is not None:
        refuse_unwritable(output, *(part for file in files for part in row_of(file).files))
    with StrikeProgress() as progress:
        answer = register_recordings(files, RegisterOptions(object_file, frozenset(exclude), find_table), progress)
    if as_json:
        click.echo(json.dumps(registration_json(answer), allow_nan=False))
    refuse_undetermined(answer)
    if not as_json:
        render_registration(answer)
    if output is not None:
        written = write_object(answer, output)
        named = ", ".join(map(str, written))
        click.echo(f"object: {output}: places of markers {named}; estimate and report with --object {output}", err=as_json)
