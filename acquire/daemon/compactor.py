"""Compacts finished recordings between sessions, if the rig file asks for it, by a child `analyze compact`.

It has the lowest priority, waits until the recording has been left alone for a while, and ends when the next
one begins: that recording is begun anew afterwards. A recording is whole whenever the child ends.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from schemas.rig import RecorderConfig

WAIT_S = 60.0
"""time after a session before its recording is compacted [s]: its answer comes first"""


class Compactor:
    """Queue of recordings to be compacted, and the child process that compacts the first of them.

    Args:
        recorder: whether recordings are compacted, and the disk space that a copy leaves free.
        complain: called with one line on a recording that cannot be.
        wait_s: time after a session before its recording is compacted [s].
    """

    def __init__(
        self, recorder: RecorderConfig, complain: Callable[[str], None], wait_s: float = WAIT_S
    ) -> None:
        self._enabled, self._complain, self._wait_s = recorder.compact == "after-session", complain, wait_s
        reserve = ["--disk-reserve", str(recorder.disk_reserve_bytes)]
        self._compact = [sys.executable, "-m", "analyze", "compact", *reserve]
        self._queue: list[Path] = []
        self._process: subprocess.Popen[str] | None = None
        self._paused = self._interrupted = False
        self._closed = False
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def enqueue(self, files: Sequence[str]) -> None:
        """Compact the files of a recording that has ended, and those that were left before."""
        with self._changed:
            self._paused = False
            if self._enabled:
                self._queue += [Path(file) for file in files]
                if self._thread is None:
                    self._thread = threading.Thread(target=self._run, name="compactor", daemon=True)
                    self._thread.start()
            self._changed.notify_all()

    def pause(self) -> None:
        """End the child process until the next recording has ended."""
        with self._changed:
            self._paused = True
            self._end()

    def close(self) -> None:
        """End the child process for good."""
        with self._changed:
            self._closed = True
            self._end()
            thread = self._thread
        if thread is not None:
            thread.join()

    def _end(self) -> None:
        if self._process is not None:
            self._interrupted = True
            self._process.send_signal(signal.SIGINT)  # it removes its unfinished copy
        self._changed.notify_all()

    def _run(self) -> None:
        while (path := self._next()) is not None:
            command = ["nice", "-n", "19", *self._compact, str(path)]
            with self._changed:
                if self._paused or self._closed:
                    continue
                self._interrupted, problem = False, ""
                try:
                    process = self._process = subprocess.Popen(
                        command,
                        stdin=subprocess.DEVNULL,
                        stdout=subprocess.DEVNULL,
                        stderr=subprocess.PIPE,
                        text=True,
                        start_new_session=True,  # only the daemon handles a terminal's Ctrl-C
                    )
                except OSError as error:
                    process, problem = None, f"{path}: not compacted: {error.strerror}"
            if process is not None:
                _, written = process.communicate()
                lines = written.strip().splitlines() or [f"{path}: not compacted"]
                problem = lines[-1] if process.returncode else ""
            with self._changed:
                self._process = None
                if self._interrupted:
                    continue
                self._queue.remove(path)
            if problem:
                self._complain(problem)

    def _next(self) -> Path | None:
        """The next recording, once there is one and the time for it has come; None when all is over."""
        with self._changed:
            while not self._closed:
                if self._queue and not self._paused:
                    waited = not self._changed.wait(self._wait_s)
                    if waited and self._queue and not self._paused and not self._closed:
                        return self._queue[0]
                else:
                    self._changed.wait()
            return None
