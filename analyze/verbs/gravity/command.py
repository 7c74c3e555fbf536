"""The command `analyze gravity`: tilt of the table from images of a plumb line."""

from __future__ import annotations

import json
from pathlib import Path

import click

from analyze.verbs.options import one_line, path_option
from analyze.verbs.outputs import refuse_outputs
from schemas.command_line import NumberRange
from schemas.plain_text import echo


@click.command()
@click.argument("inputs", metavar="IMAGE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@path_option(
    "--rig", help="The rig file of the camera that took the images.  [default: the recording's camera]"
)
@click.option(
    "--camera-sd-deg",
    type=NumberRange(0, 10, min_open=True),
    default=0.1,
    show_default=True,
    help="Standard deviation of the camera's rotation against the table (T_world_camera), in degrees.",
)
@click.option("--write", is_flag=True, help="Write the reading into the rig file's [level].")
@path_option("--picture", help="Picture of the first image with the strings found, to write (PNG).")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def gravity(
    inputs: tuple[Path, ...],
    rig: Path | None,
    camera_sd_deg: float,
    write: bool,
    picture: Path | None,
    as_json: bool,
) -> None:
    """Measure the table's tilt from images or a recording of a plumb line.

    A plumb line is a string with a weight in the camera's view. One string determines the tilt to the left or
    right in the image, which affects tips; two or more, far apart in the image, also the tilt away from the
    camera.
    """
    from math import radians

    from analyze.progress import ProgressBar
    from analyze.verbs.gravity.level import GravityOptions, read_gravity, write_level
    from analyze.verbs.gravity.picture import write_plumb_picture
    from analyze.verbs.gravity.table import gravity_json, gravity_text

    if write and rig is None:
        raise click.UsageError("--write needs a rig file to write into: add --rig RIG.toml")
    refuse_outputs([picture], inputs=[*inputs, rig])
    with ProgressBar() as progress:
        answer = read_gravity(GravityOptions(inputs, rig, radians(camera_sd_deg)), progress)
    if picture is not None:
        write_plumb_picture(answer.first, answer.lines, answer.camera, picture)
        echo(f"picture: {picture}", err=True)
    if as_json:
        echo(json.dumps(gravity_json(answer), allow_nan=False))
    else:
        echo("\n".join(gravity_text(answer)))
    answer.refuse_undetermined()
    if write and rig is not None:
        write_level(answer, rig)
        echo(f"written to {rig}: restart the daemon", err=True)
