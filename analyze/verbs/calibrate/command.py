"""`analyze calibrate`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from analyze.verbs.calibrate.drop_command import measure, refuse_mixed, with_drop_options
from analyze.verbs.options import one_line
from schemas.command_line import NumberRange


@click.command()
@click.argument("inputs", metavar="IMAGE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Where to write the rig file's [camera.calibration] (TOML).")
@click.option("--model", type=click.Choice(["pinhole", "fisheye"]), default="pinhole", show_default=True, help="How the lens draws.")
@click.option("--squares", metavar="CxR", help="Of the board, as printed: columns x rows.  [default: 7x9]")
@click.option("--square-mm", type=NumberRange(0, 1000, min_open=True), help="Of the board: edge of a square, as measured.  [default: 22]")
@click.option("--family", help="Of the board's tags.  [default: 5x5_100]")
@click.option(
    "--table", type=click.Path(path_type=Path), metavar="IMAGE", help="The board on the table, its mark on W's origin: where the camera is."
)
@click.option(
    "--upright", is_flag=True, help="With --table: it stands on its lower edge and faces the camera.  [default: it lies, face up]"
)
@click.option(
    "--mark-mm",
    metavar="X,Y,Z",
    default="0,0,0",
    show_default=True,
    help="With --table: where the mark is in W; Z is the plate's thickness.",
)
@click.option("--rig", type=click.Path(path_type=Path), help="The rig file: its region must be the images', its T_world_camera is kept.")
@click.option("--write", is_flag=True, help="Put the calibration into the rig file.")
@click.option("--picture", type=click.Path(path_type=Path), help="Coverage, precision and residuals (PNG).  [default: with -o, beside it]")
@with_drop_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def calibrate(
    inputs: tuple[Path, ...],
    output: Path | None,
    model: str,
    squares: str | None,
    square_mm: float | None,
    family: str | None,
    table: Path | None,
    upright: bool,
    mark_mm: str,
    rig: Path | None,
    write: bool,
    picture: Path | None,
    drop: bool,
    as_json: bool,
    **dropped: Any,
) -> None:
    """Calibrate a camera from views of a ChArUco board: images, folders, patterns in quotes, recordings.

    The board is what `analyze print-tags --board charuco` prints; take 15 views or more, tilted by 20 to 45 degrees to all sides, and
    reaching into all corners of the image.

    With --drop: how fast a video's frames truly come, from a film of a tag in free fall.
    """
    lens = {"-o": output, "--squares": squares, "--square-mm": square_mm, "--family": family, "--table": table, "--rig": rig}
    lens |= {"--upright": upright, "--write": write, "--picture": picture, "--model": model != "pinhole", "--mark-mm": mark_mm != "0,0,0"}
    refuse_mixed(drop, dropped, [name for name, given in lens.items() if given])
    if drop:
        measure(inputs, dropped, as_json)
        return
    from analyze.cameras.calibrate import CalibrateOptions, calibrate_camera
    from analyze.cameras.rig_file import default_picture, parse_mark, refuse_unplaced, write_calibration, write_into_rig
    from analyze.output_file import refuse_unwritable
    from analyze.progress import StrikeProgress
    from analyze.report.calibration_plot import write_picture
    from analyze.tags.printing import BoardOptions, parse_board
    from analyze.verbs.calibrate.table import calibration_json, render_calibration
    from schemas.session_manifest import LensModel

    if write and rig is None:
        raise click.UsageError("--write needs --rig RIG.toml: which file to write into")
    if table is None and (upright or mark_mm != "0,0,0"):
        raise click.UsageError("--upright and --mark-mm are of the board on the table: add --table IMAGE")
    if write and rig is not None and table is None:
        refuse_unplaced(rig)
    plain = BoardOptions()
    board = parse_board(BoardOptions(family, squares or plain.squares, plain.square_mm if square_mm is None else square_mm))
    options = CalibrateOptions(inputs, board, LensModel(model), table, upright, parse_mark(mark_mm), rig)
    picture = picture or (None if output is None else default_picture(output))
    for path in (output, picture):
        if path is not None:
            refuse_unwritable(path, *inputs, *(each for each in (rig, table) if each is not None))
    with StrikeProgress() as progress:
        answer = calibrate_camera(options, progress)
    if picture is not None:
        write_picture(answer.calibration, picture)
        click.echo(f"picture: {picture}", err=True)
    if as_json:
        click.echo(json.dumps(calibration_json(answer), allow_nan=False))
    answer.refuse_undetermined()
    if not as_json:
        render_calibration(answer)
    if output is not None:
        write_calibration(answer, output)
        click.echo(f"calibration: {output}: the rig file's [camera.calibration] (or --rig RIG.toml --write)", err=as_json)
    if write and rig is not None:
        write_into_rig(answer, rig)
        click.echo(f"written to {rig}: start the daemon anew, and plan anew", err=True)
