"""Processes of the virtual rig: started one after another, ended in the reverse order, none left behind."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from acquire.errors import AcquireError

INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C; `timeout` and `kill`; a closed terminal"""


class _Interruption:
    """Turns the signals that end a program into KeyboardInterrupt, but not while a process is being born.

    An exception between the birth of a process and the keeping of its handle would leave it to itself.
    """

    def __init__(self) -> None:
        self._held = False
        self._pending = False

    def __call__(self, *_: object) -> None:
        if self._held:
            self._pending = True
        else:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Let nothing interrupt the block; the caller asks `check` afterwards."""
        self._held = True
        try:
            yield
        finally:
            self._held = False

    def check(self) -> None:
        """Raise what was held back."""
        if self._pending:
            self._pending = False
            raise KeyboardInterrupt


_interruption = _Interruption()


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """SIGTERM and SIGHUP end the block as Ctrl-C does: by KeyboardInterrupt, with everything taken down. Main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, _interruption) for number in INTERRUPTS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def started(name: str, folder: Path, module: str, *arguments: str) -> Iterator[dict[str, Any]]:
    """A process of the virtual rig, from its ready line to its end.

    In a session of its own: a terminal's Ctrl-C is ours to handle, in the right order. It ends by itself when we are gone.

    Raises:
        AcquireError: it ended before it was ready; with its last line.
    """
    complaints = folder / f"{name}.err"
    with _interruption.held(), complaints.open("wb") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            start_new_session=True,
        )
    ready = False
    try:
        _interruption.check()
        assert process.stdout is not None  # noqa: S101 - opened with PIPE
        line = process.stdout.readline()
        if not line:
            last = [text for text in _text_of(complaints).splitlines() if text.strip()][-1:]
            reason = last[0].removeprefix("acquire: ") if last else f"it ended with code {process.wait(5.0)}"
            raise AcquireError(f"the {name} did not start: {reason}")
        ready = True
        yield json.loads(line)
    finally:
        _end(process)
        if ready:
            sys.stderr.write(_text_of(complaints))


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _end(process: subprocess.Popen[str], patience_s: float = 10.0) -> None:
    """Terminate, and read what it still says, so that a last line does not meet a closed pipe."""
    process.terminate()
    try:
        process.communicate(timeout=patience_s)
    except (subprocess.TimeoutExpired, ValueError, OSError):
        process.kill()
        process.wait()
