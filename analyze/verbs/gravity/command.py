"""`analyze gravity`."""

from __future__ import annotations

import json
from pathlib import Path

import click

from analyze.verbs.options import one_line
from schemas.command_line import NumberRange


@click.command()
@click.argument("inputs", metavar="IMAGE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--rig", type=click.Path(path_type=Path), help="The rig file: its camera took the images.  [default: a recording's own]")
@click.option(
    "--camera-sd-deg",
    type=NumberRange(0, 10, min_open=True),
    default=0.1,
    show_default=True,
    help="How well the camera's turn against the table (T_world_camera) is known, 1 sigma.",
)
@click.option("--write", is_flag=True, help="Put the reading into the rig file's [level].")
@click.option("--picture", type=click.Path(path_type=Path), help="The first image with the strings that were found (PNG).")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def gravity(inputs: tuple[Path, ...], rig: Path | None, camera_sd_deg: float, write: bool, picture: Path | None, as_json: bool) -> None:
    """How the table slopes, from images or a recording of a plumb line: a string with a weight that hangs in the camera's view.

    One string tells the rise across the camera's view, which is what tips feel; two or more, far apart in the image, tell both rises.
    """
    from math import radians

    from analyze.output_file import refuse_unwritable
    from analyze.progress import StrikeProgress
    from analyze.report.plumb_picture import write_plumb_picture
    from analyze.verbs.gravity.images import GravityOptions, gravity_json, gravity_text, read_gravity, write_level

    if write and rig is None:
        raise click.UsageError("--write needs --rig RIG.toml: which file to write into")
    if picture is not None:
        refuse_unwritable(picture, *inputs, *([] if rig is None else [rig]))
    with StrikeProgress() as progress:
        answer = read_gravity(GravityOptions(inputs, rig, radians(camera_sd_deg)), progress)
    if picture is not None:
        write_plumb_picture(answer.first, answer.lines, answer.camera, picture)
        click.echo(f"picture: {picture}", err=True)
    if as_json:
        click.echo(json.dumps(gravity_json(answer), allow_nan=False))
    else:
        click.echo("\n".join(gravity_text(answer)))
    answer.refuse_undetermined()
    if write and rig is not None:
        write_level(answer, rig)
        click.echo(f"written to {rig}: start the daemon anew", err=True)
