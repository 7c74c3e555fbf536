"""Measure the peak of this process's own memory.

Pages of mapped files do not count: the system reclaims them when it needs memory.
"""

from __future__ import annotations

import threading
from pathlib import Path

PROC_STATUS = Path("/proc/self/status")
SAMPLE_INTERVAL_S = 0.05


class PeakMemory:
    """Peak of this process's anonymous and shared memory in a `with` block, sampled every 50 ms.

    `peak_bytes` is the peak so far [bytes]; 0 if the system does not report it.
    """

    def __init__(self) -> None:
        self.peak_bytes = 0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._sample_until_done, daemon=True)

    def __enter__(self) -> PeakMemory:
        self._sample()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()
        self._sample()

    def _sample_until_done(self) -> None:
        while not self._done.wait(SAMPLE_INTERVAL_S):
            self._sample()

    def _sample(self) -> None:
        try:
            lines = PROC_STATUS.read_text().splitlines()
        except OSError:
            return
        own = sum(int(line.split()[1]) for line in lines if line.startswith(("RssAnon:", "RssShmem:")))
        self.peak_bytes = max(self.peak_bytes, 1024 * own)
