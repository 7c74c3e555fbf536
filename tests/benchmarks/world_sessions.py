"""Whole sessions of world shapes (`make bench-world-sessions`): error of the answer, and whether it holds.

    python -m tests.benchmarks.world_sessions --shapes mug,hammer --kinds cad,scan
    python -m tests.benchmarks.world_sessions --only mug:scan:1

Each session is planned by the product from an object file, struck in a contact simulator on the hull of the
clean mesh, and estimated. The centre of mass must err by at most 1 % of the object's longest edge, 90 to 98 %
of the intervals must hold over all, and nothing trusted may be beyond two half widths.
"""

from __future__ import annotations

import time
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from schemas.strike_result import Verdict
from tests.benchmarks.honesty.scores import Score, score_session
from tests.benchmarks.honesty.struck import Bank
from tests.benchmarks.honesty.tables import FAR
from tests.benchmarks.honesty.world import WorldTrial, run_world_session
from tests.world.catalogue import make, names
from tests.world.object_files import KINDS, Kind

SHAPES = 40
"""number of shapes that are tried unless they are named: every fourth or so of the catalogue"""
GROUPS = ("c (mm)", "c open (mm)", "I diag (%)", "I prod (%)", "I prior (%)")
"""groups of quantities that are compared with the truth"""
MOST_ERROR = 1.0
"""error of c [% of the longest edge] that is allowed"""


@dataclass
class Row:
    """Figures of one session: strikes, scores against the truth, time."""

    name: str
    kind: str
    seed: int
    size: float = 0.0
    """longest edge of the bounding box [m]"""
    planned: int = 0
    struck: int = 0
    """strikes for which the object stood as planned"""
    good: int = 0
    wrong_good: int = 0
    """strikes called good for a line that did not carry them"""
    scores: list[Score] = field(default_factory=list)
    refusal: str = ""
    seconds: float = 0.0
    images: bool = False

    @property
    def c_error(self) -> float:
        """Error of the observed part of c [% of the size]; NaN without an answer."""
        off = [score.value - score.truth for score in self.scores if score.quantity == "c (mm)"]
        return float(100 * 1e-3 * np.linalg.norm(off) / self.size) if off else float("nan")

    @property
    def trusted_wrong(self) -> list[Score]:
        """Trusted values beyond two half widths of their interval."""
        return [score for score in self.scores if score.status == "trust" and score.half_widths_off > FAR]


def run_row(name: str, kind: Kind, seed: int, bank: Path | None, images: bool) -> Row:
    """Row of one session; an exception is reported in `refusal` as a crash."""
    began = time.process_time()
    row = Row(name, kind, seed, images=images)
    try:
        row = row_of(run_world_session(name, kind, seed, Bank(bank), images), row)
    except Exception:
        lines = traceback.format_exc().strip().splitlines()
        row.refusal = f"crash: {lines[-1]} {lines[-3].strip()}"
    row.seconds = time.process_time() - began
    return row


def row_of(found: WorldTrial, row: Row) -> Row:
    """Row with the figures of an ended session entered."""
    scored = score_session(found.trial, row.name, "none", row.seed)
    row.size, row.planned, row.struck = found.size, found.planned, len(found.trial.truths)
    row.refusal = found.trial.refusal
    row.wrong_good = scored.wrong_lines_good
    row.scores = [score for score in scored.scores if score.quantity in GROUPS]
    if found.trial.evidence is not None:
        row.good = sum(motion.verdict is Verdict.GOOD for motion in found.trial.evidence.motions)
    return row


def print_rows(console: Console, rows: list[Row]) -> None:
    """Print one line per session, and the figures of all."""
    headings = ("mm", "planned", "stood", "good", "c error mm", "% of size", "± mm", "c held", "I held")
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("shape", no_wrap=True)
    for heading in (*headings, "I error %"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("remark")
    for row in rows:
        c = [score for score in row.scores if score.quantity.startswith("c")]
        tensor = [score for score in row.scores if score.quantity.startswith("I d")]
        every = [score for score in row.scores if score.quantity.startswith("I")]
        cells = [f"{1e3 * row.size:.0f}", str(row.planned), str(row.struck), str(row.good)]
        if c:
            error = float(np.linalg.norm([score.value - score.truth for score in c]))
            cells += [f"{error:.3f}", f"{row.c_error:.2f}", f"{max(score.half for score in c):.2f}"]
            cells += [_held(c), _held(every)]
            worst = max((abs(score.value - score.truth) for score in tensor), default=float("nan"))
            cells += [f"{worst:.1f}"]
        else:
            cells += [""] * 6
        table.add_row(f"{row.name} {row.kind}{' images' * row.images}", *cells, _remark(row))
    console.print(table)
    _print_all(console, rows)


def _held(scores: list[Score]) -> str:
    return f"{sum(score.holds for score in scores)}/{len(scores)}"


def _remark(row: Row) -> str:
    wrong = ", ".join(
        f"{score.name} {score.half_widths_off:.1f} half widths off, trusted" for score in row.trusted_wrong
    )
    lines = f"{row.wrong_good} good for a wrong line" if row.wrong_good else ""
    return "; ".join(each for each in (row.refusal[:90], wrong, lines) if each)


def _print_all(console: Console, rows: list[Row]) -> None:
    answered = [row for row in rows if row.scores]
    scores = [score for row in answered for score in row.scores]
    console.print(f"{len(rows)} sessions, {len(answered)} answered, {sum(row.seconds for row in rows):.0f} s")
    if not scores:
        return
    errors = np.array([row.c_error for row in answered if not np.isnan(row.c_error)])
    if len(errors):
        console.print(
            f"c known: {len(errors)} sessions, error {np.median(errors):.3f} % of the size (median), "
            f"{errors.max():.2f} % at most, {sum(errors > MOST_ERROR)} above {MOST_ERROR:g} %"
        )
    for group in (*GROUPS, ""):
        mine = [score for score in scores if score.quantity.startswith(group)]
        if mine:
            held = 100 * np.mean([score.holds for score in mine])
            console.print(f"{group or 'all'}: {held:.1f} % of {len(mine)} intervals hold")
    console.print(
        f"trusted but wrong: {sum(len(row.trusted_wrong) for row in answered)}; strikes good for a wrong "
        f"line: {sum(row.wrong_good for row in answered)} of {sum(row.good for row in answered)}"
    )


def _jobs(shapes: str, kinds: str, seed: int, images: int) -> list[tuple[str, Kind, int, bool]]:
    """Sessions to run; the first `images` of each kind go through images."""
    every = names()
    chosen = every[:: max(1, len(every) // SHAPES)] if not shapes else shapes.split(",")
    chosen = every if shapes == "all" else chosen
    if unknown := set(chosen) - set(every):
        raise click.BadParameter(f"no such shapes: {', '.join(sorted(unknown))}")
    listed = [kind for kind in KINDS if kind in kinds.split(",")]
    return [(name, kind, seed, i < images) for kind in listed for i, name in enumerate(chosen)]


def _print_one(console: Console, only: str, bank: Path | None, images: bool) -> None:
    name, kind, seed = only.split(":")
    kinds: dict[str, Kind] = {each: each for each in KINDS}
    found = run_world_session(name, kinds[kind], int(seed), Bank(bank), images)
    print_rows(console, [row_of(found, Row(name, kind, int(seed), images=images))])
    trial = found.trial
    console.print(make(name, int(seed)).size_mm)
    for motion in () if trial.evidence is None else trial.evidence.motions:
        truth = trial.truths[motion.strike_id]
        went = "over" if truth.over else "back"
        console.print(
            f"  {motion.strike_id:6} {motion.verdict.value:12} went {went}; phi {np.degrees(truth.phi):.2f}"
            f" deg  {motion.reason}",
            markup=False,
        )
    for sentence in () if trial.result is None else trial.result.verdict:
        console.print(f"  {sentence}", markup=False)
    for score in row_of(found, Row(name, kind, int(seed))).scores:
        mark = "" if score.holds else f"  OUTSIDE, {score.half_widths_off:.1f} half widths"
        console.print(
            f"  {score.quantity:14} {score.name:5} {score.value:9.3f} ± {score.half:7.3f}  true "
            f"{score.truth:9.3f}  {score.status}{mark}"
        )
    console.print(trial.refusal, markup=False)


@click.command()
@click.option("--shapes", default="", help="Names separated by commas, or all; every fourth or so otherwise.")
@click.option("--kinds", default="cad,scan", show_default=True, help=f"Of {', '.join(KINDS)}.")
@click.option("--seed", default=1, show_default=True)
@click.option("--images", default=1, show_default=True, help="Sessions of each kind that go through images.")
@click.option("--bank", type=click.Path(path_type=Path), help="Folder that keeps struck motions.")
@click.option("--workers", default=2, show_default=True)
@click.option("--only", help="SHAPE:KIND:SEED of one session, printed with its truth.")
def main(**options: Any) -> None:
    """Run sessions of world shapes, and print a line for each."""
    console = Console(width=190, highlight=False, emoji=False)
    if options["only"]:
        _print_one(console, options["only"], options["bank"], bool(options["images"] > 1))
        return
    jobs = _jobs(options["shapes"], options["kinds"], options["seed"], options["images"])
    rows: dict[tuple[str, str], Row] = {}
    with ProcessPoolExecutor(options["workers"]) as pool:
        futures = {
            pool.submit(run_row, name, kind, seed, options["bank"], images): (name, kind)
            for name, kind, seed, images in jobs
        }
        for done in as_completed(futures):
            row = rows[futures[done]] = done.result()
            remark = _remark(row) or f"c to {row.c_error:.2f} % of its size"
            click.echo(
                f"{len(rows)}/{len(jobs)} {row.name} {row.kind}, {row.seconds:.0f} s: {remark}", err=True
            )
    print_rows(console, [rows[name, kind] for name, kind, _, _ in jobs])


if __name__ == "__main__":
    main()
