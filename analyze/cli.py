"""The `analyze` command: verbs only; each hands over to the module that does the work.

Exit codes: 0 done, 1 a named problem (one line on standard error), 2 wrong usage, 130 interrupted.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from analyze.errors import AnalyzeError
from schemas.command_line import Commands, NumberRange, one_line_errors

if TYPE_CHECKING:
    from analyze.pipeline import Estimate


_one_line_errors = one_line_errors("analyze", AnalyzeError)


@click.group("analyze", cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="percuss")
def main() -> None:
    """Plan strikes; turn recordings into centre of mass, inertia and region masses."""
    # One thread for the linear algebra: the matrices are small, and results must not depend on the number of cores.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")


_files = click.argument("files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
_estimate_options = [
    click.option("--object", "object_file", type=click.Path(path_type=Path), help="Use this object file instead of the recording's."),
    click.option("--exclude", multiple=True, metavar="STRIKE", help="Leave a strike out (id as in the report); may be repeated."),
]


def _with_estimate_options(function: Callable[..., Any]) -> Callable[..., Any]:
    for option in reversed(_estimate_options):
        function = option(function)
    return function


@main.command()
@click.argument("object_file", metavar="OBJECT", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Where to write the plan (JSON).")
@click.option("--rig", type=click.Path(path_type=Path), help="Rig file: camera, striker, friction, gravity; defaults without it.")
@click.option("--strikes", default=9, show_default=True, type=click.IntRange(1, 200), help="How many strikes; with --given: how many more.")
@click.option(
    "--target-com-mm",
    type=NumberRange(0, 1000, min_open=True),
    metavar="X",
    help="Instead: the fewest strikes that bring the centre of mass to X mm (root mean square distance), or how near they come.",
)
@click.option(
    "--given",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Plan on from strikes made: a recording (.mcap) or what `estimate --json` printed; may be repeated. Says if more strikes pay.",
)
@click.option(
    "--method",
    type=click.Choice(["ours", "paper"]),
    default="ours",
    show_default=True,
    help="paper: the paper's own steps, first three points by force, for comparison.",
)
@click.option(
    "--gravity",
    is_flag=True,
    help="One strike more, of the edge that tells most, with object and striker turned by 180 degrees: it tells the table's tilt.",
)
@click.option(
    "--cards/--no-cards",
    default=True,
    show_default=True,
    help="With -o PLAN.json: also write PLAN-cards.html, a page per strike with pictures, to print.",
)
@click.option("--rerun", "scenes", type=click.Path(path_type=Path), metavar="FILE", help="Write the cards for rerun too (.rrd), to turn.")
@click.option("--json", "as_json", is_flag=True, help="Print the plan as JSON.")
@_one_line_errors
def plan(
    object_file: Path,
    output: Path | None,
    cards: bool,
    scenes: Path | None,
    rig: Path | None,
    strikes: int,
    target_com_mm: float | None,
    given: tuple[Path, ...],
    method: str,
    gravity: bool,
    as_json: bool,
) -> None:
    """Plan the strikes for OBJECT (TOML): how to place it, where to strike, how hard, and how well the answer will be known."""
    from analyze.output_file import refuse_unwritable
    from analyze.plan_files import STEPS, PlanOptions, plan_object, write_plan
    from analyze.plan_table import render_plan
    from analyze.progress import StrikeProgress
    from schemas.strike_plan import PlanMethod

    if method == "paper" and (target_com_mm is not None or given or gravity):
        raise click.UsageError("the paper's method knows no --target-com-mm, --given or --gravity: leave them out, or plan with ours")
    for path in (output, scenes):
        if path is not None:
            refuse_unwritable(path, object_file, *(each for each in (rig, *given) if each is not None))
    with StrikeProgress() as progress:
        planned = plan_object(object_file, PlanOptions(rig, strikes, target_com_mm, given, PlanMethod(method), gravity), progress)
        page: Path | None = None
        if output is not None:
            write_plan(planned.plan, output)
        progress("drawing the cards", STEPS - 1, STEPS)
        if output is not None and cards:
            from analyze.cards.page import write_cards

            page = output.with_name(f"{output.stem}-cards.html")
            write_cards(planned.plan, planned.model, planned.spec, page)
        if scenes is not None:
            from analyze.replay_cards import write_card_scenes

            write_card_scenes(planned.plan, planned.model, planned.spec, planned.camera, scenes)
    if as_json:
        click.echo(planned.plan.model_dump_json())
    else:
        render_plan(planned.plan)
    if page is not None:
        click.echo(f"cards: {page}: a page per strike, to print (--no-cards leaves them out)", err=as_json)
    if scenes is not None:
        click.echo(f"rerun: {scenes}: a step of the timeline per strike; open it with `rerun {scenes}`", err=as_json)


@main.command()
@_files
@_with_estimate_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@_one_line_errors
def estimate(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], as_json: bool) -> None:
    """Centre of mass, moments of inertia and region masses from a recording, or from several of one object."""
    from analyze.results.summary import render_summary

    answer = _estimate(files, object_file, exclude)
    if as_json:
        click.echo(answer.json())
    else:
        render_summary(answer)


@main.command()
@_files
@_with_estimate_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def score(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], as_json: bool) -> None:
    """Truth beside estimate, for virtual recordings."""
    from analyze.score import refuse_without_truth, render_score, score_estimate

    refuse_without_truth(files)
    result = score_estimate(files[0], _estimate(files, object_file, exclude))
    if as_json:
        click.echo(json.dumps(result, allow_nan=False))
    else:
        render_score(result)


@main.command()
@_files
@_with_estimate_options
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Where to write; default FILE with .html; needed for several files.")
@_one_line_errors
def report(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], output: Path | None) -> None:
    """One HTML file with the answer, its reasons and its plots."""
    from analyze.file_row import row_of
    from analyze.output_file import refuse_unwritable
    from analyze.results.report import write_report
    from analyze.score import score_if_virtual

    if output is None and len(files) > 1:
        raise click.UsageError("several recordings make one report: say where with -o, as in -o joint.html")
    output = output or files[0].with_suffix(".html")
    refuse_unwritable(output, *(part for file in files for part in row_of(file).files))
    answer = _estimate(files, object_file, exclude)
    write_report(answer, output, score_if_virtual(files, answer))
    click.echo(f"report: {output}")


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
@_with_estimate_options
@click.option("--save", type=click.Path(path_type=Path), help="Write a .rrd instead of opening the viewer.")
@click.option("--screenshot", type=click.Path(path_type=Path), help="Write a PNG of the view; needs no screen.")
@_one_line_errors
def replay(file: Path, object_file: Path | None, exclude: tuple[str, ...], save: Path | None, screenshot: Path | None) -> None:
    """See what happened, in rerun."""
    from analyze.file_row import row_of
    from analyze.output_file import refuse_unwritable
    from analyze.replay import replay_recording

    for path in (save, screenshot):
        if path is not None:
            refuse_unwritable(path, *row_of(file).files)
    replay_recording(file, _estimate((file,), object_file, exclude), save, screenshot)
    for path in (save, screenshot):
        if path is not None:
            click.echo(f"replay: {path}")


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def inspect(file: Path, as_json: bool) -> None:
    """What is in a recording: topics, rates, gaps, session."""
    from analyze.inspect import inspect_recording, render_inspection

    found = inspect_recording(file)
    if as_json:
        click.echo(json.dumps(found, allow_nan=False))
    else:
        render_inspection(found)


@main.command()
@click.argument("file", type=click.Path(path_type=Path))
@_one_line_errors
def watch(file: Path) -> None:
    """Follow a recording while it grows; JSON lines on standard output (started by `acquire`)."""
    from analyze.watch import watch as watch_recording

    watch_recording(file, sys.stdin, sys.stdout)


@main.command("print-tags")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The PDF to write.")
@click.option("--object", "object_file", type=click.Path(path_type=Path), help="Take family, ids and sizes from this object file.")
@click.option("--ids", help="Which tags: 0-11, or 0,3,7.  [default: 0-11]")
@click.option("--size-mm", type=float, help="Edge of the black square.  [default: 30]")
@click.option("--family", help="Tag family, as 25h9 or 4x4_100.  [default: 36h11; of a board 5x5_100]")
@click.option("--board", type=click.Choice(["charuco"]), help="Instead: a board to calibrate a camera with.")
@click.option("--squares", metavar="CxR", help="Of the board: columns x rows.  [default: 7x9]")
@click.option("--square-mm", type=float, help="Of the board: edge of a square.  [default: 22]")
@click.option("--paper", default="A4", show_default=True, help="A4 or Letter.")
@_one_line_errors
def print_tags(
    output: Path,
    object_file: Path | None,
    ids: str | None,
    size_mm: float | None,
    family: str | None,
    board: str | None,
    squares: str | None,
    square_mm: float | None,
    paper: str,
) -> None:
    """Tags, or a ChArUco board, as PDF to scale, with rulers to check the print."""
    from analyze.output_file import refuse_unwritable
    from analyze.tags import printing

    if object_file is not None and any(given is not None for given in (ids, size_mm, family, board)):
        raise click.UsageError("--object says which tags and how large: leave --ids, --size-mm, --family and --board out")
    if board is not None and (ids is not None or size_mm is not None):
        raise click.UsageError("a board has tags of its own: leave --ids and --size-mm out (--squares and --square-mm say how large it is)")
    if board is None and (squares is not None or square_mm is not None):
        raise click.UsageError("--squares and --square-mm are of a board: add --board charuco")
    refuse_unwritable(output, *([] if object_file is None else [object_file]))
    if board is not None:
        plain = printing.BoardOptions()
        asked = printing.BoardOptions(family, squares or plain.squares, plain.square_mm if square_mm is None else square_mm, None, paper)
        click.echo(printing.print_board(asked, output))
    else:
        click.echo(printing.print_tags(printing.PrintOptions(family, ids, size_mm, object_file, paper), output))


@main.group(cls=Commands)
def reproduce() -> None:
    """Published data and results, computed again."""


@reproduce.command("cube-tosses")
@click.option("--data", type=click.Path(path_type=Path), help="The packed tosses (.npz).  [default: ../shared/data/contactnets_tosses.npz]")
@click.option("--plot", type=click.Path(path_type=Path), help="Write the figure (.png, .svg or .pdf).")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
def cube_tosses(data: Path | None, plot: Path | None, as_json: bool) -> None:
    """A real cube's centre of mass and inertia from flight, from edge contact and from corner contact, each on its own."""
    from analyze.output_file import refuse_unwritable
    from analyze.progress import StrikeProgress
    from analyze.reproduce.cube_tosses import DEFAULT_DATA, analyse_tosses, answer_json, read_tosses
    from analyze.results.cube_tosses import cube_figure, render_cube
    from analyze.results.style import write_figure

    source = data or DEFAULT_DATA
    if plot is not None:
        refuse_unwritable(plot, source)
    tosses = read_tosses(source)
    with StrikeProgress() as progress:
        answer = analyse_tosses(tosses, progress)
    if as_json:
        click.echo(json.dumps(answer_json(answer), allow_nan=False))
    else:
        render_cube(answer)
    if plot is not None:
        write_figure(cube_figure(answer), plot)
        click.echo(f"plot: {plot}", err=as_json)


@main.command()
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
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
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
    as_json: bool,
) -> None:
    """Calibrate a camera from views of a ChArUco board: images, folders, patterns in quotes, recordings.

    The board is what `analyze print-tags --board charuco` prints; take 15 views or more, tilted by 20 to 45 degrees to all sides, and
    reaching into all corners of the image.
    """
    from analyze.calibrate import CalibrateOptions, calibrate_camera
    from analyze.camera_files import default_picture, parse_mark, refuse_unplaced, write_calibration, write_into_rig
    from analyze.camera_table import calibration_json, render_calibration
    from analyze.output_file import refuse_unwritable
    from analyze.progress import StrikeProgress
    from analyze.results.calibration_plot import write_picture
    from analyze.tags.printing import BoardOptions, parse_board
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


@main.command()
@_files
@_with_estimate_options
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Write the object file with the places found (TOML).")
@click.option("--table", "find_table", is_flag=True, help="Find the table's tilt and height too: no board was seen on it.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@_one_line_errors
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


@main.command()
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
@_one_line_errors
def gravity(inputs: tuple[Path, ...], rig: Path | None, camera_sd_deg: float, write: bool, picture: Path | None, as_json: bool) -> None:
    """How the table slopes, from images or a recording of a plumb line: a string with a weight that hangs in the camera's view.

    One string tells the rise across the camera's view, which is what tips feel; two or more, far apart in the image, tell both rises.
    """
    from math import radians

    from analyze.gravity import GravityOptions, gravity_json, gravity_text, read_gravity, write_level
    from analyze.output_file import refuse_unwritable
    from analyze.progress import StrikeProgress
    from analyze.results.plumb_picture import write_plumb_picture

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


def _estimate(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...]) -> Estimate:
    from analyze.pipeline import EstimateOptions, estimate_recordings
    from analyze.progress import StrikeProgress

    with StrikeProgress() as progress:
        return estimate_recordings(files, EstimateOptions(object_path=object_file, exclude=frozenset(exclude)), progress)
