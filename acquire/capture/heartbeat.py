"""Signs of life of the capture process: a byte every quarter second through a pipe, while the threads that matter turn.

A process that was stopped, that waits for ever, or whose interpreter is held by a library sends none. The daemon counts only time in which
it ran itself: a machine that slept, or that stood still as a whole, is no reason to end anybody.
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
SILENCE_S: Final = 3.0
"""without a sign of life for so long a process hangs: twelve beats, so that a busy machine may delay it"""
_TURN_S: Final = 0.1


class Heart:
    """Beats on `fd` as long as `well()` says so, until the process ends."""

    def __init__(self, fd: int, well: Callable[[], bool]) -> None:
        self._fd = fd
        self._well = well
        os.set_blocking(fd, False)  # who does not listen holds nobody up
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="heart")
        self._thread.start()

    def stop(self) -> None:
        """Beat no more."""
        self._stopping.set()
        self._thread.join()
        os.close(self._fd)

    def _beat(self) -> None:
        while not self._stopping.wait(BEAT_S):
            if self._well():
                with contextlib.suppress(OSError):
                    os.write(self._fd, b".")


class Listener:
    """Hears the beats on `fd` until the other side closes it; calls `on_silence` once, where they stay away after the first."""

    def __init__(self, fd: int, on_silence: Callable[[], None], silence_s: float = SILENCE_S) -> None:
        self._fd = fd
        self._on_silence = on_silence
        self._silence_s = silence_s
        self._thread = threading.Thread(target=self._listen, name="capture-heart")
        self._thread.start()

    def join(self) -> None:
        """Wait until the other side has ended."""
        self._thread.join()

    def _listen(self) -> None:
        heard = told = False
        silent_s = 0.0
        try:
            while True:
                before = time.monotonic()
                readable, _, _ = select.select([self._fd], [], [], _TURN_S)
                if readable:
                    if not os.read(self._fd, 4096):
                        return
                    heard, silent_s = True, 0.0
                elif heard and not told:
                    silent_s += min(time.monotonic() - before, 2 * _TURN_S)  # a longer turn is one in which nobody ran
                    if silent_s >= self._silence_s:
                        told = True
                        self._on_silence()
        finally:
            os.close(self._fd)
