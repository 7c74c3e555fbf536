"""`analyze reproduce`: compute published results again (real tosses and impacts, the paper's sessions)."""

from __future__ import annotations

import json
from pathlib import Path

import click

from analyze.errors import EstimationError
from analyze.verbs.options import one_line, path_option
from analyze.verbs.outputs import refuse_outputs
from schemas.command_line import CommandGroup
from schemas.plain_text import echo


@click.group(cls=CommandGroup)
def reproduce() -> None:
    """Compute published results again."""


@reproduce.command("cube-tosses")
@path_option("--data", help="File of the tosses (.npz).  [default: ../shared/data/contactnets_tosses.npz]")
@path_option("--plot", help="The figure to write (.png, .svg or .pdf).")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def cube_tosses(data: Path | None, plot: Path | None, as_json: bool) -> None:
    """Estimate a real cube's centre of mass and inertia from published tosses.

    Flight, edge contact and corner contact each give an estimate of their own.
    """
    from analyze.progress import ProgressBar
    from analyze.report.style import write_figure
    from analyze.reproduce.cube_tosses import analyse_tosses
    from analyze.reproduce.cube_tosses_document import answer_json
    from analyze.reproduce.cube_tosses_figure import cube_figure, render_cube
    from analyze.reproduce.cube_tosses_file import DEFAULT_DATA, read_tosses

    source = data or DEFAULT_DATA
    refuse_outputs([plot], inputs=[source])
    tosses = read_tosses(source)
    with ProgressBar() as progress:
        answer = analyse_tosses(tosses, progress)
    if as_json:
        echo(json.dumps(answer_json(answer), allow_nan=False))
    else:
        render_cube(answer)
    if plot is not None:
        write_figure(cube_figure(answer), plot)
        echo(f"plot: {plot}", err=as_json)


@reproduce.command("planar-impacts")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def planar_impacts(file: Path, as_json: bool) -> None:
    """Estimate restitution and friction from published impacts of a real ellipse.

    FILE is data_ellipse.mat of mcubelab/planar-impact-dataset, which you download yourself. The impacts are
    compared with those of a rigid body that touches at one point.
    """
    from analyze.reproduce.planar_impacts import analyse_impacts
    from analyze.reproduce.planar_impacts_document import answer_json
    from analyze.reproduce.planar_impacts_file import read_impacts
    from analyze.reproduce.planar_impacts_table import render_impacts

    answer = analyse_impacts(read_impacts(file))
    if as_json:
        echo(json.dumps(answer_json(answer), allow_nan=False))
    else:
        render_impacts(answer)


@reproduce.command("paper")
@click.argument("recordings", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("recordings/reproduce"),
    show_default=True,
    help="Folder of the page (index.html), its CSV files, and the results of each session (sessions/), "
    "which are kept.",
)
@one_line
def paper(recordings: tuple[Path, ...], out: Path) -> None:
    """Make the tables and figures of the VISAPP 2013 paper again, beside ours, from virtual sessions.

    `make reproduce` records the sessions. RECORDINGS are added to the sessions in the folder; their images
    are not needed afterwards. Without RECORDINGS the page is only drawn again.
    """
    from analyze.progress import ProgressBar
    from analyze.reproduce.paper.page import summary, write_page
    from analyze.reproduce.paper.read import read_session
    from analyze.reproduce.paper.record import read_records, sealed_json
    from analyze.reproduce.paper.targets import targets_table
    from analyze.reproduce.paper.terminal import render_table
    from schemas.output_file import write_text

    folder = out / "sessions"
    folder.mkdir(parents=True, exist_ok=True)
    with ProgressBar() as progress:
        for path in recordings:
            record = read_session(path, progress)
            write_text(folder / f"{record.name}.json", sealed_json(record))
    records = read_records(folder)
    if not records:
        raise EstimationError(
            f"{folder}: contains no session: name recordings of `acquire demo`, or run `make reproduce`"
        )
    page = write_page(records, out)
    render_table(targets_table(records))
    echo(summary(records))
    echo(f"page: {page}")
