"""Base class of the two paths of frames to the disk: through the page cache, or by direct I/O."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from typing import Any

from acquire.errors import RecorderError
from acquire.frames.frame import Frame


class FramePath(ABC):
    """Path of one camera's frames to the disk, chosen once when the recording opens.

    `CopiedQueue` copies the frames and writes through the page cache. `BorrowedQueue` writes with O_DIRECT
    from the camera's own buffers.
    """

    def __init__(self) -> None:
        self.error: RecorderError | None = None
        """reason why the file accepts no more images; None while it accepts them"""
        self._refused = self._failed = 0
        """images dropped on arrival, and on writing"""
        self._queue: deque[Any] = deque()

    @property
    def dropped(self) -> int:
        """Number of images that should be in the file and are not, because the disk was too slow or full."""
        return self._refused + self._failed

    @property
    def waiting(self) -> int:
        """Number of frames that wait in the queue; CopiedQueue does not count those that it is writing."""
        return len(self._queue)

    @abstractmethod
    def take(self, frame: Frame) -> bool:
        """Queue a frame to be written: its image, and its meta (FrameMeta: times, exposure, losses).

        The meta is queued even if the image is dropped. The call does not wait for the disk, except up to 1 s
        for a frame that arrives while the path closes.

        Returns:
            True if the image was queued, False if it was dropped.
        """

    @abstractmethod
    def wait_until_written(self, timeout_s: float) -> None:
        """Wait until all queued frames are handed to the file or dropped, at most `timeout_s` seconds."""

    @abstractmethod
    def close(self) -> None:
        """Write the waiting frames, or drop their images after an error, and end the path's thread.

        Safe to call twice.
        """
