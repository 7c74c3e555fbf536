"""Tosses of the virtual rig's objects followed by their print: found, judged, fitted, beside the truth.

    make bench-print-tosses                 # 5 objects x 10 seeds x 2 kinds of print, bad tosses (an hour)
    python -m tests.benchmarks.print_tosses --seeds 2 --objects carton --bad 0

The views of the print are rendered before each planned strike, in poses as far off as strikes leave them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product

import click
import cv2
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from acquire.virtual.objects import OBJECT_NAMES
from acquire.virtual.packaging import PrintKind
from acquire.virtual.toss import TossKind
from analyze.flight.estimate import FlightFit, estimate_flights
from analyze.flight.toss import TossMotion
from analyze.geometry.second_moments import log_cholesky, scale_free
from analyze.pipeline.toss_marks import TossMarks
from analyze.pipeline.tosses import thrown_body, toss_in_frames
from schemas.toss_result import TossVerdict
from tests.analyze.simulated_session import manifest
from tests.benchmarks.tosses import TOSSES, prepared
from tests.printed import PrintedObject

WRONG_SD = 4.0
"""error over its sd from which on a value is called wrong"""


@dataclass(frozen=True)
class Row:
    """What three tosses of one object determine by its print."""

    name: str
    kind: str
    verdicts: tuple[str, ...]
    com: np.ndarray | None = None
    """(3,) error of c [m]; None without a good toss"""
    shape: np.ndarray | None = None
    """(5,) errors of the tensor's numbers"""
    z: np.ndarray | None = None
    """(8,) all errors over their standard deviations"""


def read(thing: PrintedObject, number: int, kind: TossKind = TossKind.GOOD) -> TossMotion:
    """Follow and judge one planned toss."""
    thrown, spec = thing.tossed(number, kind), thing.thing.spec
    body = thrown_body(spec, prepared(thing.name)[0], manifest(spec))
    frames = thrown.frames(noise_seed=thing.seed)
    return toss_in_frames(("t", "t"), frames, thing.camera, TossMarks([], thing.views), *body)


def fitted(thing: PrintedObject, good: list[TossMotion]) -> tuple[FlightFit, np.ndarray]:
    """Fit of good tosses together, and its errors (8,)."""
    spec, body = thing.thing.spec, thing.thing.body
    flight = good[0].flight
    assert flight is not None
    known = thrown_body(spec, prepared(thing.name)[0], manifest(spec))
    fit = estimate_flights(good, *known, thing.camera, flight.tags)
    shape = scale_free(log_cholesky(np.array(body.inertia_com) / body.mass_kg))[0]
    return fit, fit.estimate.mean - np.append(np.array(body.com_object), shape)


def session(case: tuple[str, int, PrintKind]) -> Row:
    """Three tosses of one object."""
    cv2.setNumThreads(1)
    name, seed, kind = case
    thing = PrintedObject(name, seed, kind)
    found = [read(thing, number) for number in range(TOSSES)]
    verdicts = tuple(each.verdict.value for each in found)
    good = [each for each in found if each.verdict is TossVerdict.GOOD]
    if not good:
        return Row(name, kind.value, verdicts)
    fit, off = fitted(thing, good)
    return Row(name, kind.value, verdicts, off[:3], off[3:], off / np.sqrt(np.diag(fit.estimate.covariance)))


def bad_toss(case: tuple[str, int, TossKind]) -> tuple[TossKind, str, float]:
    """Verdict on a bad toss, and the largest error over its sd of what it alone would give if not refused."""
    cv2.setNumThreads(1)
    name, seed, kind = case
    thing = PrintedObject(name, seed)
    found = read(thing, seed % TOSSES, kind)
    if found.verdict is not TossVerdict.GOOD:
        return kind, found.verdict.value, 0.0
    fit, off = fitted(thing, [found])
    return kind, found.verdict.value, float(np.abs(off / np.sqrt(np.diag(fit.estimate.covariance))).max())


def lines(rows: list[Row]) -> Iterator[list[str]]:
    """Rows of the table, per object and kind of print."""
    for name, kind in dict.fromkeys((each.name, each.kind) for each in rows):
        mine = [each for each in rows if (each.name, each.kind) == (name, kind)]
        verdicts = [verdict for each in mine for verdict in each.verdicts]
        others = {each: verdicts.count(each) for each in sorted(set(verdicts) - {"good"})}
        known = [each for each in mine if each.com is not None]
        com = np.array([1e3 * np.linalg.norm(each.com) for each in known])
        shape = np.array([100 * np.abs(each.shape).max() for each in known])
        z = np.array([each.z for each in known])
        yield [
            name,
            kind,
            f"{verdicts.count('good')} of {len(verdicts)}",
            ", ".join(f"{text} {count}" for text, count in others.items()),
            f"{np.median(com):.2f} / {com.max():.2f}" if known else "",
            f"{np.median(shape):.2f} / {shape.max():.2f}" if known else "",
            f"{np.sqrt(np.mean(z**2)):.2f}" if known else "",
            f"{100 * np.mean(np.abs(z) < 1.96):.0f}" if known else "",
        ]


@click.command()
@click.option("--seeds", default=10, show_default=True)
@click.option("--first", default=1, show_default=True, help="First seed.")
@click.option("--objects", default=",".join(OBJECT_NAMES), show_default=True)
@click.option("--kinds", default="print,light", show_default=True)
@click.option("--bad", default=2, show_default=True, help="Bad tosses of each kind per object.")
def main(seeds: int, first: int, objects: str, kinds: str, bad: int) -> None:
    """Tosses of untagged objects on the virtual rig, beside the truth."""
    names = objects.split(",")
    cases = list(product(names, range(first, first + seeds), [PrintKind(each) for each in kinds.split(",")]))
    wrong_kinds = [kind for kind in TossKind if kind is not TossKind.GOOD]
    trials = list(product(names, range(1, bad + 1), wrong_kinds))
    console = Console(stderr=True)
    with ProcessPoolExecutor(2) as pool:
        rows = list(track(pool.map(session, cases), "sessions", len(cases), console=console))
        tossed = list(track(pool.map(bad_toss, trials), "bad tosses", len(trials), console=console))
    table = Table(title=f"three tosses by print, {seeds} seeds: median / largest")
    for title in ("object", "print", "good", "others", "c mm", "tensor's shape %", "rms z", "in 95 %"):
        table.add_column(title)
    for line in lines(rows):
        table.add_row(*line)
    Console(width=140).print(table)
    far = sum(each.z is not None and bool(np.abs(each.z).max() > WRONG_SD) for each in rows)
    sys.stdout.write(f"sessions with a value more than {WRONG_SD:g} sd off: {far} of {len(rows)}\n")
    for kind in wrong_kinds:
        mine = [each for each in tossed if each[0] is kind]
        verdicts = {
            name: sum(each[1] == name for each in mine) for name in sorted({each[1] for each in mine})
        }
        wrong = sum(each[2] > WRONG_SD for each in mine)
        sys.stdout.write(f"{kind.value}: {verdicts}; called good with a value {WRONG_SD:g} sd off: {wrong}\n")


if __name__ == "__main__":
    main()
