"""Progress of a batch run on the terminal, and its report at the end."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from analyze.batch.run import Report
from analyze.batch.worker_messages import Outcome
from schemas.terminal import PlainTextColumn, Terminal

SPEED_PERIOD_S = 3600
"""period over which the rate is estimated [s].

A recording may take minutes, so rich's default of 30 s is too short.
"""


class BatchProgress(Progress):
    """Progress bar on standard error with rate, remaining time and failures, shown only on a terminal.

    Each failure is printed as a line, on a terminal or not. A context manager that starts and removes the
    bar; `total` is the number of recordings to analyse.
    """

    def __init__(self, total: int) -> None:
        console = Terminal(stderr=True)
        super().__init__(
            PlainTextColumn("{task.description}"),
            BarColumn(bar_width=28),
            MofNCompleteColumn(),
            PlainTextColumn("{task.fields[rate]}"),
            TimeElapsedColumn(),
            PlainTextColumn("left"),
            TimeRemainingColumn(),
            PlainTextColumn("{task.fields[failures]}", style="red"),
            console=console,
            transient=True,
            speed_estimate_period=SPEED_PERIOD_S,
            disable=not console.is_terminal,
        )
        self._failures = 0
        self._task = self.add_task("analysing", total=max(total, 1), rate="", failures="")

    def __call__(self, outcome: Outcome, done: int, total: int) -> None:
        """Show one recording's outcome: advance the bar, and print a line if it failed.

        Args:
            outcome: outcome of the recording.
            done: number of recordings done.
            total: number of recordings in all.
        """
        if outcome.failure:
            self._failures += 1
            self.console.print(f"{outcome.failure}: {outcome.reason}", soft_wrap=True)
        speed = self.tasks[0].finished_speed or self.tasks[0].speed
        self.update(
            self._task,
            completed=done,
            total=total,
            rate=f"{60 * speed:.1f}/min" if speed else "",
            failures=f"{self._failures} failed" if self._failures else "",
        )


def render_report(report: Report, output: Path) -> None:
    """Print how many recordings a batch run analysed, found unchanged, and could not analyse, by kind.

    Further lines count recordings that failed in an earlier run and were not tried again, and state an
    interruption.

    Args:
        report: outcomes of the run.
        output: folder of the results, named in the first line.
    """
    console = Terminal(soft_wrap=True)
    done = [outcome for outcome in report.outcomes if not outcome.failure]
    known = sum(outcome.known for outcome in done)
    text = f"{len(done) - known} analysed, {report.unchanged} unchanged"
    if known:
        text += f", {known} with content analysed before"
    console.print(f"{text}, {len(report.failures)} failed: {output}")
    for kind, many in Counter(outcome.failure for outcome in report.failures).most_common():
        console.print(f"  {kind}: {many}")
    if report.failed_before:
        console.print(
            f"{len(report.failed_before)} that failed before were not tried again: add --only-failed to try "
            "them",
        )
    if report.interrupted:
        console.print("interrupted: finished results stay; repeat the same command to continue")
