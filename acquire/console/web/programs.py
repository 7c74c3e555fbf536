"""Programs that the console starts: daemon, check, session, and commands of `analyze`.

Daemon and session run in process groups of their own and outlive the console; what they print goes to files
in the private folder of the daemon's socket.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from acquire.daemon.client import wait_for_socket
from acquire.errors import AcquireError, DaemonBusy, SessionError

START_S: Final = 40.0
"""longest wait for the daemon's socket [s]; a camera gives control back 3 s after a client's sudden death"""
ANALYSE_S: Final = 900.0
"""longest time of a command of `analyze` [s]"""
TAIL_BYTES: Final = 4096


class Detached:
    """Program that outlives the console.

    Args:
        arguments: command line after `python -m`.
        log: file for what it prints, replaced.
    """

    def __init__(self, arguments: list[str], log: Path) -> None:
        self._log = log
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    @property
    def running(self) -> bool:
        """True until the program has ended."""
        return self._process.poll() is None

    @property
    def code(self) -> int | None:
        """Exit code; None while it runs."""
        return self._process.poll()

    def end(self) -> None:
        """Ask the program to end, as SIGTERM does; do not wait for its end."""
        self._process.terminate()

    def complaint(self) -> str:
        """Last line that the program printed, without its name; empty if there is none."""
        with contextlib.suppress(OSError), self._log.open("rb") as file:
            file.seek(0, 2)
            file.seek(max(0, file.tell() - TAIL_BYTES))
            lines = file.read().decode(errors="replace").strip().splitlines()
            return lines[-1].removeprefix("acquire: ") if lines else ""
        return ""


def start_daemon(rig: Path, socket: Path) -> Detached:
    """Start the daemon of a rig and wait until it listens.

    Args:
        rig: rig file.
        socket: path of the daemon's socket.

    Raises:
        AcquireError: it ended, or does not listen in time; the message is what it printed.
    """
    socket.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    daemon = Detached(["acquire", "run", str(rig)], socket.with_name(f"{socket.name}.daemon.log"))
    try:
        wait_for_socket(socket, lambda: daemon.running, START_S)
    except DaemonBusy:
        if daemon.running:
            raise
        raise AcquireError(daemon.complaint() or f"the daemon ended with code {daemon.code}") from None
    return daemon


class CheckRun:
    """Preflight check in a process of its own; its lines can be read while it runs.

    Args:
        rig: rig file.
        on_line: called, in a thread of its own, with each check as a JSON object.
        on_end: called with True if all checks passed, False if one failed, None if the program failed.
    """

    def __init__(
        self, rig: Path, on_line: Callable[[dict[str, Any]], None], on_end: Callable[[bool | None], None]
    ) -> None:
        self._on_line, self._on_end = on_line, on_end
        self._cancelled = False
        self._process = subprocess.Popen(
            [sys.executable, "-m", "acquire", "check", str(rig), "--json-lines"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            text=True,
        )
        self._thread = threading.Thread(target=self._read, name="console-check")
        self._thread.start()

    def close(self) -> None:
        """End the check, and its thread; `on_end` is not called if it had not ended by itself."""
        self._cancelled = True
        with contextlib.suppress(OSError):
            self._process.terminate()
        self._thread.join()

    def _read(self) -> None:
        passed: bool | None = None
        assert self._process.stdout is not None  # noqa: S101 - opened with PIPE
        with self._process.stdout as lines:
            for line in lines:
                with contextlib.suppress(ValueError):
                    data = json.loads(line)
                    if "passed" in data:
                        passed = bool(data["passed"])
                    else:
                        self._on_line(data)
        self._process.wait()
        if not self._cancelled:
            self._on_end(passed)


class Analyses:
    """Commands of `analyze`, one at a time: they compute for seconds to minutes, beside the capture."""

    def __init__(self) -> None:
        self._busy = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._closed = False

    def run(self, *arguments: str, wait: bool = False) -> str:
        """Run a command to its end, and return what it printed.

        Args:
            arguments: command line after `analyze`.
            wait: True to wait until another command has ended.

        Raises:
            SessionError: another command runs.
            AcquireError: the command failed; the message is its last line.
        """
        if not self._busy.acquire(timeout=ANALYSE_S if wait else 0.0):
            raise SessionError("another analysis runs: wait for its end")
        try:
            if self._closed:
                raise AcquireError("the console ends")
            # Lowest priority: the capture process must get the processor first.
            command = ["nice", "-n", "19", sys.executable, "-m", "analyze", *arguments]
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
            try:
                output, complaints = self._process.communicate(timeout=ANALYSE_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.communicate()
                raise AcquireError(f"analyze {arguments[0]} took longer than {ANALYSE_S:g} s") from None
            if self._process.returncode not in {0, 3}:
                lines = complaints.strip().splitlines() or [f"analyze {arguments[0]} failed"]
                raise AcquireError(lines[-1].removeprefix("analyze: "))
            return output
        finally:
            self._busy.release()

    def close(self) -> None:
        """End a command that runs."""
        self._closed = True
        if (process := self._process) is not None:
            with contextlib.suppress(OSError):
                process.kill()
