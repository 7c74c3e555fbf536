"""CPU time by stage from theta(t) of nine strikes to all results: `make bench-estimate` (a minute).

The sessions are those of `make coverage`. Only the CPU time of this process counts, so that other programs
hardly matter.
"""

from __future__ import annotations

import time
from collections import defaultdict
from contextlib import ExitStack
from types import ModuleType
from typing import Any
from unittest.mock import patch

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.strike_task import StrikeTask
from analyze.motion.tip_angle import PlanarMotion
from analyze.pipeline import estimate as pipeline
from analyze.pipeline import solved
from analyze.result.answer import Answer
from analyze.types import TipMotion
from tests.benchmarks.coverage import PER_SHAPE
from tests.benchmarks.simulated_tips import session

STAGES = {
    "voxelise": "cutting the shape into cells",
    "solve_joint": "centre of mass and moments, jointly",
    "check_solution": "checks",
    "agreement": "checks",
    "region_masses": "regions",
    "paper_estimate": "the paper's estimate",
    "voxel_map": "voxel map",
}
"""rows of the table by functions that `analyze.pipeline.estimate` and `solved` call"""
DOCUMENT = "the document"
MOTION = "theta(t) of nine strikes to phi and k"


def stage_owner(name: str) -> ModuleType:
    """Module of the pipeline that calls the function of a stage by `name`."""
    return next(module for module in (solved, pipeline) if hasattr(module, name))


class Stopwatch:
    """CPU seconds by stage of one session."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._strikes: dict[str, float] = {}

    def analyse(self, motion: PlanarMotion, task: StrikeTask, settings: MotionSettings) -> TipMotion:
        """Call analyse_motion and take its time; for a repeated strike the last one counts."""
        began = time.process_time()
        found = analyse_motion(motion, task, settings)
        self._strikes[task.strike_id] = time.process_time() - began
        self.seconds[MOTION] = sum(self._strikes.values())
        return found

    def timed(self, name: str) -> Any:
        """Wrap a function of the pipeline to measure its time."""
        function = getattr(stage_owner(name), name)

        def measured(*args: Any, **kwargs: Any) -> Any:
            began = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds[STAGES[name]] += time.process_time() - began

        return measured

    def run(self, shape: int, number: int) -> float | None:
        """Run one session; its total CPU time [s], or None if the body has no session."""
        made = session(shape, number, self.analyse)
        if made is None:
            return None
        with ExitStack() as stack:
            for name in STAGES:
                stack.enter_context(patch.object(stage_owner(name), name, self.timed(name)))
            began = time.process_time()
            estimate = pipeline.estimate_evidence(made[0])
            estimated = time.process_time()
            Answer.from_estimate(estimate).json()
            self.seconds[DOCUMENT] = time.process_time() - estimated
            self.seconds["all else"] = (
                time.process_time() - began - sum(self.seconds.values()) + self.seconds[MOTION]
            )
        return sum(self.seconds.values())


@click.command()
@click.option("--sessions", "count", default=24, show_default=True)
@click.option("--seed", default=1, show_default=True)
def main(count: int, seed: int) -> None:
    """Time the sessions and print the table."""
    rows: list[dict[str, float]] = []
    totals: list[float] = []
    number = 0
    # The first session is left out, because it imports modules that are loaded late.
    while len(totals) <= count:
        watch = Stopwatch()
        total = watch.run(1_000_000 * seed + number // PER_SHAPE, number % PER_SHAPE)
        number += 1
        if total is not None:
            totals.append(total)
            rows.append(watch.seconds)
    totals, rows = totals[1:], rows[1:]
    table = Table(title=f"CPU time of {count} sessions of nine strikes [ms]", title_justify="left")
    for heading in ("stage", "median", "worst", "part"):
        table.add_column(heading, justify="left" if heading == "stage" else "right")
    stages = sorted(
        {name for row in rows for name in row},
        key=lambda name: -float(np.median([row.get(name, 0.0) for row in rows])),
    )
    for name in stages:
        each = 1e3 * np.array([row.get(name, 0.0) for row in rows])
        table.add_row(
            name,
            f"{np.median(each):.0f}",
            f"{each.max():.0f}",
            f"{100 * each.sum() / (1e3 * sum(totals)):.0f} %",
        )
    table.add_row("all", f"{1e3 * np.median(totals):.0f}", f"{1e3 * max(totals):.0f}", "")
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
