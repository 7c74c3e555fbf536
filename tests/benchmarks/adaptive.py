"""Sessions that stop themselves, beside nine fixed strikes (`make bench-adaptive`).

    python -m tests.benchmarks.adaptive --bodies sharp,mixed --seeds 10 --until 0.5,1

Each session draws the errors of a rig (tilt, scan, places of tags, lens, mass, rest poses) that the user
states, and strikes a body in a contact simulator. After every strike the answer so far decides what comes
next. A strike without a good verdict is repeated, in both kinds of session. Compared are the strikes and
placements until the target is met, and whether the 95 % intervals hold at that moment.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from analyze.errors import EstimationError
from analyze.estimation.inertia import shape_prior
from analyze.estimation.joint import MomentModel
from analyze.estimation.priors import ComPrior
from analyze.pipeline.equiplanes import systematic_errors
from analyze.pipeline.estimate import EstimateOptions
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.frame_rate import stated_scale
from analyze.pipeline.next_strike import Progress, Target, choose_strike, reached, stopping_checks
from analyze.pipeline.solved import SolvedStrikes, body_cells, solve_strikes
from analyze.pipeline.strike_forecast import strike_forecast
from schemas.edge_names import edge_names
from schemas.strike_result import Verdict
from tests.benchmarks.honesty.bodies import MAKERS
from tests.benchmarks.honesty.described import DRAWS, description
from tests.benchmarks.honesty.disturbances import DISTURBANCES
from tests.benchmarks.honesty.session import SPECIMENS, StruckSession, session_evidence, specimen
from tests.benchmarks.honesty.struck import Bank

BODIES = ("sharp", "mixed", "foot", "can", "hammer")
ERRORS = "all_mild"
"""name of the disturbance that draws the errors of a rig"""
MAX_STRIKES = 24
FIXED = 9
MAX_ATTEMPTS = 4
"""largest number of attempts of one strike, as in a session"""
FAR = 2.0
"""half widths from which on a value at the end is a confident wrong answer"""


@dataclass(frozen=True)
class How:
    """Errors that are drawn, and how strikes are made."""

    errors: str = ERRORS
    """name of the disturbance"""
    images: bool = False
    """True to draw images of every strike and track their tags"""
    bank: Path | None = None
    """folder that keeps struck motions"""


@dataclass
class Run:
    """One session: strikes and placements until it ended, and what it then stated."""

    body: str
    seed: int
    kind: str
    """"fixed" or "adaptive" """
    target: float
    """half width of the centre of mass that is asked for [m]"""
    strikes: int = 0
    """strikes made, good or not"""
    placements: int = 0
    """times that the object was put down"""
    met: bool = False
    """True if the target was met, with all checks"""
    ending: str = ""
    half: float = math.inf
    """half width of the centre of mass at the end [m]"""
    off: list[float] = field(default_factory=list)
    """errors of the coordinates of c over their half widths"""
    error: float = math.nan
    """distance of the stated centre of mass from the true one [m]"""
    slowest: float = 0.0
    """largest CPU time of an answer and choice [s]"""


class Session:
    """Session of one body, struck as it is told; its answer so far after every strike."""

    def __init__(self, body: str, seed: int, how: How) -> None:
        disturbance = DISTURBANCES[how.errors]
        self._disturbance = disturbance
        self.made = specimen(body, seed % SPECIMENS)
        described = description(body, disturbance, seed % DRAWS)
        if described is None:
            raise ValueError(f"{body}: the errors of {how.errors} do not apply")
        self.described = described
        self._seed = (0xADA7, seed, list(MAKERS).index(body))
        self.struck = StruckSession(
            described, self.made, (disturbance, how.images), Bank(how.bank), np.random.default_rng(self._seed)
        )
        self.plan = described.plan.strikes
        self.names = edge_names(self.plan)

    def evidence(self) -> Evidence:
        """Evidence of the strikes so far; mass and statements are the same at every call."""
        rng = np.random.default_rng((*self._seed, 1))
        return session_evidence(self.described, self.made, self._disturbance, list(self.struck.motions), rng)

    def solved(self) -> SolvedStrikes | None:
        """Joint solution of the strikes so far; None if they are too few."""
        try:
            return solve_strikes(self.evidence(), EstimateOptions())
        except EstimationError:
            return None


def score(run: Run, session: Session, solved: SolvedStrikes | None) -> None:
    """Write into `run` how the answer of a session compares with the truth."""
    if solved is None:
        return
    com = solved.inertial.com
    run.half = reached(solved).com
    off = com.position - session.made.com
    run.error = float(np.linalg.norm(off))
    run.off = (np.abs(off) / (1.96 * np.sqrt(np.diag(com.covariance)))).tolist()


def fixed(body: str, seed: int, target: float, how: How) -> Run:
    """Nine planned strikes in the plan's order, each repeated until it is good."""
    run, session = Run(body, seed, "fixed", target), Session(body, seed, how)
    stands = False
    for strike in session.plan[:FIXED]:
        for _ in range(MAX_ATTEMPTS):
            run.placements += not stands
            motion = session.struck.strike(strike)
            run.strikes += 1
            stands = motion is not None and motion.verdict is Verdict.ROCKED_BACK
            if motion is not None and motion.verdict is Verdict.GOOD:
                break
        stands = False
    solved = session.solved()
    score(run, session, solved)
    if solved is not None:
        run.met = reached(solved).meets(Target(target)) and all(
            each.passed for each in stopping_checks(solved)
        )
    return run


def adaptive(body: str, seed: int, target: float, how: How) -> Run:
    """Session that chooses every strike by the answer so far, and ends when the target is met."""
    run, session = Run(body, seed, "adaptive", target), Session(body, seed, how)
    aim, last, stands = Target(target), None, False
    first = session.evidence()
    cells = body_cells(first.spec, first.model)
    problem = (
        systematic_errors(first),
        ComPrior.from_bounds(*first.model.bounds),
        MomentModel(stated_scale(first), shape_prior(cells)),
    )
    excluded: set[str] = set()
    failures: dict[str, int] = defaultdict(int)
    solved = None
    while True:
        began = time.process_time()
        solved = session.solved()
        if solved is not None and reached(solved).meets(aim):
            checks = stopping_checks(solved)
            if all(each.passed for each in checks):
                run.met, run.ending = True, "met"
                break
        used = 0 if solved is None else len(solved.used)
        progress = Progress(MAX_STRIKES - run.strikes, used, last, stands, frozenset(excluded), failures)
        forecast = strike_forecast(session.evidence(), session.plan, problem, solved)
        choice = choose_strike(forecast, aim, progress, session.names)
        run.slowest = max(run.slowest, time.process_time() - began)
        if choice.strike is None or choice.obstacle:
            failed = (
                [] if solved is None else [each.text for each in stopping_checks(solved) if not each.passed]
            )
            run.ending = "; ".join([choice.obstacle, *failed])
            break
        again = stands and last is not None and choice.strike.axis_id == last.axis_id
        run.placements += not again
        motion = session.struck.strike(choice.strike)
        run.strikes += 1
        last, stands = choice.strike, motion is not None and motion.verdict is Verdict.ROCKED_BACK
        if motion is None or motion.verdict not in (Verdict.GOOD, Verdict.ROCKED_BACK):
            failures[choice.strike.id] += 1
            if failures[choice.strike.id] >= MAX_ATTEMPTS:
                excluded.add(choice.strike.id)
    score(run, session, solved)
    return run


def run_one(task: tuple[str, str, int, float, How]) -> Run:
    """Session of one kind, body, seed and target."""
    kind, body, seed, target, how = task
    return (adaptive if kind == "adaptive" else fixed)(body, seed, target, how)


def table(runs: list[Run], errors: str) -> Table:
    """Table of all sessions, one row per target, body and kind."""
    shown = Table(box=SIMPLE_HEAD, title=f"sessions with the errors of {errors}")
    for name in (
        "target mm",
        "body",
        "kind",
        "met",
        "strikes",
        "worst",
        "placements",
        "error mm",
        "c holds %",
        "far",
    ):
        shown.add_column(name, justify="left" if name in ("body", "kind") else "right")
    rows: dict[tuple[float, str, str], list[Run]] = defaultdict(list)
    for run in runs:
        rows[run.target, run.body, run.kind].append(run)
        rows[run.target, "all", run.kind].append(run)
    for (target, body, kind), group in sorted(rows.items()):
        met = [run for run in group if run.met]
        off = np.array([value for run in met for value in run.off])
        shown.add_row(
            f"{1e3 * target:g}",
            body,
            kind,
            f"{len(met)}/{len(group)}",
            f"{np.median([run.strikes for run in met]):g}" if met else "",
            f"{max(run.strikes for run in met)}" if met else "",
            f"{np.median([run.placements for run in met]):g}" if met else "",
            f"{1e3 * np.median([run.error for run in met]):.2f}" if met else "",
            f"{100 * np.mean(off <= 1):.1f}" if met else "",
            str(int(np.sum(off > FAR))) if met else "",
        )
    return shown


@click.command()
@click.option("--bodies", default=",".join(BODIES), show_default=True, help="Bodies, with commas.")
@click.option("--seeds", default=10, show_default=True, help="Number of seeds.")
@click.option("--first-seed", default=0, show_default=True, help="First seed.")
@click.option("--until", default="0.5,1", show_default=True, help="Targets [mm], with commas.")
@click.option("--errors", default=ERRORS, show_default=True, help="Disturbance of bench-honesty to draw.")
@click.option("--images", is_flag=True, help="Draw images of every strike and track their tags.")
@click.option("--bank", type=click.Path(path_type=Path), help="Folder that keeps struck motions.")
@click.option("--jobs", default=2, show_default=True)
def main(bodies: str, seeds: int, first_seed: int, until: str, jobs: int, **given: Any) -> None:
    """Compare sessions that stop themselves with nine fixed strikes."""
    how, errors = How(**given), given["errors"]
    tasks = [
        (kind, body, seed, 1e-3 * float(target), how)
        for target in until.split(",")
        for body in bodies.split(",")
        for seed in range(first_seed, first_seed + seeds)
        for kind in ("fixed", "adaptive")
    ]
    with ProcessPoolExecutor(jobs) as pool:
        runs = list(pool.map(run_one, tasks))
    console = Console(width=120)
    console.print(table(runs, errors))
    for run in runs:
        if not run.met or max(run.off, default=0.0) > 1.5:
            worst = max(run.off, default=math.nan)
            console.print(
                f"{run.kind} {run.body}:{run.seed} to {1e3 * run.target:g} mm: {run.strikes} strikes, "
                f"± {1e3 * run.half:.2f} mm, off {1e3 * run.error:.2f} mm, {worst:.1f} half widths; "
                f"{run.ending}",
                markup=False,
            )
    console.print(f"slowest answer and choice: {max(run.slowest for run in runs):.2f} s of CPU")


if __name__ == "__main__":
    main()
