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
from analyze.predict.assets import ESTIMATED
from analyze.predict.predict import ASSETS
from analyze.predict.thrown import NO_AIR, ROOM_AIR
from analyze.predict.tosses import PredictedToss, predict_toss, usable_tosses
from tests.benchmarks.tosses import session


@click.command()
@click.option("--seeds", default=2, help="seeds of each object")
@click.option("--objects", default=",".join(OBJECT_NAMES), help="names, separated by commas")
def main(seeds: int, objects: str) -> None:
    """Print the table: medians over the tosses of each object, and over all."""
    table = Table(title="left-out tosses: rms error of the attitude [°], median over the tosses")
    columns = [f"{asset}, {air}" for air, asset in product(("air", "no air"), ASSETS)]
    for column in ("object", "tosses", *columns, "uniform / estimated", "video's own"):
        table.add_column(column, justify="left" if column == "object" else "right")
    everything: list[tuple[PredictedToss, PredictedToss]] = []
    cases = list(product(objects.split(","), range(1, seeds + 1)))
    by_name: dict[str, list[tuple[PredictedToss, PredictedToss]]] = {}
    for name, seed in track(cases, "tosses", console=Console(stderr=True)):
        evidence, _ = session(name, seed, drawn=False)
        for toss in usable_tosses(evidence, EstimateOptions()).values():
            try:
                airs = [predict_toss(evidence, EstimateOptions(), toss, air) for air in (ROOM_AIR, NO_AIR)]
            except EstimationError:
                continue
            by_name.setdefault(name, []).append((airs[0], airs[1]))
            everything.append((airs[0], airs[1]))
    for name, pairs in (*by_name.items(), ("all", everything)):
        medians = np.degrees(
            [np.median([pair[air].error(asset).rms for pair in pairs]) for air in (0, 1) for asset in ASSETS]
        )
        own = np.degrees(np.median([np.median(pair[0].measured_sd) for pair in pairs]))
        cells = [f"{each:.2f}" for each in (*medians, medians[1] / medians[0], own)]
        table.add_row(name, str(len(pairs)), *cells)
    Console(width=200).print(table)
    better = np.mean([pair[0].gain > 1 for pair in everything])
    Console().print(f"{ESTIMATED} better than uniform in {100 * better:.0f} % of the tosses")


if __name__ == "__main__":
    main()
