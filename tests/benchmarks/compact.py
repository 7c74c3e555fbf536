"""Recordings before and after `analyze compact`: `make bench-compact`.

    python -m tests.benchmarks.compact --seeds 4 --strikes 9

Sessions of the virtual rig's objects, filmed with the camera's noise and no wall clock: size, processor time
a frame, and the answer beside the original's, without loss, within the noise, and cut to what moves. With
--rounded also what rounding every pixel by a step of so many standard deviations of the noise costs. With
--footage PATH real footage instead (compact_footage.py).
"""

from __future__ import annotations

import json
import math
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

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
from tests.benchmarks.compact_footage import print_footage
from tests.benchmarks.print_sessions import ROADS
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


@contextmanager
def rounding(step_sd: float) -> Iterator[None]:
    """Round every pixel instead, by this step over the noise, and refuse no change."""

    def rounded(image: np.ndarray, noise_sd: float, *_: object) -> np.ndarray:
        step = max(step_sd * noise_sd, 1.0)
        return np.clip(np.rint(np.rint(image / step) * step), 0, 255).astype(np.uint8)

    with ExitStack() as stack:
        stack.enter_context(patch("analyze.compact.images.within_noise", rounded))
        for limit in ("MAX_CHANGE_SDS", "MAX_SD_CHANGE", "AIMED_PHI", "AIMED_K"):
            stack.enter_context(patch(f"analyze.compact.strikes.{limit}", math.inf))
        yield


def rows_of(source: Path, frames: int, kinds: Sequence[str], rounded: Sequence[float]) -> list[Row]:
    """One session in all codings."""
    original, com = answer(source)
    codings = {kind: (KINDS[kind], nullcontext()) for kind in kinds}
    codings |= {f"all pixels by {step:g} sd, crop": (KINDS["both"], rounding(step)) for step in rounded}
    size, found = source.stat().st_size, list[Row]()
    for kind, (options, patched) in codings.items():
        path = source.with_name("copy.mcap")
        shutil.copy(source, path)
        begun = time.process_time()
        try:
            with patched:
                list(compact(path, options, no_progress))
        except AnalyzeError as error:
            found.append(Row(kind, 1.0, math.nan, math.nan, math.nan, math.nan, str(error)))
            continue
        ms = 1e3 * (time.process_time() - begun) / frames
        compacted, compacted_com = answer(path)
        phi = max(abs(compacted[name][0] - one[0]) for name, one in original.items())
        k = max(abs(compacted[name][1] / one[1] - 1) for name, one in original.items())
        shift = float(np.linalg.norm(compacted_com - com))
        found.append(Row(kind, path.stat().st_size / size, ms, phi, k, shift))
        path.unlink()
    return found


@click.command()
@click.option("--seeds", default=4, show_default=True, help="Seeds of each object.")
@click.option("--objects", default=",".join(OBJECT_NAMES), show_default=True, help="Comma-separated.")
@click.option("--strikes", default=9, show_default=True, help="Strikes of a session.")
@click.option("--road", type=click.Choice(ROADS), default="tags", show_default=True, help="Tags, or print.")
@click.option(
    "--footage",
    type=click.Path(exists=True, path_type=Path),
    multiple=True,
    help="Instead: a video, a folder of images, or a recording.",
)
@click.option("--codings", default=",".join(KINDS), show_default=True, help="Comma-separated.")
@click.option("--rounded", type=float, multiple=True, help="Round all pixels by this many sds of the noise.")
@click.option(
    "--json", "json_path", type=click.Path(path_type=Path), help="Also append the rows, as JSON lines."
)
def main(
    seeds: int,
    objects: str,
    strikes: int,
    road: str,
    footage: tuple[Path, ...],
    codings: str,
    rounded: tuple[float, ...],
    json_path: Path | None,
) -> None:
    """Film, compact and estimate the sessions, and print the table."""
    if footage:
        print_footage(footage)
        return
    rows: list[Row] = []
    cases = list(product(objects.split(","), range(1, seeds + 1)))
    for name, seed in track(cases, "sessions", console=Console(stderr=True), transient=True):
        with TemporaryDirectory() as folder:
            path = Path(folder) / "session.mcap"
            filmed_recording(path, name, seed, strikes, road)
            found = rows_of(path, path.stat().st_size // (656 * 492), codings.split(","), rounded)
        rows += found
        if json_path is not None:
            with json_path.open("a", encoding="utf-8") as lines:
                lines.writelines(
                    f"{json.dumps({'object': name, 'seed': seed, **asdict(row)})}\n" for row in found
                )
    table = Table(title=f"{len(cases)} sessions of {strikes} strikes", title_justify="left")
    for heading in (
        "coding", "sessions", "refused", "size, %", "largest", "ms/frame", "phi, deg, median", "largest",
        "k, %, median", "largest", "c, mm, largest",
    ):  # fmt: skip
        table.add_column(heading)
    for kind in dict.fromkeys(row.kind for row in rows):
        mine = [row for row in rows if row.kind == kind]
        kept = [row for row in mine if not row.refused]
        if not kept:
            table.add_row(kind, str(len(mine)), str(len(mine)))
            continue
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
