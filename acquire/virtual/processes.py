"""Context managers that start and end the virtual rig's processes, also when a signal interrupts.

A process that ends by itself ends the rig: without world, camera or daemon everything else would only wait.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from acquire.errors import AcquireError

START_S = 60.0
"""longest wait for a process to be ready [s]; the daemon takes longest, up to 20 s for its camera"""
_POLL_S = 0.1
"""interval at which a process's watcher checks whether it must end [s]"""
INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""signals that interrupt a virtual rig: of Ctrl-C, of `timeout` and `kill`, of a terminal that is closed"""


class _Interruption:
    """Signal handler that raises KeyboardInterrupt, but postpones it while a process is being started.

    An exception between the start of a process and the storing of its handle would leave the process running.
    """

    def __init__(self) -> None:
        self._postponing = False
        self._pending = False
        self._active = False
        self._failure: AcquireError | None = None

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

    @contextlib.contextmanager
    def active(self) -> Iterator[None]:
        """Context manager: `fail` interrupts the block, in the main thread, which then raises the error."""
        self._active, self._pending, self._failure = True, False, None
        try:
            yield
        except (AcquireError, KeyboardInterrupt) as error:
            if self._failure is not None:
                raise self._failure from error
            raise
        finally:
            self._active = False
        if self._failure is not None:
            raise self._failure

    def fail(self, failure: AcquireError) -> None:
        """Interrupt the main thread with an error, from another thread; only the first one counts."""
        if self._failure is None and self._active:
            self._failure = failure
            main = threading.main_thread().ident
            assert main is not None  # noqa: S101 - it runs
            signal.pthread_kill(main, signal.SIGTERM)

    def check(self) -> None:
        """Raise KeyboardInterrupt if one was postponed since the last call; else do nothing."""
        if self._pending:
            self._pending = False
            raise KeyboardInterrupt


_interruption = _Interruption()


def end_rig(reason: AcquireError) -> None:
    """End the block of `interruptible` with an error, from another thread; do nothing without that block."""
    _interruption.fail(reason)


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Let SIGTERM and SIGHUP raise KeyboardInterrupt in the block, as Ctrl-C (SIGINT) does.

    The former handlers are restored at the end. Outside the main thread nothing is changed, and a process
    that ends by itself does not end the block.

    Raises:
        AcquireError: a process of `running_process` ended by itself during the block.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, _interruption) for number in INTERRUPTS}
    try:
        with _interruption.active():
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def running_process(
    name: str, folder: Path, module: str, *arguments: str, environment: Mapping[str, str] | None = None
) -> Iterator[dict[str, Any]]:
    """Run a process of the virtual rig during the block; yield the JSON object that it prints when ready.

    It runs in its own terminal session, so that this process handles Ctrl-C and ends the processes in the
    right order; the rig's processes end by themselves if this process ends. At the end of the block it is
    terminated, and its standard error is copied to that of this process if it had become ready. If it ends by
    itself before, the block of `interruptible` is interrupted.

    Args:
        name: name of the process for messages, and of its standard error's file, `<name>.err`.
        folder: folder of that file.
        module: Python module to run.
        *arguments: its command line.
        environment: environment variables that it has beside those of this process.

    Raises:
        AcquireError: the process was not ready after START_S (60 s), or ended before; the message then holds
            the last line of its standard error, or its exit code if there is none.
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
            env=os.environ | (environment or {}),
        )
    ready = False
    try:
        _interruption.check()
        assert process.stdout is not None  # noqa: S101 - opened with PIPE
        if not select.select([process.stdout], [], [], START_S)[0]:
            raise AcquireError(
                f"the {name} was not ready after {START_S:g} s: end other programs, and try again"
            )
        line = process.stdout.readline()
        if not line:
            raise AcquireError(f"the {name} did not start: {_reason(process, error_path)}")
        ready = True
        with _watched(name, process, error_path):
            yield json.loads(line)
    finally:
        with _interruption.postponed():
            _end(process)
        if ready:
            sys.stderr.write(_read_text(error_path))


@contextlib.contextmanager
def _watched(name: str, process: subprocess.Popen[str], error_path: Path) -> Iterator[None]:
    """Interrupt the rig if a process ends during the block; a thread waits for that."""
    leaving = threading.Event()
    descriptor = os.pidfd_open(process.pid)

    def watch() -> None:
        while not leaving.is_set():
            if select.select([descriptor], [], [], _POLL_S)[0] and not leaving.is_set():
                reason = _reason(process, error_path)
                end_rig(AcquireError(f"the {name} ended unexpectedly: {reason}: start again"))
                return

    watcher = threading.Thread(target=watch, name=f"watch-{name}")
    watcher.start()
    try:
        yield
    finally:
        leaving.set()
        watcher.join()
        os.close(descriptor)


def _reason(process: subprocess.Popen[str], error_path: Path) -> str:
    """Reason why a process ended: signal, else last line of its standard error, else exit code."""
    code = process.wait(5.0)
    if code < 0:
        return f"killed by {signal.Signals(-code).name}"
    last = [text for text in _read_text(error_path).splitlines() if text.strip()][-1:]
    return last[0].removeprefix("acquire: ") if last else f"exit code {code}"


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
