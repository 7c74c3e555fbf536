"""The command `analyze register`: poses of an object's markers from its recorded strikes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click

from analyze.verbs.options import files_argument, one_line, path_option, with_estimate_options
from analyze.verbs.outputs import refuse_outputs


@click.command()
@files_argument
@with_estimate_options
@path_option("-o", "--output", help="The object file to write, with the estimated marker poses (TOML).")
@click.option(
    "--table",
    "find_table",
    is_flag=True,
    help="Estimate the table's tilt and height too, if no board was measured on it.",
)
@path_option("--rig", help="With --table and --write: the recording's rig file.")
@click.option(
    "--write", is_flag=True, help="With --table: write the estimated T_world_camera into the rig file."
)
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
    """Estimate where the markers are glued, from recorded strikes.

    The object's resting pose and the edges that it tipped over determine the markers' poses.
    """
    from analyze.progress import ProgressBar
    from analyze.verbs.register.marker_poses import (
        RegisterOptions,
        level_note,
        refuse_undetermined,
        register_recordings,
        write_object,
        write_table,
    )
    from analyze.verbs.register.table import registration_json, render_registration

    if write != (rig is not None) or (write and not find_table):
        raise click.UsageError(
            "--table, --rig RIG.toml and --write must be given together, to write the table's pose into the "
            "rig file"
        )
    refuse_outputs([output], files, [rig])
    with ProgressBar() as progress:
        answer = register_recordings(
            files, RegisterOptions(object_file, frozenset(exclude), find_table, rig), progress
        )
    if as_json:
        click.echo(json.dumps(registration_json(answer), allow_nan=False))
    refuse_undetermined(answer)
    if not as_json:
        render_registration(answer)
    if output is not None:
        written = write_object(answer, output)
        named = ", ".join(map(str, written))
        click.echo(
            f"object: {output}: poses of markers {named}; use it with estimate and report: --object {output}",
            err=as_json,
        )
    if rig is not None:
        write_table(answer, rig)
        click.echo(f"written to {rig}: restart the daemon, and plan anew{level_note(rig)}", err=True)
