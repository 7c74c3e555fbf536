"""`analyze register`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click

from analyze.verbs.options import files_argument, one_line, with_estimate_options


@click.command()
@files_argument
@with_estimate_options
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Write the object file with the places found (TOML).")
@click.option("--table", "find_table", is_flag=True, help="Find the table's tilt and height too: no board was seen on it.")
@click.option("--rig", type=click.Path(path_type=Path), help="With --table and --write: the rig file of the recording.")
@click.option("--write", is_flag=True, help="With --table: put the T_world_camera found into the rig file.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def register(
    files: Sequence[Path],
    object_file: Path | None,
    exclude: tuple[str, ...],
    output: Path | None,
    find_table: bool,
    rig: Path | None,
    write: bool,
    as_json: bool,
) -> None:
    """Where the markers are glued, found from recorded strikes: how the object rested, and over which edges it tipped."""
    from analyze.output_file import refuse_unwritable
    from analyze.progress import StrikeProgress
    from analyze.reading.file_series import row_of
    from analyze.verbs.register.recordings import (
        RegisterOptions,
        level_note,
        refuse_undetermined,
        register_recordings,
        write_object,
        write_table,
    )
    from analyze.verbs.register.table import registration_json, render_registration

    if write != (rig is not None) or (write and not find_table):
        raise click.UsageError("--table --rig RIG.toml --write belong together: the table found, and the rig file to write it into")
    if output is not None:
        refuse_unwritable(output, *(part for file in files for part in row_of(file).files), *([] if rig is None else [rig]))
    with StrikeProgress() as progress:
        answer = register_recordings(files, RegisterOptions(object_file, frozenset(exclude), find_table, rig), progress)
    if as_json:
        click.echo(json.dumps(registration_json(answer), allow_nan=False))
    refuse_undetermined(answer)
    if not as_json:
        render_registration(answer)
    if output is not None:
        written = write_object(answer, output)
        named = ", ".join(map(str, written))
        click.echo(f"object: {output}: places of markers {named}; estimate and report with --object {output}", err=as_json)
    if rig is not None:
        write_table(answer, rig)
        click.echo(f"written to {rig}: start the daemon anew, and plan anew{level_note(rig)}", err=True)
