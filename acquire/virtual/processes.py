"""Context managers that start and end the virtual rig's processes, also when a signal interrupts."""

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
"""signals that interrupt a virtual rig: of Ctrl-C, of `timeout` and `kill`, of a terminal that is closed"""


class _Interruption:
    """Signal handler that raises KeyboardInterrupt, but postpones it while a process is being started.

    An exception between the start of a process and the storing of its handle would leave the process running.
    """

    def __init__(self) -> None:
        self._postponing = False
        self._pending = False

    def __call__(self, *_: object) -> None:
        if self._postponing:
            self._pending = True
        else:
            raise KeyboardInterrupt

    @contextlib.contextmanager
    def postponed(self) -> Iterator[None]:
        """Context manager: a signal during the block raises no KeyboardInterrupt, but is remembered.

        The caller calls `check` after the block, which raises it then.
        """
        self._postponing = True
        try:
            yield
        finally:
            self._postponing = False

    def check(self) -> None:
        """Raise KeyboardInterrupt if one was postponed since the last call; else do nothing."""
        if self._pending:
            self._pending = False
            raise KeyboardInterrupt


_interruption = _Interruption()


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt in the block, as Ctrl-C (SIGINT) does.

    The former handlers are restored at the end. Outside the main thread nothing is changed.
    """
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
def running_process(name: str, folder: Path, module: str, *arguments: str) -> Iterator[dict[str, Any]]:
    """Run a process of the virtual rig during the block; yield the JSON object that it prints when ready.

    It runs in its own terminal session, so that this process handles Ctrl-C and ends the processes in the
    right order; the rig's processes end by themselves if this process ends. At the end of the block it is
    terminated, and its standard error is copied to that of this process if it had become ready.

    Args:
        name: name of the process for messages, and of its standard error's file, `<name>.err`.
        folder: folder of that file.
        module: Python module to run.
        *arguments: its command line.

    Raises:
        AcquireError: the process ended before it was ready; the message holds the last line of its standard
            error, or its exit code if there is none.
        KeyboardInterrupt: a signal arrived while the process was started.
    """
    error_path = folder / f"{name}.err"
    with _interruption.postponed(), error_path.open("wb") as errors:
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
            last = [text for text in _read_text(error_path).splitlines() if text.strip()][-1:]
            reason = last[0].removeprefix("acquire: ") if last else f"it ended with code {process.wait(5.0)}"
            raise AcquireError(f"the {name} did not start: {reason}")
        ready = True
        yield json.loads(line)
    finally:
        _end(process)
        if ready:
            sys.stderr.write(_read_text(error_path))


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def _end(process: subprocess.Popen[str], patience_s: float = 10.0) -> None:
    """Terminate a process and wait for its end; kill it if it takes longer than `patience_s` [s].

    Its remaining output is read meanwhile, so that it never writes to a closed pipe.
    """
    process.terminate()
    try:
        process.communicate(timeout=patience_s)
    except (subprocess.TimeoutExpired, ValueError, OSError):
        process.kill()
        process.wait()
