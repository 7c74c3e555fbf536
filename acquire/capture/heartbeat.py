"""Heartbeat of the capture process: a byte every quarter second, while its essential threads run.

A process that was stopped, that is blocked, or whose interpreter is held by a library sends no heartbeat. The
listener in the daemon counts only time during which it ran itself, so that no process is killed because the
whole computer slept or stood still.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
from collections.abc import Callable
from typing import Final

BEAT_S: Final = 0.25
"""interval between heartbeats [s]"""
SILENCE_S: Final = 3.0
"""time without heartbeat after which a process counts as hung [s]: twelve beats, so that a busy computer may
delay it"""
_POLL_S: Final = 0.1


class Heartbeat:
    """Sender of heartbeats: a byte on a pipe every BEAT_S while this process is healthy, until `stop`.

    Args:
        fd: writing end of the pipe; closed by `stop`.
        is_healthy: function that returns True if this process works; called before each byte, in a thread of
            its own.
    """

    def __init__(self, fd: int, is_healthy: Callable[[], bool]) -> None:
        self._fd = fd
        self._is_healthy = is_healthy
        os.set_blocking(fd, False)  # a listener that does not read blocks nobody
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat")
        self._thread.start()

    def stop(self) -> None:
        """Send no more heartbeats, and close the pipe."""
        self._stopping.set()
        self._thread.join()
        os.close(self._fd)

    def _run(self) -> None:
        while not self._stopping.wait(BEAT_S):
            if self._is_healthy():
                with contextlib.suppress(OSError):
                    os.write(self._fd, b".")


class HeartbeatListener:
    """Receiver of a process's heartbeats (bytes on a pipe), until the sender closes the pipe.

    Args:
        fd: reading end of the pipe; closed when the sender has closed the other end.
        on_silence: called once, in a thread of its own, if no heartbeat comes for `silence_s` after the
            first.
        silence_s: time without a heartbeat after which the sender counts as hung [s]; only time during which
            this process ran counts.
    """

    def __init__(self, fd: int, on_silence: Callable[[], None], silence_s: float = SILENCE_S) -> None:
        self._fd = fd
        self._on_silence = on_silence
        self._silence_s = silence_s
        self._thread = threading.Thread(target=self._run, name="capture-heartbeat")
        self._thread.start()

    def join(self) -> None:
        """Wait until the sender has closed the pipe, which the end of its process does at the latest."""
        self._thread.join()

    def _run(self) -> None:
        started = reported = False
        silent_s = 0.0
        try:
            while True:
                before = time.monotonic()
                readable, _, _ = select.select([self._fd], [], [], _POLL_S)
                if readable:
                    if not os.read(self._fd, 4096):
                        return
                    started, silent_s = True, 0.0
                elif started and not reported:
                    # A turn longer than that is time in which this process did not run either.
                    silent_s += min(time.monotonic() - before, 2 * _POLL_S)
                    if silent_s >= self._silence_s:
                        reported = True
                        self._on_silence()
        finally:
            os.close(self._fd)
