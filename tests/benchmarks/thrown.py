"""Tosses left out of the estimate, thrown in MuJoCo and compared with the video: `make bench-thrown`.

Sessions are those of tosses.py: nine drawn tips, three tosses through images. Each good toss is left out and
predicted, with MuJoCo's air and without; both by the estimated, the uniform and the shell body.
"""

from __future__ import annotations

from itertools import product

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from acquire.virtual.objects import OBJECT_NAMES
from analyze.errors import EstimationError
from analyze.pipeline.solved import EstimateOptions
from analyze.predict.predict import ASSETS
from analyze.predict.thrown import NO_AIR, ROOM_AIR
from analyze.predict.tosses import PredictedToss, predict_toss, usable_tosses
from tests.benchmarks.tosses import session

Pair = tuple[PredictedToss, PredictedToss]
"""one toss, predicted with MuJoCo's air and without"""


def pairs(name: str, seed: int, drawn: bool) -> list[Pair]:
    """Predictions of the good tosses of one session."""
    evidence, _ = session(name, seed, drawn)
    found: list[Pair] = []
    for toss in usable_tosses(evidence, EstimateOptions()).values():
        try:
            with_air, without = (
                predict_toss(evidence, EstimateOptions(), toss, air) for air in (ROOM_AIR, NO_AIR)
            )
        except EstimationError as error:
            click.echo(f"{name}, seed {seed}, {toss.toss_id}: {error}", err=True)
            continue
        found.append((with_air, without))
    return found


def row(name: str, some: list[Pair]) -> list[str]:
    """Row of the table: medians over tosses [deg]."""
    medians = np.degrees(
        [np.median([pair[air].error(asset).rms for pair in some]) for air in (0, 1) for asset in ASSETS]
    )
    own = np.degrees(np.median([np.median(pair[0].measured_sd) for pair in some]))
    better = np.mean([pair[0].gain > 1 for pair in some])
    cells = [f"{each:.2f}" for each in (*medians, medians[1] / medians[0], own)]
    return [name, str(len(some)), *cells, f"{100 * better:.0f}"]


@click.command()
@click.option("--seeds", default=2, help="seeds of each object")
@click.option("--objects", default=",".join(OBJECT_NAMES), help="names, separated by commas")
def main(seeds: int, objects: str) -> None:
    """Print the tables: as calibrated, and with errors of calibration drawn."""
    names = objects.split(",")
    for drawn in (False, True):
        title = "calibrations with errors" if drawn else "as calibrated"
        table = Table(title=f"left-out tosses, {title}: rms error of the attitude [°], median over tosses")
        columns = [f"{asset}, {air}" for air, asset in product(("air", "no air"), ASSETS)]
        for column in ("object", "tosses", *columns, "uniform / estimated", "video", "better [%]"):
            table.add_column(column, justify="left" if column == "object" else "right")
        by_name: dict[str, list[Pair]] = {name: [] for name in names}
        cases = list(product(names, range(1, seeds + 1)))
        for name, seed in track(cases, title, console=Console(stderr=True)):
            by_name[name] += pairs(name, seed, drawn)
        for name, some in (*by_name.items(), ("all", [each for one in by_name.values() for each in one])):
            if some:
                table.add_row(*row(name, some))
        Console(width=200).print(table)


if __name__ == "__main__":
    main()
