"""CPU time from theta(t) of nine strikes to all results, regions and voxels included, by stage: `make bench-estimate` (a minute).

On sessions as those of `make coverage`. Times are of this process's processor alone, so that what else runs on the machine hardly counts.
"""

from __future__ import annotations

import time
from collections import defaultdict
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from analyze.motion.strike import MotionSettings, StrikeTask, analyse_motion
from analyze.motion.tip_angle import PlanarMotion
from analyze.pipeline.estimate import estimate as pipeline
from analyze.types import TipMotion
from tests.benchmarks.coverage import PER_SHAPE
from tests.benchmarks.simulated_tips import session

STAGES = {
    "voxelise": "cutting the shape into cells",
    "solve_joint": "centre of mass and moments, jointly",
    "check": "checks",
    "agreement": "checks",
    "regions_of": "regions",
    "paper_centre_of_mass": "the paper's centre of mass",
    "paper_regions": "the paper's regions",
    "voxel_map": "voxel map",
    "build_result": "the document",
}
MOTION = "theta(t) of nine strikes to phi and k"


class Stopwatch:
    """CPU seconds by stage of one session."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._strikes: dict[str, float] = {}

    def analyse(self, motion: PlanarMotion, task: StrikeTask, settings: MotionSettings) -> TipMotion:
        """As analyse_motion; of a strike that was struck again the last time counts."""
        began = time.process_time()
        found = analyse_motion(motion, task, settings)
        self._strikes[task.strike_id] = time.process_time() - began
        self.seconds[MOTION] = sum(self._strikes.values())
        return found

    def timed(self, name: str) -> Any:
        """That function of the pipeline, on the clock."""
        function = getattr(pipeline, name)

        def on_the_clock(*args: Any, **kwargs: Any) -> Any:
            began = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds[STAGES[name]] += time.process_time() - began

        return on_the_clock

    def run(self, shape: int, number: int) -> float | None:
        """One session; CPU seconds in all, None where that body cannot be had."""
        made = session(shape, number, self.analyse)
        if made is None:
            return None
        with ExitStack() as stack:
            for name in STAGES:
                stack.enter_context(patch.object(pipeline, name, self.timed(name)))
            began = time.process_time()
            pipeline.estimate_evidence(made[0]).json()
            self.seconds["all else"] = time.process_time() - began - sum(self.seconds.values()) + self.seconds[MOTION]
        return sum(self.seconds.values())


@click.command()
@click.option("--sessions", "count", default=24, show_default=True)
@click.option("--seed", default=1, show_default=True)
def main(count: int, seed: int) -> None:
    """Time them."""
    rows: list[dict[str, float]] = []
    totals: list[float] = []
    number = 0
    # The first one loads what is loaded late.
    while len(totals) <= count:
        watch = Stopwatch()
        total = watch.run(1_000_000 * seed + number // PER_SHAPE, number % PER_SHAPE)
        number += 1
        if total is not None:
            totals.append(total)
            rows.append(watch.seconds)
    totals, rows = totals[1:], rows[1:]
    table = Table(title=f"CPU time of {count} sessions of nine strikes [ms]", title_justify="left")
    for heading in ("stage", "median", "worst", "share"):
        table.add_column(heading, justify="left" if heading == "stage" else "right")
    stages = sorted({name for row in rows for name in row}, key=lambda name: -float(np.median([row.get(name, 0.0) for row in rows])))
    for name in stages:
        each = 1e3 * np.array([row.get(name, 0.0) for row in rows])
        table.add_row(name, f"{np.median(each):.0f}", f"{each.max():.0f}", f"{100 * each.sum() / (1e3 * sum(totals)):.0f} %")
    table.add_row("all", f"{1e3 * np.median(totals):.0f}", f"{1e3 * max(totals):.0f}", "")
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
