"""Base of a frame's two paths to the disk: copied via the page cache, or borrowed for direct I/O."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from typing import Any

from acquire.errors import RecorderError
from acquire.frames.frame import Frame


class FramePath(ABC):
    """Path of one camera's frames to the disk: `CopiedQueue` (page cache) or `BorrowedQueue` (O_DIRECT).

    The path is chosen once, when the recording opens.
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
        """Number of frames in the queue; a batch that CopiedQueue is writing has left it."""
        return len(self._queue)

    @abstractmethod
    def take(self, frame: Frame) -> bool:
        """Take a frame to be written; its meta (FrameMeta: times, exposure, losses) is queued in any case.

        The call does not wait for the disk, except up to 1 s for a frame that arrives while the path closes.

        Returns:
            True if the image was taken, False if it was dropped.
        """

    @abstractmethod
    def wait_until_written(self, timeout_s: float) -> None:
        """Wait until all frames taken before are handed to the file, at most `timeout_s` seconds."""

    @abstractmethod
    def close(self) -> None:
        """Write the waiting frames and end the path's thread. Safe to call twice."""
