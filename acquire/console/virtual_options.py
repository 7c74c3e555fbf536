"""Options of the commands that start a virtual rig: object, truth file, seed, camera, striker."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from schemas.camera_kind import CameraKindName
from schemas.command_line import NumberRange
from schemas.servo_models import DEFAULT_MODEL, MODEL_NAMES
from schemas.striker_kind import STRIKER_KINDS, KindName

CAMERA_MAKES = ("basler-ace", "mako", "alvium-g1", "blackfly-s", "hikrobot", "imaging-source")
"""makes that a virtual GigE camera can take on, listed without loading the virtual rig"""
_OBJECTS = ("carton", "spray", "juice", "salt", "parcel")
"""objects that come with the program"""


class _ObjectName(click.ParamType):
    """Name of an object that comes with the program, or path of an object file (.toml)."""

    name = "NAME|FILE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the value if it is the name of an object that comes with the program, or an object file.

        An object file is a path that ends in .toml or exists.

        Raises:
            click.BadParameter: it is neither.
        """
        if value not in _OBJECTS and not str(value).endswith(".toml") and not Path(value).is_file():
            self.fail(
                f"{value!r} is not one of {', '.join(_OBJECTS)}, nor an object file (.toml)", param, ctx
            )
        return str(value)


def virtual_options(command: Any) -> Any:
    """Decorator that adds the options of a virtual rig: object, print, truth file, seed, camera, striker."""
    for option in (
        click.option("--tags/--no-tags", default=True, help="With tags on the object, or without."),
        click.option("--gloss", is_flag=True, help="A highlight on the faces, which stays with the light."),
        click.option(
            "--print",
            "print_kind",
            default="blank",
            show_default=True,
            type=click.Choice(["blank", "light", "print"]),
            help="Print on the faces, as on a package: none, pale or strong.",
        ),
        click.option(
            "--striker",
            default="dynamixel",
            show_default=True,
            type=click.Choice(["dynamixel", "serial"]),
            help="What strikes: a servo, or a microcontroller on a serial port.",
        ),
        click.option(
            "--servo",
            default=DEFAULT_MODEL,
            show_default=True,
            type=click.Choice(MODEL_NAMES),
            help="Model of the servo.",
        ),
        click.option(
            "--make",
            type=click.Choice(CAMERA_MAKES),
            help="Make that the GigE camera takes on: names of its settings, bounds, clock, instant that it "
            "stamps.  [default: Aravis's own fake camera]",
        ),
        click.option(
            "--camera",
            default="gige",
            show_default=True,
            type=click.Choice(["gige", "usb3", "v4l2"]),
            help="What sees it: a GigE Vision or USB3 Vision camera, or a webcam (V4L2; needs root).",
        ),
        click.option(
            "--address",
            help="Loopback address of a virtual GigE camera; one per rig.  [default: the first free one from "
            "127.0.0.1]",
        ),
        click.option(
            "--seed", default=1, type=click.IntRange(0), help="Seed of everything random in the virtual rig."
        ),
        click.option(
            "--friction",
            type=NumberRange(0.05, 2.0),
            help="Friction between object and table.  [default: by the truth file, or drawn from the seed]",
        ),
        click.option(
            "--contents",
            metavar="KIND:SHARE[:VALUE]",
            help="What moves inside: liquid, powder or lump, its share of the mass, and the filled share, "
            "angle of repose [deg] or friction (liquid:0.2:0.5).  [default: nothing]",
        ),
        click.option(
            "--truth",
            type=click.Path(path_type=Path),
            help="Hidden masses of your own object (TOML, table [truth]).  [default: drawn from the seed]",
        ),
        click.option(
            "--object",
            "object_name",
            default="carton",
            show_default=True,
            type=_ObjectName(),
            help="What to strike: carton, spray, juice, salt, parcel (which holds lumps), or an object file "
            "of your own (.toml).",
        ),
    ):
        command = option(command)
    return command


def refuse_other_kind(camera: CameraKindName, make: str | None, striker: KindName, servo: str) -> None:
    """Refuse a make or a model for another kind of device.

    Raises:
        click.UsageError: a make is given and the camera is not GigE, or a model and the striker is no servo.
    """
    if make is not None and camera != "gige":
        raise click.UsageError(f"--make {make} is a GigE camera: leave --camera {camera} out, or --make")
    if servo != DEFAULT_MODEL and not STRIKER_KINDS[striker].has_servo:
        raise click.UsageError(f"--servo {servo} is no {striker} striker: leave --striker out, or --servo")


def refuse_truth_of_ours(object_name: str, truth: Path | None) -> None:
    """Refuse a truth file for an object that comes with the program.

    Raises:
        click.UsageError: a truth file is given, and the object is one of those.
    """
    if truth is not None and object_name in _OBJECTS:
        raise click.UsageError(
            f"--truth is for an object file of your own: the masses of the {object_name} come from the seed"
        )
