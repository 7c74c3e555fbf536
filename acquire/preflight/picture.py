"""Terminal output of `acquire check`: checks in groups as they finish, and a summary at the end."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from rich.table import Table

from acquire.preflight.check import Check, Outcome
from schemas.terminal import styled

if TYPE_CHECKING:
    from rich.console import RenderableType

    from schemas.terminal import Terminal

GROUPS = {
    "rig file": "rig",
    "serial port": "computer",
    "receive buffer": "computer",
    "CPU governor": "computer",
    "servo": "servo",
    "striker board": "striker",
    "motion blur": "camera",
    "light": "scene",
}
"""heading of the group that begins with this check"""
MARKS = {
    Outcome.PASS: styled(("\u2713", "green")),
    Outcome.FAIL: styled(("\u2717", "bold red")),
    Outcome.NOT_CHECKED: styled(("\u2013", "dim")),
}
NAME_WIDTH = 17


class CheckPicture:
    """Printer of checks on a terminal, one by one as they finish, with a summary at the end."""

    def __init__(self, console: Terminal) -> None:
        self._console = console
        self._group = ""
        self._outcomes: Counter[Outcome] = Counter()
        self._failures: list[str] = []

    def show(self, check: Check) -> None:
        """Print one check with its remedy; a heading goes before it where a new group of checks begins."""
        group = GROUPS.get(check.name, self._group)
        if group != self._group:
            self._console.print(styled((f"\n{group}" if self._group else group, "bold")))
            self._group = group
        self._outcomes[check.outcome] += 1
        if check.outcome is Outcome.FAIL:
            self._failures.append(check.name)
        self._console.print(_line(check))

    def verdict(self, seconds: float) -> None:
        """Print whether the rig is ready, the failed checks, and the number of checks by outcome.

        Args:
            seconds: duration of all checks, which is printed too.
        """
        words = {Outcome.PASS: "passed", Outcome.FAIL: "failed", Outcome.NOT_CHECKED: "not checked"}
        counts = ", ".join(
            f"{self._outcomes[outcome]} {word}"
            for outcome, word in words.items()
            if self._outcomes[outcome] or outcome is Outcome.PASS
        )
        state = ("\nready", "bold green")
        if self._failures:
            state = (f"\nnot ready: {', '.join(self._failures)}", "bold red")
        self._console.print(styled(state, f"  ({counts}; {seconds:.0f} s)"))


def _line(check: Check) -> RenderableType:
    table = Table.grid(padding=(0, 1), pad_edge=False)
    table.add_column(width=2, justify="right")
    table.add_column(width=NAME_WIDTH, no_wrap=True)
    table.add_column(overflow="fold")
    found = (
        styled((f"not checked: {check.found}", "dim"))
        if check.outcome is Outcome.NOT_CHECKED
        else check.found
    )
    table.add_row(
        MARKS[check.outcome], styled((check.name, "bold" if check.outcome is Outcome.FAIL else "")), found
    )
    if check.remedy:
        table.add_row("", "", styled((f"\u2192 {check.remedy}", "yellow")))
    return table
