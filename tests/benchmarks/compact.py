"""Recordings before and after `analyze compact`: `make bench-compact`.

    python -m tests.benchmarks.compact --seeds 4 --strikes 9

Sessions of the virtual rig's objects, filmed with the camera's noise and no wall clock: size, processor time
a frame, and the answer beside the original's, without loss, within the noise, and cut to what moves.
"""

from __future__ import annotations

import math
import shutil
import time
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from acquire.virtual.objects import OBJECT_NAMES
from analyze.compact.compact import CompactOptions, compact
from analyze.errors import AnalyzeError
from analyze.pipeline.estimate import estimate_evidence
from analyze.pipeline.read_evidence import read_evidence, read_head
from analyze.progress import no_progress
from tests.filmed_recording import filmed_recording

KINDS = {
    "without loss": CompactOptions(),
    "near-lossless": CompactOptions(near_lossless=True),
    "crop": CompactOptions(crop=True),
    "both": CompactOptions(near_lossless=True, crop=True),
}


@dataclass(frozen=True)
class Row:
    """One session in one coding."""

    kind: str
    share: float
    """size over the original's"""
    ms: float
    """processor time of copy and proof, a frame [ms]"""
    phi: float
    """largest change of a strike's phi [rad]"""
    k: float
    """largest relative change of a strike's k"""
    com: float
    """shift of the centre of mass [m]"""
    refused: str = ""


def answer(path: Path) -> tuple[dict[str, tuple[float, float]], np.ndarray]:
    """phi and k of each strike, and the centre of mass (3,) [m]."""
    evidence = read_evidence(read_head(path))
    fits = {each.strike_id: (each.fit.phi, each.fit.k or math.nan) for each in evidence.motions if each.fit}
    return fits, estimate_evidence(evidence).inertial.com.position


def rows_of(source: Path, frames: int) -> list[Row]:
    """One session in all codings."""
    before, com = answer(source)
    size, found = source.stat().st_size, list[Row]()
    for kind, options in KINDS.items():
        path = source.with_name("copy.mcap")
        shutil.copy(source, path)
        begun = time.process_time()
        try:
            list(compact(path, options, no_progress))
        except AnalyzeError as error:
            found.append(Row(kind, 1.0, math.nan, math.nan, math.nan, math.nan, str(error)))
            continue
        ms = 1e3 * (time.process_time() - begun) / frames
        after, its_com = answer(path)
        phi = max(abs(after[name][0] - one[0]) for name, one in before.items())
        k = max(abs(after[name][1] / one[1] - 1) for name, one in before.items())
        found.append(Row(kind, path.stat().st_size / size, ms, phi, k, float(np.linalg.norm(its_com - com))))
        path.unlink()
    return found


@click.command()
@click.option("--seeds", default=4, show_default=True, help="Seeds of each object.")
@click.option("--objects", default=",".join(OBJECT_NAMES), show_default=True, help="Comma-separated.")
@click.option("--strikes", default=9, show_default=True, help="Strikes of a session.")
def main(seeds: int, objects: str, strikes: int) -> None:
    """Film, compact and estimate the sessions, and print the table."""
    rows: list[Row] = []
    cases = list(product(objects.split(","), range(1, seeds + 1)))
    for name, seed in track(cases, "sessions", console=Console(stderr=True), transient=True):
        with TemporaryDirectory() as folder:
            path = Path(folder) / "session.mcap"
            filmed_recording(path, name, seed, strikes)
            rows += rows_of(path, path.stat().st_size // (656 * 492))
    table = Table(title=f"{len(cases)} sessions of {strikes} strikes", title_justify="left")
    for heading in (
        "coding", "sessions", "refused", "size, %", "largest", "ms/frame", "phi, deg, median", "largest",
        "k, %, median", "largest", "c, mm, largest",
    ):  # fmt: skip
        table.add_column(heading)
    for kind in KINDS:
        mine = [row for row in rows if row.kind == kind]
        kept = [row for row in mine if not row.refused]
        share, phi, k = (np.array([getattr(row, each) for row in kept]) for each in ("share", "phi", "k"))
        table.add_row(
            kind, str(len(mine)), str(len(mine) - len(kept)),
            f"{100 * np.median(share):.1f}", f"{100 * share.max():.1f}",
            f"{np.median([row.ms for row in kept]):.1f}",
            f"{math.degrees(np.median(phi)):.4f}", f"{math.degrees(phi.max()):.4f}",
            f"{100 * np.median(k):.4f}", f"{100 * k.max():.4f}",
            f"{1e3 * max(row.com for row in kept):.4f}",
        )  # fmt: skip
    console = Console(width=180, highlight=False)
    console.print(table)
    for reason in sorted({row.refused for row in rows if row.refused}):
        console.print(reason)


if __name__ == "__main__":
    main()
