"""The command `analyze register`: poses of an object's markers from its recorded strikes."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import click

from analyze.verbs.options import (
    files_argument,
    force_option,
    one_line,
    pass_options,
    path_option,
    with_strike_options,
)
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo


@dataclass(frozen=True)
class _RegisterArguments:
    """Values of the arguments and options of `analyze register`."""

    files: tuple[Path, ...]
    """recordings of the object"""
    object_file: Path | None
    """object file to use instead of the recordings'; None for the recordings' own"""
    exclude: tuple[str, ...]
    """ids of strikes to leave out"""
    output: Path | None
    """object file to write (TOML); None to write none"""
    force: bool
    """True to replace the object file if it exists"""
    find_table: bool
    """True to estimate the table's tilt and height too"""
    rig: Path | None
    """rig file to write the table's pose into; None if there is none"""
    write: bool
    """True to write the table's pose into the rig file"""
    as_json: bool
    """True to print JSON"""


@click.command()
@files_argument
@with_strike_options
@path_option("-o", "--output", help="The object file to write, with the estimated marker poses (TOML).")
@force_option
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
@pass_options(_RegisterArguments)
def register(arguments: _RegisterArguments) -> None:
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

    output, rig = arguments.output, arguments.rig
    if arguments.write != (rig is not None) or (arguments.write and not arguments.find_table):
        raise click.UsageError(
            "--table, --rig RIG.toml and --write must be given together, to write the table's pose into the "
            "rig file"
        )
    refuse_outputs([output], arguments.files, [rig], force=arguments.force)
    options = RegisterOptions(arguments.object_file, frozenset(arguments.exclude), arguments.find_table, rig)
    with ProgressBar() as progress:
        answer = register_recordings(arguments.files, options, progress)
    if arguments.as_json:
        echo(json.dumps(registration_json(answer), allow_nan=False))
    refuse_undetermined(answer)
    if not arguments.as_json:
        render_registration(answer)
    if output is not None:
        written = write_object(answer, output)
        named = ", ".join(map(str, written))
        echo(
            f"object: {output}: poses of markers {named}; use it with estimate and report: --object {output}",
            err=arguments.as_json,
        )
    if rig is not None:
        write_table(answer, rig)
        echo(f"written to {rig}: restart the daemon, and plan anew{level_note(rig)}", err=True)
