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
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress

from tests.benchmarks.honesty.bodies import MAKERS
from tests.benchmarks.honesty.described import DRAWS
from tests.benchmarks.honesty.disturbances import DISTURBANCES
from tests.benchmarks.honesty.one_session import print_session
from tests.benchmarks.honesty.scores import SessionScore, score_session
from tests.benchmarks.honesty.session import run_session
from tests.benchmarks.honesty.stored_scores import append_scores, read_scores
from tests.benchmarks.honesty.struck import Bank
from tests.benchmarks.honesty.tables import print_tables

CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "percuss" / "honesty"


def run_chunk(
    body: str, disturbance: str, seeds: list[int], bank: Path | None, images: bool
) -> list[SessionScore]:
    """Scores of sessions of one cell; a session whose disturbance does not apply to the body gives none."""
    kept, found = Bank(bank), []
    for seed in seeds:
        began = time.process_time()
        try:
            trial = run_session(body, disturbance, seed, kept, images)
        except Exception:
            # A crash is a result of the trial.
            lines = traceback.format_exc().strip().splitlines()
            scored = SessionScore(body, disturbance, seed, crash=f"{lines[-1]} {lines[-3].strip()}")
        else:
            if trial is None:
                continue
            scored = score_session(trial, body, disturbance, seed)
        scored.seconds, scored.images = time.process_time() - began, images
        found.append(scored)
    return found


def run_all(
    cells: list[tuple[str, str, list[int], bool]], bank: Path | None, workers: int
) -> Iterator[list[SessionScore]]:
    """Yield the scores of cells (body, disturbance, seeds, with images) as they are done."""
    if workers == 1:
        yield from (run_chunk(*cell[:3], bank, cell[3]) for cell in cells)
        return
    with ProcessPoolExecutor(workers) as pool:
        for done in as_completed([pool.submit(run_chunk, *cell[:3], bank, cell[3]) for cell in cells]):
            yield done.result()


def _cells(
    bodies: list[str], disturbances: list[str], seeds: list[int], images: float, done: set[str]
) -> list[tuple[str, str, list[int], bool]]:
    """Cells that are not done yet; sessions of a cell share their description.

    The first seeds of each cell go through images, as many as the share `images` of all sessions requires.
    """
    cells = [(body, name) for body in bodies for name in disturbances]
    count = round(images * len(cells) * len(seeds))
    found: list[tuple[str, str, list[int], bool]] = []
    for number, (body, name) in enumerate(cells):
        drawn = count // len(cells) + (number < count % len(cells))
        left = [seed for seed in seeds if f"{body}:{name}:{seed}" not in done]
        found += [(body, name, [seed], True) for seed in left if seed in seeds[:drawn]]
        for draw in range(DRAWS):
            mine = [seed for seed in left if seed % DRAWS == draw and seed not in seeds[:drawn]]
            found += [(body, name, mine, False)] if mine else []
    return found


def _names(known: dict, chosen: str) -> list[str]:
    names = list(known) if chosen == "all" else chosen.split(",")
    if unknown := set(names) - set(known):
        raise click.BadParameter(f"{', '.join(sorted(unknown))}: choose from {', '.join(known)}")
    return names


@click.command()
@click.option("--sessions", default=3200, show_default=True, help="Number of sessions, shared by all cells.")
@click.option("--seed", default=1, show_default=True)
@click.option("--bodies", default="all", show_default=True, help=f"Of {', '.join(MAKERS)}.")
@click.option("--disturbances", default="all", show_default=True, help=f"Of {', '.join(DISTURBANCES)}.")
@click.option("--bank", type=click.Path(path_type=Path), default=CACHE, show_default=True)
@click.option("--workers", default=2, show_default=True)
@click.option("--images", default=0.0, show_default=True, help="Share of sessions that go through images.")
@click.option(
    "--scores",
    type=click.Path(path_type=Path),
    help="File to which scores are appended; sessions in it are not run again, but counted.",
)
@click.option("--only", help="BODY:DISTURBANCE:SEED of one session, printed with its truth.")
def main(**options: Any) -> None:
    """Run sessions of bodies and disturbances, and print the tables."""
    console, bank, images = (
        Console(width=215, highlight=False, emoji=False),
        options["bank"],
        options["images"],
    )
    if options["only"]:
        print_session(console, options["only"], Bank(bank), images > 0)
        return
    bodies, disturbances = _names(MAKERS, options["bodies"]), _names(DISTURBANCES, options["disturbances"])
    each = max(1, -(-options["sessions"] // (len(bodies) * len(disturbances))))
    found = read_scores(options["scores"])
    seeds = [1000 * options["seed"] + i for i in range(each)]
    cells = _cells(bodies, disturbances, seeds, images, {session.cell for session in found})
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("sessions", total=sum(len(cell[2]) for cell in cells))
        for done in run_all(cells, bank, options["workers"]):
            found += done
            append_scores(options["scores"], done)
            progress.advance(task, len(done))
    order = {name: i for i, name in enumerate([*MAKERS, *DISTURBANCES])}
    found.sort(key=lambda session: (order[session.disturbance], order[session.body], session.seed))
    print_tables(console, found)


if __name__ == "__main__":
    main()
