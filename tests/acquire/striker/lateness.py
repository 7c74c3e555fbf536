"""Measurement of how late this host wakes a thread; real-time limits of tests allow for that delay."""

from __future__ import annotations

import threading
import time

PERIOD_S = 0.001


class Lateness:
    """Context manager that measures the worst delay of a waking thread while it is open."""

    def __init__(self) -> None:
        self.worst_s = 0.0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="lateness")

    def __enter__(self) -> Lateness:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._end.is_set():
            before = time.monotonic()
            time.sleep(PERIOD_S)
            self.worst_s = max(self.worst_s, time.monotonic() - before - PERIOD_S)
