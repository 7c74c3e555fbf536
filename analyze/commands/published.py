"""`analyze reproduce`."""

from __future__ import annotations

import json
from pathlib import Path

import click

from analyze.commands.options import one_line
from schemas.command_line import Commands


@click.group(cls=Commands)
def reproduce() -> None:
    """Published data and results, computed again."""


@reproduce.command("cube-tosses")
@click.option("--data", type=click.Path(path_type=Path), help="The packed tosses (.npz).  [default: ../shared/data/contactnets_tosses.npz]")
@click.option("--plot", type=click.Path(path_type=Path), help="Write the figure (.png, .svg or .pdf).")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
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
