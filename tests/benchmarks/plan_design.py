"""Our planned strikes compared with the paper's on random bodies: `make bench-plan` (five minutes).

Convex and other bodies, random masses inside, angle noise 0.3 degrees, edge noise 0.3 mm, nine strikes each.
Prints how many of the paper's sets are singular, how many of ours, and the median errors of c for bodies on
which both have an answer.
"""

from __future__ import annotations

from collections import Counter

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from tests.analyze.planning.comparison import Compared, Outcome, compare
from tests.analyze.planning.random_bodies import KINDS, random_body


@click.command()
@click.option("--bodies", default=200, show_default=True)
@click.option("--draws", default=10, show_default=True, help="Noise draws per body.")
def main(bodies: int, draws: int) -> None:
    """Plan strikes for random bodies by the paper and by this project, and print the errors of c [mm]."""
    console = Console(width=200)
    results = [
        compare(random_body(seed), draws, seed)
        for seed in track(range(bodies), console=Console(stderr=True), transient=True)
    ]
    table = Table(title=f"{bodies} random bodies, {draws} draws each; median errors of c [mm]")
    headings = (
        "bodies",
        "paper: none",
        "falls over",
        "singular",
        "ours: none",
        "falls over",
        "singular",
        "both",
        "paper",
        "ours",
        "ours/paper",
    )
    for heading in ("", *headings, "checked: none", "falls over", "both", "ours/paper"):
        table.add_column(heading, justify="right", no_wrap=True)
    for kind in (*KINDS, "all"):
        table.add_row(kind, *_row([result for result in results if kind in {result.kind, "all"}]))
    console.print(table)
    printed = sum(result.paper_as_printed for result in results)
    console.print(
        f"eq. (1) as published leaves two stable planes for {printed} of {bodies} bodies; for the others its "
        "sums are replaced by means"
    )
    console.print(
        "none: refused with a reason; falls over: the true c lies outside the support of a plane that was "
        "assumed stable; checked: ours"
    )
    console.print(
        "with friction, lift, and reach and speed of the striker checked, which the paper does not do"
    )
    for reason, many in Counter(
        _reason(result.checked.refusal) for result in results if result.checked.refusal
    ).most_common():
        console.print(f"checked, none, {many}: {reason}", highlight=False)


def _row(results: list[Compared]) -> list[str]:
    paper = [result.paper for result in results]
    planned = sum(not outcome.refusal for outcome in paper)
    singular = sum(outcome.singular for outcome in paper)
    cells = [
        str(len(results)),
        str(len(results) - planned),
        str(sum(outcome.falls_over for outcome in paper)),
    ]
    cells += [f"{singular}/{planned} = {100 * singular / max(planned, 1):.0f} %"]
    ours = [result.ours for result in results]
    cells += [
        str(sum(test(outcome) for outcome in ours))
        for test in (lambda o: bool(o.refusal), lambda o: o.falls_over, lambda o: o.singular)
    ]
    both, medians = _medians([(result.paper, result.ours) for result in results])
    cells += [
        str(both),
        f"{1000 * medians[0]:.2f}",
        f"{1000 * medians[1]:.2f}",
        f"{medians[1] / medians[0]:.2f}",
    ]
    checked = [result.checked for result in results]
    cells += [
        str(sum(bool(outcome.refusal) for outcome in checked)),
        str(sum(outcome.falls_over for outcome in checked)),
    ]
    both, medians = _medians([(result.paper, result.checked) for result in results])
    return [*cells, str(both), f"{medians[1] / medians[0]:.2f}"]


def _medians(pairs: list[tuple[Outcome, Outcome]]) -> tuple[int, tuple[float, float]]:
    """Number of bodies with both answers, and the median errors over them."""
    both = [
        (a.distances, b.distances) for a, b in pairs if a.distances is not None and b.distances is not None
    ]
    if not both:
        return 0, (np.nan, np.nan)
    first, second = (float(np.median(np.concatenate([pair[i] for pair in both]))) for i in (0, 1))
    return len(both), (first, second)


def _reason(text: str) -> str:
    """Reason of a refusal and its remedy, without the numbers of the body."""
    if "flat face" in text and "no flat face" not in text:
        return "no flat face it is sure to stay on"
    remedy = text.rsplit(": ", 1)[-1]
    state = "some axes, but a direction of c stays unknown" if " usable ax" in text else "no axis passes"
    return f"{state}; {remedy}"


if __name__ == "__main__":
    main()
