"""Trial of the whole answer as users give it: `make bench-honesty` (an hour on two cores).

Bodies (bodies.py) are struck in a contact simulator (struck.py), with hop, slip and bounce. Their poses
become the tracker's motions (observed.py), and these the whole answer, from descriptions (described.py) with
errors such as users make (disturbances.py). Printed are the coverage and width of the intervals, and how far
the verdict can be believed.

One cell in under a minute, and one session with its whole answer beside the truth:

    python -m tests.benchmarks.honesty --bodies sharp --disturbances radius_missing --sessions 40
    python -m tests.benchmarks.honesty --only sharp:radius_missing:1003

Sessions share specimens and struck motions, which the bank keeps in a folder; it may be deleted at any time.
"""

from __future__ import annotations

import os
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import click
from rich.console import Console
from rich.progress import Progress

from tests.benchmarks.honesty.bodies import MAKERS
from tests.benchmarks.honesty.disturbances import DISTURBANCES
from tests.benchmarks.honesty.one_session import print_session
from tests.benchmarks.honesty.scores import SessionScore, score_session
from tests.benchmarks.honesty.session import run_session
from tests.benchmarks.honesty.struck import Bank
from tests.benchmarks.honesty.tables import print_tables

CHUNK = 5
"""sessions of one cell that a process runs in turn"""
CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "percuss" / "honesty"


def run_chunk(body: str, disturbance: str, seeds: list[int], bank: Path | None) -> list[SessionScore]:
    """Scores of sessions of one cell; a session whose disturbance does not apply to the body gives none."""
    kept, found = Bank(bank), []
    for seed in seeds:
        began = time.process_time()
        try:
            trial = run_session(body, disturbance, seed, kept)
        except Exception:
            lines = traceback.format_exc().strip().splitlines()
            scored = SessionScore(body, disturbance, seed, crash=f"{lines[-1]} {lines[-3].strip()}")
        else:
            if trial is None:
                continue
            scored = score_session(trial, body, disturbance, seed)
        scored.seconds = time.process_time() - began
        found.append(scored)
    return found


def run_all(
    bodies: list[str], disturbances: list[str], seeds: list[int], bank: Path | None, workers: int
) -> Iterator[list[SessionScore]]:
    """Yield the scores of chunks as they are done."""
    chunks = [seeds[i : i + CHUNK] for i in range(0, len(seeds), CHUNK)]
    cells = [(body, name, chunk) for body in bodies for name in disturbances for chunk in chunks]
    if workers == 1:
        yield from (run_chunk(*cell, bank) for cell in cells)
        return
    with ProcessPoolExecutor(workers) as pool:
        for done in as_completed([pool.submit(run_chunk, *cell, bank) for cell in cells]):
            yield done.result()


def _names(known: dict, chosen: str) -> list[str]:
    names = list(known) if chosen == "all" else chosen.split(",")
    if unknown := set(names) - set(known):
        raise click.BadParameter(f"{', '.join(sorted(unknown))}: choose from {', '.join(known)}")
    return names


@click.command()
@click.option("--sessions", default=3040, show_default=True, help="Number of sessions, shared by all cells.")
@click.option("--seed", default=1, show_default=True)
@click.option("--bodies", default="all", show_default=True, help=f"Of {', '.join(MAKERS)}.")
@click.option("--disturbances", default="all", show_default=True, help=f"Of {', '.join(DISTURBANCES)}.")
@click.option("--bank", type=click.Path(path_type=Path), default=CACHE, show_default=True)
@click.option("--workers", default=2, show_default=True)
@click.option("--only", help="BODY:DISTURBANCE:SEED of one session, printed with its truth.")
def main(
    sessions: int, seed: int, bodies: str, disturbances: str, bank: Path, workers: int, only: str | None
) -> None:
    """Run sessions of bodies and disturbances, and print the tables."""
    console = Console(width=190, highlight=False)
    if only:
        body, disturbance, number = only.split(":")
        print_session(console, body, disturbance, int(number), Bank(bank))
        return
    chosen, errors = _names(MAKERS, bodies), _names(DISTURBANCES, disturbances)
    each = max(1, -(-sessions // (len(chosen) * len(errors))))
    seeds = [1000 * seed + i for i in range(each)]
    scores: list[SessionScore] = []
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("sessions", total=each * len(chosen) * len(errors))
        for done in run_all(chosen, errors, seeds, bank, workers):
            scores += done
            progress.update(task, completed=len(scores))
    order = {name: i for i, name in enumerate([*chosen, *errors])}
    scores.sort(key=lambda score: (order[score.disturbance], order[score.body], score.seed))
    print_tables(console, scores)


if __name__ == "__main__":
    main()
