"""`analyze plan`."""

from __future__ import annotations

from pathlib import Path

import click

from analyze.verbs.options import one_line
from schemas.command_line import NumberRange


@click.command()
@click.argument("object_file", metavar="OBJECT", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Where to write the plan (JSON).")
@click.option("--rig", type=click.Path(path_type=Path), help="Rig file: camera, striker, friction, gravity; defaults without it.")
@click.option("--strikes", default=9, show_default=True, type=click.IntRange(1, 200), help="How many strikes; with --given: how many more.")
@click.option(
    "--axes", type=click.IntRange(1), metavar="N", help="Strike at most N axes, each a placement by hand.  [default: as many as pay]"
)
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
@one_line
def plan(
    object_file: Path,
    output: Path | None,
    cards: bool,
    scenes: Path | None,
    rig: Path | None,
    strikes: int,
    axes: int | None,
    target_com_mm: float | None,
    given: tuple[Path, ...],
    method: str,
    gravity: bool,
    as_json: bool,
) -> None:
    """Plan the strikes for OBJECT (TOML): how to place it, where to strike, how hard, and how well the answer will be known."""
    from analyze.output_file import refuse_unwritable
    from analyze.progress import StrikeProgress
    from analyze.verbs.plan.files import STEPS, PlanOptions, plan_object, write_plan
    from analyze.verbs.plan.table import render_plan
    from schemas.strike_plan import PlanMethod

    if method == "paper" and (target_com_mm is not None or given or gravity or axes is not None):
        raise click.UsageError(
            "the paper's method knows no --axes, --target-com-mm, --given or --gravity: leave them out, or plan with ours"
        )
    for path in (output, scenes):
        if path is not None:
            refuse_unwritable(path, object_file, *(each for each in (rig, *given) if each is not None))
    with StrikeProgress() as progress:
        options = PlanOptions(rig, strikes, target_com_mm, given, PlanMethod(method), gravity, axes)
        planned = plan_object(object_file, options, progress)
        page: Path | None = None
        if output is not None:
            write_plan(planned.plan, output)
        progress("drawing the cards", STEPS - 1, STEPS)
        if output is not None and cards:
            from analyze.cards.page import write_cards

            page = output.with_name(f"{output.stem}-cards.html")
            write_cards(planned.plan, planned.model, planned.spec, page)
        if scenes is not None:
            from analyze.replay.cards import write_card_scenes

            write_card_scenes(planned.plan, planned.model, planned.spec, planned.camera, scenes)
    if as_json:
        click.echo(planned.plan.model_dump_json())
    else:
        render_plan(planned.plan)
    if page is not None:
        click.echo(f"cards: {page}: a page per strike, to print (--no-cards leaves them out)", err=as_json)
    if scenes is not None:
        click.echo(f"rerun: {scenes}: a step of the timeline per strike; open it with `rerun {scenes}`", err=as_json)
