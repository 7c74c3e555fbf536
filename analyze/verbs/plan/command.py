"""The command `analyze plan`: its options, and the files that it writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.verbs.options import one_line, pass_options, path_option
from analyze.verbs.outputs import refuse_outputs
from schemas.command_line import NumberRange
from schemas.plain_text import echo, json_line

if TYPE_CHECKING:
    from analyze.verbs.plan.plan_object import PlannedObject


@dataclass(frozen=True)
class _PlanArguments:
    """Values of the arguments and options of `analyze plan`."""

    object_file: Path
    """object file (TOML)"""
    output: Path | None
    """plan to write (JSON); None to write none"""
    cards: bool
    """True to write the cards (a page per strike, to print) beside the plan"""
    scenes: Path | None
    """file to write with the cards as scenes for the viewer rerun (.rrd); None to write none"""
    rig: Path | None
    """rig file; None for the rig of a given recording, else a nominal rig"""
    camera: Path | None
    """camera file of a phone, for strikes by hand; None for a rig"""
    strikes: int
    """number of strikes; with `given`, of additional strikes"""
    axes: int | None
    """largest number of different axes (pivot edges); None for no limit"""
    target_com_mm: float | None
    """rms error of the centre of mass to reach [mm]; None to plan a number of strikes"""
    given: tuple[Path, ...]
    """recordings and results of strikes already made"""
    method: str
    """"ours" or "paper": the method of planning"""
    gravity: bool
    """True to add a strike turned by 180 degrees, which determines the table's tilt"""
    contents: bool
    """True to strike one edge at three energies and on two faces, which shows contents that move"""
    tosses: int
    """number of tosses by hand after the strikes"""
    as_json: bool
    """True to print the plan as JSON"""


@click.command()
@click.argument("object_file", metavar="OBJECT", type=click.Path(path_type=Path))
@path_option("-o", "--output", help="The plan to write (JSON).")
@path_option(
    "--rig",
    help="Rig file with camera, striker, friction and gravity; what it leaves out is nominal.  [default: a "
    "nominal rig]",
)
@path_option(
    "--camera",
    help="Strikes by hand, filmed through the lens in this camera file: the cards state where this phone "
    "stands and, in words, how hard to flick.",
)
@click.option(
    "--strikes",
    default=9,
    show_default=True,
    type=click.IntRange(0, 200),
    help="Number of strikes; with --given, of additional strikes. With --tosses one or two are enough, and "
    "0 plans tosses alone.",
)
@click.option(
    "--axes",
    type=click.IntRange(1),
    metavar="N",
    help="Strike at most N axes; each needs a placement by hand.  [default: as many as improve the answer]",
)
@click.option(
    "--target-com-mm",
    type=NumberRange(0, 1000, min_open=True),
    metavar="X",
    help="Instead of --strikes: as few strikes as determine the centre of mass to X mm (root mean square "
    "distance).",
)
@path_option(
    "--given",
    multiple=True,
    metavar="FILE",
    help="Continue from strikes already made: a recording (.mcap) or the output of `analyze estimate "
    "--json`; may be repeated. The plan states whether more strikes help; `--strikes 0 --tosses 3` adds "
    "tosses alone.",
)
@click.option(
    "--method",
    type=click.Choice(["ours", "paper"]),
    default="ours",
    show_default=True,
    help="paper: the paper's own steps (its first three points), for comparison.",
)
@click.option(
    "--gravity",
    is_flag=True,
    help="Add one strike of the most informative edge with object and striker turned by 180 degrees, which "
    "determines the table's tilt.",
)
@click.option(
    "--contents",
    is_flag=True,
    help="Strike one edge at three energies, and the object on two faces: `analyze estimate` then tells "
    "whether liquid, powder or a loose lump moves inside.",
)
@click.option(
    "--tosses",
    default=0,
    type=click.IntRange(0, 20),
    metavar="N",
    help="Add N tosses by hand before the same camera: they determine the products of inertia, which strikes "
    "leave open; 3 are enough.  [default: none]",
)
@click.option(
    "--cards/--no-cards",
    default=True,
    show_default=True,
    help="With -o PLAN.json: also write PLAN-cards.html, a page with pictures per strike, to print.",
)
@path_option("--rerun", "scenes", metavar="FILE", help="Also write the cards as scenes for rerun (.rrd).")
@click.option("--json", "as_json", is_flag=True, help="Print the plan as JSON.")
@one_line
@pass_options(_PlanArguments)
def plan(arguments: _PlanArguments) -> None:
    """Plan the strikes for OBJECT (TOML).

    The plan states how to place the object, where and how hard to strike, and the expected accuracy.
    """
    from analyze.progress import ProgressBar
    from analyze.verbs.plan.plan_object import STEPS, PlanOptions, plan_object
    from analyze.verbs.plan.table import render_plan
    from schemas.strike_plan import PlanMethod

    _refuse_early(arguments)
    options = PlanOptions(
        arguments.rig,
        arguments.strikes,
        arguments.target_com_mm,
        arguments.given,
        PlanMethod(arguments.method),
        arguments.gravity,
        arguments.axes,
        arguments.contents,
        arguments.camera,
        arguments.tosses,
    )
    with ProgressBar() as progress:
        planned = plan_object(arguments.object_file, options, progress)
        progress("drawing the cards", STEPS - 1, STEPS)
        page = _write(planned, arguments)
    if arguments.as_json:
        echo(json_line(planned.plan.model_dump_json()))
    else:
        render_plan(planned.plan, by_hand=arguments.camera is not None)
    if page is not None:
        echo(
            f"cards: {page}: a page per strike, to print (--no-cards leaves them out)", err=arguments.as_json
        )
    if (scenes := arguments.scenes) is not None:
        echo(
            f"rerun: {scenes}: a step of the timeline per strike; open it with `rerun {scenes}`",
            err=arguments.as_json,
        )


def _refuse_early(arguments: _PlanArguments) -> None:
    """Check the options before the computation.

    Raises:
        click.UsageError: options that `--method paper` or `--strikes 0` does not have are given with it.
        OutputError: a file cannot be written, or would replace an input.
    """
    of_strikes = (
        arguments.target_com_mm is not None
        or arguments.gravity
        or arguments.contents
        or arguments.axes is not None
    )
    if arguments.method == "paper" and (of_strikes or arguments.given):
        raise click.UsageError(
            "the paper's method has no --axes, --target-com-mm, --given, --gravity or --contents: leave them "
            "out, or use --method ours"
        )
    if arguments.strikes == 0 and arguments.tosses == 0:
        raise click.UsageError("--strikes 0 plans nothing: ask for strikes, or for tosses (--tosses 3)")
    if arguments.strikes == 0 and (of_strikes or arguments.method == "paper"):
        raise click.UsageError(
            "--strikes 0 plans tosses alone: leave out --axes, --target-com-mm, --gravity, --contents and "
            "--method"
        )
    inputs = [arguments.object_file, arguments.rig, arguments.camera, *arguments.given]
    refuse_outputs([arguments.output, arguments.scenes], inputs=inputs)


def _write(planned: PlannedObject, arguments: _PlanArguments) -> Path | None:
    """Write the files that the options name: the plan, its cards and its scenes for the viewer rerun.

    Returns:
        Path of the cards' page (HTML, to print); None if it is not written.
    """
    from analyze.verbs.plan.plan_object import write_plan

    page: Path | None = None
    if (output := arguments.output) is not None:
        write_plan(planned.plan, output)
        if arguments.cards:
            from analyze.cards.page import write_cards

            page = output.with_name(f"{output.stem}-cards.html")
            by_hand = arguments.camera is not None
            write_cards(planned.plan, planned.model, planned.spec, page, by_hand)
    if arguments.scenes is not None:
        from analyze.replay.cards import write_card_scenes

        write_card_scenes(planned.plan, planned.model, planned.spec, planned.camera, arguments.scenes)
    return page
