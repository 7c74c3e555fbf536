"""Terminal interface of a session: a progress line, and prompts that the operator answers with Enter."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

from rich.progress import BarColumn, Progress, TimeElapsedColumn

from acquire.daemon.operator_client import OperatorClient
from acquire.errors import AcquireError
from schemas.terminal import PlainTextColumn, Terminal

PLACE_KEYS = "Press Enter when the object is placed"
TOSS_KEYS = (
    "Press Enter when it is held ready, s and Enter to skip this toss, a and Enter to repeat the last one"
)
TOSS_ORDERS = {"s": "skip", "a": "again"}
"""order by the key that is typed when a toss is asked for"""


class SessionProgress(Progress):
    """Progress line of a session: planned strikes done, elapsed time, current step.

    It is written to standard error, so that the output of --json stays clean. As a context manager it is
    shown during the `with` block.
    """

    def __init__(self) -> None:
        console = Terminal(stderr=True)
        super().__init__(
            PlainTextColumn("{task.completed:.0f}/{task.total:.0f} strikes"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            PlainTextColumn("{task.description}"),
            console=console,
            disable=not console.is_terminal,
        )
        self._task = self.add_task("starting", total=1)

    def __call__(self, text: str, done: int, total: int) -> None:
        """Show `text` on the progress line; also print it as a line of its own if it contains a colon.

        Texts with a colon are those worth keeping: a step of the set-up, the end of a strike, why an object
        is placed again, a fault or warning, what was learned, or which files were kept.

        Args:
            text: current step.
            done: number of planned strikes done.
            total: number of planned strikes.
        """
        self.update(self._task, description=text, completed=done, total=max(total, 1))
        if ":" in text:
            self.print_line(text)

    def print_line(self, text: str) -> None:
        """Print a line of text above the progress line."""
        self.console.print(text, soft_wrap=True)

    def ask(self, text: str) -> str:
        """Ask the operator a question and return the line that was typed; the progress line pauses meanwhile.

        Returns:
            A line of standard input with its line end; "" if standard input has ended.
        """
        self.stop()
        self.console.print(text)
        answer = sys.stdin.readline()
        self.start()
        return answer


class ConsoleOperator:
    """Thread that shows the daemon's prompts and problems and sends back the operator's answers.

    As a context manager it runs during the `with` block; it ends when the connection to the daemon ends, or,
    if it waits for a line from the operator then, with that line or the process.

    Args:
        socket: path of the daemon's socket.
        progress: progress line on which questions are asked.

    Raises:
        DaemonError: the daemon cannot be reached.
    """

    def __init__(self, socket: Path, progress: SessionProgress) -> None:
        self._progress = progress
        self._daemon = OperatorClient(socket)
        # A daemon thread, because it may wait in readline for ever.
        self._thread = threading.Thread(target=self._run, name="console-operator", daemon=True)

    def __enter__(self) -> ConsoleOperator:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._daemon.close()

    def _run(self) -> None:
        try:
            for event in self._daemon.events():
                if event["event"] == "trouble":
                    self._progress.print_line(f"trouble: {event['text']}")
                if event["event"] != "prompt":
                    continue
                hint = f"[{event['hint']}] " if event.get("hint") else ""
                tossed = event["kind"] == "toss"
                keys = TOSS_KEYS if tossed else PLACE_KEYS
                line = self._progress.ask(
                    f"{hint}{event['text']}\n{keys}, or q and Enter to end the session: "
                )
                key = line.strip().lower()
                stop = key == "q" or not line
                text = "stopped at the terminal" if stop else ""
                order = TOSS_ORDERS.get(key, "placed") if tossed else "placed"
                self._daemon.answer(event["prompt_id"], ok=not stop, text=text, order=order)
        except AcquireError as error:
            self._progress.print_line(f"trouble: prompts are no longer shown: {error}; end with Ctrl-C")
