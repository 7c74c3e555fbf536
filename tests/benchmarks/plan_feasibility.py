"""Predicted lift and slip against the virtual rig's physics: `make bench-plan-feasibility`.

Every edge of every face that the object stands on is struck at four energies on four frictions. 40 % of the
strikes are placed wrongly on purpose (lowest, middle or highest point of the face), so that all outcomes
occur. Prints the confusion table and the kinds of misclassified strikes.
"""

from __future__ import annotations

from collections import Counter

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from analyze.planning import feasibility
from tests.analyze.planning.simulated_strikes import (
    SLID,
    Bench,
    G,
    Seen,
    Trial,
    bench,
    predicted,
    strike,
    trials,
)

ENERGIES = (1.05, 1.3, 2.0, 3.0)
FRICTIONS = (0.2, 0.4, 0.6, 0.8)
OUTCOMES = ("holds", "slips", "lifts")
NEAR = 2.0
"""factor between predicted and true slip, on either side of the limit, within which a miss is a matter of
degree"""


@click.command()
@click.option("--objects", default="carton,spray,juice,salt", show_default=True)
@click.option("--share", default=1.0, show_default=True, help="Fraction of the strikes that is carried out.")
@click.option("--seed", default=1, show_default=True)
def main(objects: str, share: float, seed: int) -> None:
    """Compare predicted lift and slip of strikes with the virtual rig's physics, and print the result."""
    console, rng = Console(width=150), np.random.default_rng(seed)
    rows: list[tuple[str, Trial, str, float, Seen]] = []
    for name in objects.split(","):
        on = bench(name, seed)
        chosen = [trial for trial in trials(on, ENERGIES, FRICTIONS, 0.4, rng) if rng.random() < share]
        rows += _carried_out(name, on, chosen)
    for title, some in (
        ("all strikes", rows),
        (
            "struck where the planner would, E up to 1.3",
            [r for r in rows if r[1].planned and r[1].energy <= 1.3],
        ),
    ):
        table = Table(title=f"{title}: {len(some)}; rows: in the physics, columns: predicted")
        for heading in ("", *OUTCOMES):
            table.add_column(heading, justify="right")
        counts = Counter((seen.outcome, expected) for _, _, expected, _, seen in some)
        for truth in OUTCOMES:
            table.add_row(truth, *(str(counts[truth, expected]) for expected in OUTCOMES))
        console.print(table)
        fails = sum((seen.outcome == "holds") == (expected == "holds") for _, _, expected, _, seen in some)
        console.print(
            f"holds or not: {fails} of {len(some)} right ({100 * fails / max(len(some), 1):.1f} %)",
            highlight=False,
        )
    console.print("off the diagonal:")
    for reason, many in Counter(_why(row) for row in rows if row[2] != row[4].outcome).most_common():
        console.print(f"  {many:4d} {reason}", highlight=False)


def _carried_out(name: str, on: Bench, chosen: list[Trial]) -> list[tuple[str, Trial, str, float, Seen]]:
    tips = feasibility.simulate_tips([trial.case for trial in chosen], G)
    found: list[tuple[str, Trial, str, float, Seen]] = []
    for i, trial in enumerate(track(chosen, description=name, console=Console(stderr=True), transient=True)):
        seen = strike(on, trial)
        if seen is not None:
            found.append((name, trial, predicted(tips, i), float(tips.slip[i]), seen))
    return found


def _why(row: tuple[str, Trial, str, float, Seen]) -> str:
    """Kind, in words, of a strike whose outcome was predicted wrongly: prediction, outcome, and cause."""
    _, trial, expected, slip, seen = row
    if seen.outcome == "lifts":
        return f"{expected}, lifts: pushed from under its edge (struck low) or thrown; both are refused alike"
    if expected == "lifts":
        return f"lifts, {seen.outcome}: the load is nearly gone, for less time than it takes to rise"
    limit = "holds, slips" if expected == "holds" else "slips, holds"
    if max(slip, 1e-9) * NEAR > seen.slip > slip / NEAR or (max(slip, seen.slip) < NEAR * SLID):
        small = f"{1000 * NEAR * SLID:.0f} mm"
        return f"{limit}: a matter of degree, both slips within a factor of two or below {small}"
    if trial.axis.rolls:
        return f"{limit}: a round rim, which turns and rolls sideways"
    if abs(trial.case.beside) > 0.1 * (trial.case.high - trial.case.low):
        return f"{limit}: c stands beside the strike by more than a tenth of the edge: it yaws"
    return f"{limit}: other"


if __name__ == "__main__":
    main()
