"""The terminal side of a session: a progress line, and the person at the rig who answers with Enter."""

from __future__ import annotations

import contextlib
import sys
import threading
from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from acquire.daemon.api import DaemonClient
from acquire.errors import AcquireError


class SessionProgress:
    """Planned strikes done, what goes on now, time so far; on standard error, so that --json stays clean."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.completed:.0f}/{task.total:.0f} strikes"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            TextColumn("{task.description}"),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._task = self._progress.add_task("starting", total=1)

    def __call__(self, text: str, done: int, total: int) -> None:
        """Show `text`; without a terminal, print the lines that tell of a strike's end or a step of the set-up."""
        self._progress.update(self._task, description=text, completed=done, total=max(total, 1))
        if ":" in text:
            self.say(text)

    def say(self, text: str) -> None:
        """Print a line of its own."""
        self._console.print(text, highlight=False, soft_wrap=True)

    def ask(self, text: str) -> str:
        """Ask on the terminal; the bar pauses."""
        self._progress.stop()
        self._console.print(text, highlight=False)
        answer = sys.stdin.readline()
        self._progress.start()
        return answer

    def __enter__(self) -> SessionProgress:
        self._progress.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self._progress.stop()


class ConsoleOperator:
    """Puts the daemon's questions to the person at the terminal, and tells of its troubles."""

    def __init__(self, socket: Path, progress: SessionProgress) -> None:
        self._socket = socket
        self._progress = progress
        self._listener = DaemonClient(socket)
        self._thread = threading.Thread(target=self._run, name="console-operator", daemon=True)  # may sit in readline for ever

    def __enter__(self) -> ConsoleOperator:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()

    def _run(self) -> None:
        with contextlib.suppress(AcquireError, OSError), DaemonClient(self._socket) as answers:
            for event in self._listener.events():
                if event["event"] == "trouble":
                    self._progress.say(f"trouble: {event['text']}")
                if event["event"] != "prompt":
                    continue
                hint = f"[{event['hint']}] " if event.get("hint") else ""
                line = self._progress.ask(f"{hint}{event['text']}\nEnter when it is placed, q to end the session: ")
                stop = line.strip().lower() == "q" or not line
                answers.call("prompt.answer", prompt_id=event["prompt_id"], ok=not stop, text="stopped at the terminal" if stop else "")
