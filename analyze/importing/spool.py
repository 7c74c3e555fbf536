"""Images of strikes put aside while a source is looked through, so that no image is decoded twice.

That a strike began is known a moment later, and its window begins before it: the latest images are held, and go into a file without a
name once they turn out to be wanted. What is not there, because memory or the disk had no place, is decoded again.
"""

from __future__ import annotations

import math
import os
import shutil
import tempfile
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from analyze.sources.source import FrameSource, TimedImage

_HELD_S = 1.5
"""of a source's latest images: what a window has before its strike, and a second in which a strike is known as one"""
_HELD_BYTES = 256 << 20
"""of them, at most"""


@dataclass
class _Stretch:
    """Times between which every image is put aside, both included."""

    start_ns: int
    end_ns: int


class Spool:
    """Of one source. Use it in a `with` statement.

    Args:
        source: that is looked through.
        folder: where the images lie meanwhile; there must be room for as much again, for the recording.
    """

    def __init__(self, source: FrameSource, folder: Path) -> None:
        self._source, self._folder = source, folder
        self._size = source.width * source.height
        slots = 1 + min(_HELD_BYTES // self._size, math.ceil(_HELD_S * source.rate_hz))
        self._slots = np.empty((slots, source.height, source.width), np.uint8)
        self._latest: deque[tuple[int, NDArray[np.uint8]]] = deque(maxlen=slots)
        self._passed = 0
        self._stretches: list[_Stretch] = []
        self._times: list[int] = []
        self._fd = -1

    def add(self, frame: TimedImage) -> None:
        """The source's next image."""
        slot = self._slots[self._passed % len(self._slots)]
        self._passed += 1
        slot[:] = frame.image
        self._latest.append((frame.time_ns, slot))
        if self._stretches and frame.time_ns <= self._stretches[-1].end_ns:
            self._put(frame.time_ns, slot)

    def keep(self, start_ns: int, end_ns: int) -> None:
        """Put aside what was added of this stretch, and what will be."""
        wanted = [(time_ns, image) for time_ns, image in self._latest if time_ns >= start_ns]
        if not wanted or not self._has_room(end_ns - start_ns):
            return
        if self._stretches and start_ns <= self._stretches[-1].end_ns:
            self._stretches[-1].end_ns = max(end_ns, self._stretches[-1].end_ns)
        else:
            self._stretches.append(_Stretch(start_ns if len(wanted) < len(self._latest) else wanted[0][0], end_ns))
        last_ns = self._times[-1] if self._times else -1
        for time_ns, image in wanted:
            if time_ns > last_ns and not self._put(time_ns, image):
                break

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """See Frames."""
        kept = self._stretch_to(end_ns)
        if kept is None or start_ns is None or end_ns is None:
            yield from self._source.frames(start_ns, end_ns)
            return
        if start_ns < kept.start_ns:
            yield from self._source.frames(start_ns, kept.start_ns - 1)
        first, last = bisect_left(self._times, max(start_ns, kept.start_ns)), bisect_right(self._times, end_ns)
        for number in range(first, last):
            image = np.empty((self._source.height, self._source.width), np.uint8)
            os.preadv(self._fd, [image.data.cast("B")], number * self._size)
            yield TimedImage(self._times[number], image)

    def close(self) -> None:
        """Let go of the file."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    # --- the file -------------------------------------------------------------------------------------------------

    def _stretch_to(self, end_ns: int | None) -> _Stretch | None:
        if end_ns is None:
            return None
        return next((each for each in self._stretches if each.start_ns <= end_ns <= each.end_ns), None)

    def _has_room(self, length_ns: int) -> bool:
        """Whether the disk takes a stretch, and after it all stretches as a recording."""
        more = math.ceil(length_ns * 1e-9 * self._source.rate_hz)
        return shutil.disk_usage(self._folder).free > (len(self._times) + 2 * more) * self._size

    def _put(self, time_ns: int, image: NDArray[np.uint8]) -> bool:
        """Whether the disk took it; else the stretch is decoded again."""
        try:
            if self._fd < 0:
                self._fd = _nameless(self._folder)
            if os.pwrite(self._fd, image.data.cast("B"), len(self._times) * self._size) == self._size:
                self._times.append(time_ns)
                return True
        except OSError:
            pass
        self._stretches.pop()
        return False


def _nameless(folder: Path) -> int:
    """An open file that vanishes with this process."""
    with tempfile.TemporaryFile(dir=folder) as file:
        return os.dup(file.fileno())
