"""CPU time of nine strikes with and without three tosses, per frame: `make bench-toss-time` (a minute).

Strikes are tracked and fitted from the sample recording's images, decoded before; tosses are rendered before.
The joint estimate is that of sessions of `make bench-tosses`. Only the CPU time of this process counts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeVar
from unittest.mock import patch

import click
import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from acquire.virtual.objects import OBJECT_NAMES
from analyze.flight.toss import TossMotion
from analyze.pipeline import read_evidence as reading
from analyze.pipeline.estimate import estimate_evidence
from analyze.types import ImageFrame
from tests.benchmarks import tosses
from tests.tossed import TossedObject

SAMPLE = Path(__file__).parents[2] / "recordings" / "sample-1.0.mcap"
STRIKES = 9
T = TypeVar("T")


@dataclass(frozen=True)
class Cost:
    """CPU time of a part of a session."""

    seconds: float
    """CPU time of reading [s]"""
    frames: int
    """number of frames read"""


def timed(function: Callable[[], T]) -> tuple[T, float]:
    """Result of a function, and its CPU time [s]."""
    began = time.process_time()
    return function(), time.process_time() - began


def strikes() -> Cost:
    """Tracking and motion of nine strikes, from those of the sample recording; the better of two runs."""
    found: list[Cost] = []
    track_markers, analyse_strike = reading.track_markers, reading.analyse_strike
    for _ in range(2):
        spent, frames, number = 0.0, 0, 0

        def track(images: Any, *args: Any) -> Any:
            nonlocal spent, frames, number
            images = list(images)
            report, cost = timed(partial(track_markers, images, *args))
            spent, frames, number = spent + cost, frames + len(images), number + 1
            return report

        def analyse(*args: Any) -> Any:
            nonlocal spent
            motion, cost = timed(partial(analyse_strike, *args))
            spent += cost
            return motion

        with patch.object(reading, "track_markers", track), patch.object(reading, "analyse_strike", analyse):
            reading.read_evidence(reading.read_head(SAMPLE))
        found.append(Cost(STRIKES * spent / number, round(STRIKES * frames / number)))
    return min(found, key=lambda each: each.seconds)


def session(name: str, seed: int) -> tuple[Cost, float, float]:
    """Reading of an object's three tosses, and the estimate without and with them [s]."""
    spent: list[Cost] = []
    read = tosses.read

    def measured(thrown: TossedObject, *args: Any) -> TossMotion:
        frames: list[ImageFrame] = list(thrown.frames(noise_seed=seed))
        still = SimpleNamespace(frames=lambda **_: frames, planned=thrown.planned)
        found, cost = timed(partial(read, still, *args))  # type: ignore[arg-type]
        spent.append(Cost(cost, len(frames)))
        return found

    with patch.object(tosses, "read", measured):
        evidence, _ = tosses.session(name, seed, drawn=True)
    alone = replace(evidence, tosses=())
    estimate_evidence(alone)  # imports modules that are loaded late
    without, both = (timed(partial(estimate_evidence, each))[1] for each in (alone, evidence))
    return Cost(sum(each.seconds for each in spent), sum(each.frames for each in spent)), without, both


@click.command()
@click.option("--objects", default=",".join(OBJECT_NAMES), show_default=True)
@click.option("--seed", default=1, show_default=True)
def main(objects: str, seed: int) -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    struck = strikes()
    table = Table(title="CPU time of nine strikes and three tosses", title_justify="left")
    headings = (
        "object",
        "strikes [ms/frame]",
        "tosses [ms/frame]",
        "estimate without, with tosses [s]",
        "all without, with tosses [ms/frame]",
        "ratio",
    )
    for heading in headings:
        table.add_column(heading, justify="left" if heading == "object" else "right")
    ratios: list[float] = []
    for name in objects.split(","):
        thrown, without, both = session(name, seed)
        alone = (struck.seconds + without) / struck.frames
        together = (struck.seconds + thrown.seconds + both) / (struck.frames + thrown.frames)
        ratios.append(together / alone)
        table.add_row(
            name,
            f"{1e3 * struck.seconds / struck.frames:.2f}",
            f"{1e3 * thrown.seconds / thrown.frames:.2f}",
            f"{without:.2f}, {both:.2f}",
            f"{1e3 * alone:.2f}, {1e3 * together:.2f}",
            f"{ratios[-1]:.2f}",
        )
    console = Console(width=110)
    console.print(table)
    console.print(f"ratio, median {np.median(ratios):.2f}, largest {max(ratios):.2f}", highlight=False)


if __name__ == "__main__":
    main()
