"""Trial of the tests of rigidity: `make bench-contents` (fifteen minutes on two cores).

Closed boxes with something inside that stays or moves (bodies.py, moving.py) are struck in a simulation of
their own (planar.py), with hop, slip and rounded edges. The motions are seen with noise (sessions.py), and go
through the real motion analysis and the whole answer (scores.py). Printed are false alarms, what was found by
content and amount, and how often the answer trusts a wrong centre of mass.

A small run, and the sessions of one cell:

    python -m tests.benchmarks.contents --rigid 20 --each 3 --contained 1
    python -m tests.benchmarks.contents --rows "powder 10 %" --each 10

Five rows are sessions of a box of `make bench-honesty` in MuJoCo, planned by `analyze plan --contents`
(contained.py), six of objects of the virtual rig with its own contents (on_rig.py); of these and of most
rigid boxes only the tests are scored, not the whole answer.
"""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from tests.benchmarks.contents.bodies import Contents, Kind, draw_box
from tests.benchmarks.contents.contained import INSIDES, contained_evidence
from tests.benchmarks.contents.on_rig import FILLED, rig_evidence
from tests.benchmarks.contents.scores import Score, score_session, score_tests
from tests.benchmarks.contents.sessions import (
    TEST_ENERGIES,
    draw_session,
    lanes_of,
    session_evidence,
    simulate_sessions,
)

CHUNK = 8
"""sessions that are simulated together"""
SHARES = (0.02, 0.05, 0.1, 0.2, 0.4)
"""shares of liquid and powder in the mass"""
LUMPS = ((0.1, 0.3), (0.3, 0.45))
"""ranges of the friction of a lump on its floor"""
LUMP_SHARES = (0.05, 0.1, 0.2)
WHOLE_EACH = 5
"""one rigid session in so many has its whole answer"""
RIGID = "nothing moves"
USUAL = "usual plan: "
"""beginning of the rows of sessions without a fast strike"""
USUALLY_STRUCK = ("liquid, level 20 %", "powder 20 %", "loose lump 10 %, µ 0.1 to 0.3")
USUAL_ENERGIES = (1.1, 1.15, 1.2)
"""energy ratios of their strikes on the first edge"""
IN_MUJOCO = "in MuJoCo: "
"""beginning of the rows of contained.py"""
ON_RIG = "on the rig: "
"""beginning of the rows of on_rig.py"""
Task = tuple[str, list[int]]
"""Row and seeds of some sessions."""
LEAST_PROMISED = 20
"""fewest sessions from which the share of kept promises is printed"""


def cells() -> dict[str, Contents]:
    """Contents by the name of their row: rigid boxes first, then by content and amount."""
    found = {RIGID: Contents(Kind.NOTHING)}
    for kind in (Kind.LIQUID, Kind.PENDULUM, Kind.POWDER):
        found |= {f"{kind.value} {100 * share:.0f} %": Contents(kind, share) for share in SHARES}
    for low, high in LUMPS:
        for share in LUMP_SHARES:
            name = f"{Kind.LUMP.value} {100 * share:.0f} %, µ {low:g} to {high:g}"
            found[name] = Contents(Kind.LUMP, share, (low, high))
    return found | {USUAL + name: found[name] for name in USUALLY_STRUCK}


def run_chunk(cell: str, seeds: list[int]) -> list[Score]:
    """Draw, strike, analyse and score sessions of one row."""
    if cell.startswith(IN_MUJOCO):
        inside = next(each for each in INSIDES if IN_MUJOCO + each.name == cell)
        return [score_tests(cell, seed, contained_evidence(inside, seed)) for seed in seeds]
    if cell.startswith(ON_RIG):
        name = cell.removeprefix(ON_RIG)
        return [score_tests(cell, seed, rig_evidence(name, seed)) for seed in seeds]
    contents = cells()[cell]
    energies = USUAL_ENERGIES if cell.startswith(USUAL) else TEST_ENERGIES
    sessions = [
        draw_session(
            draw_box(contents, np.random.default_rng((0xB0C5, *cell.encode(), seed))), seed, energies
        )
        for seed in seeds
    ]
    courses, first, found = simulate_sessions(sessions), 0, []
    for session in sessions:
        # That a rigid body is trusted as before needs fewer sessions than the share of false alarms.
        evidence = session_evidence(session, courses, first)
        if cell != RIGID or session.seed % WHOLE_EACH == 0:
            found.append(score_session(cell, session, evidence))
        else:
            found.append(score_tests(cell, session.seed, evidence))
        first += lanes_of(session)
    return found


def read_score(line: str) -> Score:
    """Score of a session, as `--scores` keeps it."""
    return Score(**json.loads(line))


def print_tables(console: Console, scores: list[Score]) -> None:
    """Print what was found by content and amount, and what the answer promises and trusts."""
    table = Table(title="Is it rigid? Answers by what the box holds")
    for name in (
        "contents",
        "sessions",
        "refused",
        "not rigid",
        "by energies",
        "by poses",
        "nothing moves",
        "not tested",
        "wrong c trusted before",
        "now",
    ):
        table.add_column(name, justify="left" if name == "contents" else "right")
    for cell in dict.fromkeys(each.cell for each in scores):
        mine = [each for each in scores if each.cell == cell]
        answered = [each for each in mine if each.answer != "refused"]
        table.add_row(
            cell,
            str(len(mine)),
            str(len(mine) - len(answered)),
            _percent([each.answer == "not_rigid" for each in answered]),
            _percent([each.by_energies for each in answered]),
            _percent([each.by_poses for each in answered]),
            _percent([each.answer == "nothing_moves" for each in answered]),
            _percent([each.answer == "not_tested" for each in answered]),
            str(sum(each.trusted_before and each.wrong for each in answered)),
            str(sum(each.trusted and each.wrong for each in answered)),
        )
    console.print(table)
    rigid = [each for each in scores if each.cell == RIGID and each.answer != "refused"]
    if rigid:
        alarms = sum(each.answer == "not_rigid" for each in rigid)
        whole = [each for each in rigid if each.whole]
        trusted, before = sum(each.trusted for each in whole), sum(each.trusted_before for each in whole)
        shares = 100 * np.array([min(each.share, 1.0) for each in rigid])
        console.print(
            f"rigid: {alarms} false alarms of {len(rigid)}; of {len(whole)} whole answers c is trusted in"
            f" {trusted}, before in {before}; stated smallest share: median {np.median(shares):.0f} %, nine"
            f" of ten below {np.quantile(shares, 0.9):.0f} %"
        )
    liquid = [each for each in scores if each.cell.startswith("liquid") and each.answer != "refused"]
    promised = [each for each in liquid if _share(each.cell) > each.share]
    if len(promised) >= LEAST_PROMISED:
        found = np.mean([each.answer == "not_rigid" for each in promised])
        console.print(f"liquid above the smallest share that its session states: {100 * found:.0f} % found")


def _share(cell: str) -> float:
    return float(cell.rpartition(" %")[0].rpartition(" ")[2]) / 100


def _percent(values: list[bool]) -> str:
    return f"{100 * np.mean(values):.0f} %" if values else "–"


def _tasks(names: list[str], counts: dict[str, int], seed: int, done: set[tuple[str, int]]) -> list[Task]:
    """Chunks of sessions that are not done yet, by row."""
    found: list[Task] = []
    for name in names:
        seeds = [1000 * seed + i for i in range(counts.get(name, counts[""]))]
        left = [each for each in seeds if (name, each) not in done]
        found += [(name, left[i : i + CHUNK]) for i in range(0, len(left), CHUNK)]
    return found


@click.command()
@click.option("--rigid", default=320, show_default=True, help="Number of rigid boxes.")
@click.option("--each", default=8, show_default=True, help="Number of boxes of every other row.")
@click.option(
    "--contained", default=4, show_default=True, help="Sessions of every row in MuJoCo and on the rig."
)
@click.option("--seed", default=1, show_default=True)
@click.option("--rows", "chosen", default="all", show_default=True, help="Rows, separated by semicolons.")
@click.option("--workers", default=2, show_default=True)
@click.option(
    "--scores",
    "kept",
    type=click.Path(path_type=Path),
    help="File to which scores are appended; sessions in it are not run again, but counted.",
)
def main(
    rigid: int, each: int, contained: int, seed: int, chosen: str, workers: int, kept: Path | None
) -> None:
    """Run sessions of every content and amount, and print the tables."""
    few = [*(IN_MUJOCO + inside.name for inside in INSIDES), *(ON_RIG + filled for filled in FILLED)]
    known = [*cells(), *few]
    names = known if chosen == "all" else chosen.split(";")
    if unknown := set(names) - set(known):
        raise click.BadParameter(f"{', '.join(sorted(unknown))}: choose from {'; '.join(known)}")
    counts = {"": each, RIGID: rigid} | dict.fromkeys(few, contained)
    scores = [] if kept is None or not kept.exists() else [read_score(line) for line in kept.open()]
    tasks = _tasks(names, counts, seed, {(score.cell, score.seed) for score in scores})
    with ProcessPoolExecutor(workers) as pool, Progress(console=Console(stderr=True), transient=True) as bar:
        shown = bar.add_task("sessions", total=sum(len(task[1]) for task in tasks))
        for made in as_completed([pool.submit(run_chunk, *task) for task in tasks]):
            scores += made.result()
            bar.advance(shown, len(made.result()))
            if kept is not None:
                with kept.open("a") as file:
                    file.writelines(json.dumps(asdict(score)) + "\n" for score in made.result())
    scores = sorted(
        (score for score in scores if score.cell in names),
        key=lambda score: (names.index(score.cell), score.seed),
    )
    print_tables(Console(width=170, highlight=False, emoji=False), scores)


if __name__ == "__main__":
    main()
