"""Progress of work that takes longer than a second: the type of its callback, and a progress bar."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

Progress = Callable[[str, int, int], None]
"""callback: called with the name of the step, the units of work done, and the units in all"""


def no_progress(_text: str, _done: int, _total: int) -> None:
    """Discard a progress report: the `Progress` callback of callers that show no progress."""


class ProgressBar(ExitStack):
    """Progress bar on standard error, shown only on a terminal.

    It is a `Progress` callback, called as `bar(text, done, total)`, and a context manager that removes the
    bar, which is shown from its construction on.
    """

    def __init__(self) -> None:
        super().__init__()
        # Imported here: the callback's type is used by modules that draw nothing.
        from rich.progress import BarColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

        from schemas.terminal import PlainTextColumn, Terminal

        console = Terminal(stderr=True)
        progress = Progress(
            PlainTextColumn("{task.description}"),
            BarColumn(bar_width=32),
            PlainTextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._progress = self.enter_context(progress)
        self._text = "starting"
        self._task = self._progress.add_task(self._text, total=1)

    def __call__(self, text: str, done: int, total: int) -> None:
        """Update the bar, and redraw it at once when the step changes.

        Args:
            text: name of the step.
            done: units of work done.
            total: units of work in all.
        """
        self._progress.update(self._task, description=text, completed=done, total=max(total, 1))
        if text != self._text:
            # A step that holds the interpreter keeps the bar's own thread from redrawing until it ends.
            self._text = text
            self._progress.refresh()
