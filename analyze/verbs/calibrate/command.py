"""The command `analyze calibrate`: its options, and the calibration of a lens from views of a board."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.verbs.options import force_option, one_line, pass_options, path_option
from analyze.verbs.outputs import refuse_outputs
from schemas.command_line import NumberRange
from schemas.plain_text import echo

if TYPE_CHECKING:
    from analyze.cameras.calibrate import CalibrateOptions, CalibrationAnswer

_DEFAULT_MARK = "0,0,0"


@dataclass(frozen=True)
class _CalibrateArguments:
    """Values of the arguments and options of `analyze calibrate`."""

    inputs: tuple[Path, ...]
    """images, folders of images, patterns, videos and recordings that show the board"""
    output: Path | None
    """calibration file to write (TOML); None to write none"""
    model: str
    """"pinhole" or "fisheye": the lens model"""
    squares: str | None
    """squares of the board, columns x rows, as text such as "7x9"; None for the default"""
    square_mm: float | None
    """edge of a square [mm]; None for the default"""
    family: str | None
    """tag family of the board; None for the default"""
    table: Path | None
    """image of the board on the table, to measure the camera's pose; None if it is not measured"""
    mat: Path | None
    """image of the mat on the table, to measure the camera's pose; None if it is not measured by it"""
    mat_ruler_mm: float | None
    """length of the mat's ruler as measured on the print [mm]; None for the nominal one"""
    upright: bool
    """True if the board stands in the image `table`, False if it lies on the table"""
    mark_mm: str
    """position of the board's mark in the world frame W, as text "x,y,z" in mm"""
    rig: Path | None
    """rig file; None if there is none"""
    write: bool
    """True to write the calibration into the rig file"""
    picture: Path | None
    """plot to write (PNG); None for the default, a file beside `output`"""
    force: bool
    """True to replace the calibration file if it exists"""
    as_json: bool
    """True to print the calibration as JSON"""


@click.command()
@click.argument("inputs", metavar="IMAGE...", nargs=-1, type=click.Path(path_type=Path))
@path_option(
    "-o", "--output", help="Calibration file to write (TOML): the table [camera.calibration] of a rig file."
)
@click.option(
    "--model",
    type=click.Choice(["pinhole", "fisheye"]),
    default="pinhole",
    show_default=True,
    help="Lens model.",
)
@click.option(
    "--squares", metavar="CxR", help="Squares of the board as printed: columns x rows.  [default: 7x9]"
)
@click.option(
    "--square-mm",
    type=NumberRange(0, 1000, min_open=True),
    help="Edge of the board's squares in mm, as measured on the print.  [default: 22]",
)
@click.option("--family", help="Tag family of the board.  [default: 5x5_100]")
@path_option(
    "--table",
    metavar="IMAGE",
    help="Image of the board on the table, its mark at W's origin, to measure the camera's pose.",
)
@path_option(
    "--mat",
    metavar="IMAGE",
    help="Image of the mat on the table (analyze print-tags --mat), to measure the camera's pose. With --rig "
    "and without other images the lens is the rig file's.",
)
@click.option(
    "--mat-ruler-mm",
    type=NumberRange(10, 2000),
    metavar="MM",
    help="With --mat: length of the ruler on its pivot line, as measured.  [default: as it should be]",
)
@click.option(
    "--upright",
    is_flag=True,
    help="With --table: the board stands on its lower edge and faces the camera.  [default: it lies face up]",
)
@click.option(
    "--mark-mm",
    metavar="X,Y,Z",
    default=_DEFAULT_MARK,
    show_default=True,
    help="With --table: position of the board's mark in W; Z is the board's thickness.",
)
@path_option(
    "--rig",
    help="Rig file. Its image size must be that of the images; its T_world_camera is kept unless --table is "
    "given.",
)
@click.option("--write", is_flag=True, help="Write the calibration into the rig file.")
@path_option(
    "--picture",
    help="Plot of coverage, precision and residuals to write (PNG).  [default: with -o, beside it]",
)
@force_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
@pass_options(_CalibrateArguments)
def calibrate(arguments: _CalibrateArguments) -> None:
    """Calibrate a camera from views of a ChArUco board: images, folders, patterns in quotes, recordings.

    Print the board with `analyze print-tags --board charuco`. Take 15 views or more, tilted by 20 to 45
    degrees to all sides, and reaching into all corners of the image.
    """
    if not arguments.inputs:
        _measure_pose(arguments)
        return
    from analyze.cameras.calibrate import calibrate_camera
    from analyze.progress import ProgressBar
    from analyze.verbs.calibrate.picture import write_picture
    from analyze.verbs.calibrate.table import calibration_json, render_calibration

    options = _calibrate_options(arguments)
    picture = _picture_path(arguments)
    with ProgressBar() as progress:
        answer = calibrate_camera(options, progress)
    if picture is not None:
        write_picture(answer.calibration, picture)
        echo(f"picture: {picture}", err=True)
    if arguments.as_json:
        echo(json.dumps(calibration_json(answer), allow_nan=False))
    answer.refuse_undetermined()
    if not arguments.as_json:
        render_calibration(answer)
    _write_files(answer, arguments)


def _measure_pose(arguments: _CalibrateArguments) -> None:
    """Measure the camera's pose alone, by the mat and with the rig file's lens; print it, or write it there.

    Raises:
        click.UsageError: the mat or the rig file is not given, or another option is.
        CalibrationError: a file cannot be read, or the image shows too little of a mat.
    """
    from analyze.cameras.calibration_toml import write_pose_into_rig
    from analyze.cameras.mat_place import place_of_rig_by_mat
    from analyze.verbs.calibrate.table import place_json, place_line

    if arguments.mat is None or arguments.rig is None:
        raise click.UsageError(
            "no images of the board are given: name them, or measure the pose alone with --mat IMAGE --rig "
            "RIG.toml"
        )
    if arguments.output is not None or arguments.picture is not None or arguments.table is not None:
        raise click.UsageError(
            "--mat with --rig alone measures only the pose: leave -o, --picture and --table out"
        )
    place = place_of_rig_by_mat(arguments.mat, arguments.rig, arguments.mat_ruler_mm)
    if arguments.as_json:
        echo(json.dumps(place_json(place), allow_nan=False))
    else:
        echo(f"camera in W: {place_line(place)}")
    if arguments.write:
        write_pose_into_rig(place.T_world_camera, arguments.rig)
        echo(f"written: T_world_camera in {arguments.rig}", err=True)


def _calibrate_options(arguments: _CalibrateArguments) -> CalibrateOptions:
    from analyze.cameras.calibrate import CalibrateOptions
    from analyze.cameras.calibration_toml import refuse_unplaced
    from analyze.tags.printing import BoardOptions, parse_board
    from schemas.session_manifest import LensModel

    if arguments.write and arguments.rig is None:
        raise click.UsageError("--write needs a rig file to write into: add --rig RIG.toml")
    if arguments.table is None and (arguments.upright or arguments.mark_mm != _DEFAULT_MARK):
        raise click.UsageError("--upright and --mark-mm describe the board on the table: add --table IMAGE")
    if arguments.mat is None and arguments.mat_ruler_mm is not None:
        raise click.UsageError("--mat-ruler-mm describes the mat: add --mat IMAGE")
    if arguments.mat is not None and arguments.table is not None:
        raise click.UsageError("--mat and --table both measure the camera's pose: give one of them")
    if arguments.write and arguments.rig is not None and arguments.table is None and arguments.mat is None:
        refuse_unplaced(arguments.rig)
    default = BoardOptions()
    size = default.square_mm if arguments.square_mm is None else arguments.square_mm
    board = parse_board(BoardOptions(arguments.family, arguments.squares or default.squares, size))
    return CalibrateOptions(
        arguments.inputs,
        board,
        LensModel(arguments.model),
        arguments.table,
        arguments.mat,
        arguments.mat_ruler_mm,
        arguments.upright,
        parse_mark(arguments.mark_mm),
        arguments.rig,
    )


def parse_mark(text: str) -> tuple[float, float, float]:
    """Position (x, y, z) [m] in the world frame W of the board's origin, which a mark shows (--mark-mm).

    Args:
        text: three numbers in millimetres, as "x,y,z".

    Raises:
        CalibrationError: the text is not three numbers, or one of them is not between -2000 and 2000 mm.
    """
    from analyze.errors import CalibrationError

    try:
        x, y, z = (float(part) / 1000 for part in text.split(","))
    except ValueError:
        x = y = z = float("nan")
    if not all(abs(each) < 2.0 for each in (x, y, z)):
        raise CalibrationError(f"--mark-mm {text}: not understood: write x,y,z in millimetres, as 0,0,3")
    return x, y, z


def _picture_path(arguments: _CalibrateArguments) -> Path | None:
    """Path of the calibration's plot: --picture, else the file of -o with the suffix .png.

    None if neither option is given: no plot is written then.

    Raises:
        OutputError: the plot or the file of -o cannot be written, or would replace a file read or kept.
    """
    output = arguments.output
    picture = arguments.picture or (None if output is None else output.with_suffix(".png"))
    inputs = [*arguments.inputs, arguments.rig, arguments.table, arguments.mat]
    refuse_outputs([output, picture], inputs=inputs, force=arguments.force)
    return picture


def _write_files(answer: CalibrationAnswer, arguments: _CalibrateArguments) -> None:
    from analyze.cameras.calibration_toml import write_calibration, write_into_rig

    if arguments.output is not None:
        write_calibration(answer, arguments.output)
        echo(
            f"calibration: {arguments.output}: for --camera of `analyze plan` and `analyze import`, or for "
            "the rig file (--rig RIG.toml --write)",
            err=arguments.as_json,
        )
    if arguments.write and arguments.rig is not None:
        write_into_rig(answer, arguments.rig)
        echo(f"written to {arguments.rig}: restart the daemon, and plan anew", err=True)
