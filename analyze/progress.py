"""A progress bar for work that takes longer than a second; on standard error, and only on a terminal."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class StrikeProgress:
    """Call with (text, done, total)."""

    def __init__(self) -> None:
        console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=32),
            TextColumn("{task.completed:.0f}/{task.total:.0f}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._text = "starting"
        self._task = self._progress.add_task(self._text, total=1)

    def __call__(self, text: str, done: int, total: int) -> None:
        """Update the bar; a new step is shown at once, for it may not let the bar's own thread run until it ends."""
        self._progress.update(self._task, description=text, completed=done, total=max(total, 1))
        if text != self._text:
            self._text = text
            self._progress.refresh()

    def __enter__(self) -> StrikeProgress:
        self._progress.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self._progress.stop()
