"""Stores the images of strikes while a source is searched, so that no image is decoded twice.

A strike's window (the part of the source that is imported) begins before the strike, which is recognised only
a moment after it began. So the latest images are held in memory, and written to an unnamed file once a window
needs them. Images that neither memory nor disk had room for are decoded again.
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

import numpy as np
from numpy.typing import NDArray

from analyze.sources.source import FrameSource, TimedImage

HELD_DURATION_S = 1.5
"""time span [s] of the latest images, which are held in memory: a window before its onset, and a second to
recognise the strike"""
MAX_HELD_BYTES = 256 << 20
"""largest size of the images held in memory [bytes]"""


@dataclass
class _Interval:
    """Interval, on the source's clock [ns], in which every image of the source is stored; ends included."""

    start_ns: int
    """first time on the source's clock [ns]"""
    end_ns: int
    """last time on the source's clock [ns]"""


class Spool:
    """Store of those images of a source that show strikes, filled while the source is searched.

    Call `close` at the end.

    Args:
        source: the source that is searched.
        folder: folder for the images. Images are stored only while its disk has room for them and for the
            recording, into which they are copied later.
    """

    def __init__(self, source: FrameSource, folder: Path) -> None:
        self._source, self._folder = source, folder
        self._size = source.width * source.height
        slots = 1 + min(MAX_HELD_BYTES // self._size, math.ceil(HELD_DURATION_S * source.rate_hz))
        self._slots = np.empty((slots, source.height, source.width), np.uint8)
        self._latest: deque[tuple[int, NDArray[np.uint8]]] = deque(maxlen=slots)
        self._added = 0
        self._intervals: list[_Interval] = []
        self._times: list[int] = []
        self._fd = -1

    def add(self, frame: TimedImage) -> None:
        """Hold a copy of the source's next image in memory, and on disk if a kept interval contains it."""
        slot = self._slots[self._added % len(self._slots)]
        self._added += 1
        slot[:] = frame.image
        self._latest.append((frame.time_ns, slot))
        if self._intervals and frame.time_ns <= self._intervals[-1].end_ns:
            self._append(frame.time_ns, slot)

    def keep(self, start_ns: int, end_ns: int) -> None:
        """Store the images of an interval on disk, both those still held in memory and those to come.

        Nothing is stored if no image of the interval is held or the disk has no room: `frames` then decodes
        its images again.

        Args:
            start_ns: first time on the source's clock [ns], included.
            end_ns: last time on the source's clock [ns], included.
        """
        wanted = [(time_ns, image) for time_ns, image in self._latest if time_ns >= start_ns]
        if not wanted or not self._has_room(end_ns - start_ns):
            return
        if self._intervals and start_ns <= self._intervals[-1].end_ns:
            self._intervals[-1].end_ns = max(end_ns, self._intervals[-1].end_ns)
        else:
            self._intervals.append(
                _Interval(start_ns if len(wanted) < len(self._latest) else wanted[0][0], end_ns)
            )
        last_ns = self._times[-1] if self._times else -1
        for time_ns, image in wanted:
            if time_ns > last_ns and not self._append(time_ns, image):
                break

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """Yield the source's images from `start_ns` to `end_ns`, read from the disk where they are stored.

        Images before the stored interval that contains `end_ns` are decoded from the source again. If there
        is no such interval, or one of the times is None, all images are.

        Args:
            start_ns: first time on the source's clock [ns], included; None for the first image.
            end_ns: last time on the source's clock [ns], included; None for the last image.

        Raises:
            ImportRefused: the source cannot be read.
        """
        kept = self._interval_ending_at(end_ns)
        if kept is None or start_ns is None or end_ns is None:
            yield from self._source.frames(start_ns, end_ns)
            return
        if start_ns < kept.start_ns:
            yield from self._source.frames(start_ns, kept.start_ns - 1)
        first = bisect_left(self._times, max(start_ns, kept.start_ns))
        for number in range(first, bisect_right(self._times, end_ns)):
            image = np.empty((self._source.height, self._source.width), np.uint8)
            os.preadv(self._fd, [image.data.cast("B")], number * self._size)
            yield TimedImage(self._times[number], image)

    def close(self) -> None:
        """Close the file of stored images, which removes it."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    # --- the file

    def _interval_ending_at(self, end_ns: int | None) -> _Interval | None:
        """Stored interval that contains the time `end_ns` on the source's clock [ns]; None if none does."""
        if end_ns is None:
            return None
        return next((each for each in self._intervals if each.start_ns <= end_ns <= each.end_ns), None)

    def _has_room(self, length_ns: int) -> bool:
        """True if the disk has room for another interval of images, and for a recording of all stored ones.

        Args:
            length_ns: length of the other interval [ns].
        """
        more = math.ceil(length_ns * 1e-9 * self._source.rate_hz)
        return shutil.disk_usage(self._folder).free > (len(self._times) + 2 * more) * self._size

    def _append(self, time_ns: int, image: NDArray[np.uint8]) -> bool:
        """Append an image to the file of stored images.

        Args:
            time_ns: time of the image on the source's clock [ns].
            image: (height, width) grey values.

        Returns:
            True if it was written; False if the disk refused. Then the stored interval that ends last is
            given up: `frames` decodes its images from the source again.
        """
        try:
            if self._fd < 0:
                self._fd = _unnamed_file(self._folder)
            if os.pwrite(self._fd, image.data.cast("B"), len(self._times) * self._size) == self._size:
                self._times.append(time_ns)
                return True
        except OSError:
            pass
        self._intervals.pop()
        return False


def _unnamed_file(folder: Path) -> int:
    """Create a file without a name in `folder`; the system deletes it when it is closed.

    Returns:
        The open file's descriptor.

    Raises:
        OSError: the file cannot be created.
    """
    with tempfile.TemporaryFile(dir=folder) as file:
        return os.dup(file.fileno())
