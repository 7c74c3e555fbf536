"""Interface of a frame's two paths to the disk: copied via the page cache, or borrowed for direct I/O."""

from __future__ import annotations

from typing import Protocol

from acquire.errors import RecorderError
from acquire.frames.frame import Frame


class FramePath(Protocol):
    """Path of one camera's frames to the disk: `CopiedQueue` (page cache) or `BorrowedQueue` (O_DIRECT).

    The path is chosen once, when the recording opens.
    """

    error: RecorderError | None
    """reason why the file accepts no more images; None while it accepts them"""

    @property
    def dropped(self) -> int:
        """Number of images that should be in the file and are not, because the disk was too slow or full."""
        ...

    @property
    def waiting(self) -> int:
        """Number of frames that are not handed to the file yet."""
        ...

    def take(self, frame: Frame) -> bool:
        """Take a frame to be written; its meta (FrameMeta: times, exposure, losses) is queued in any case.

        The call does not wait for the disk, except up to 1 s for a frame that arrives while the path closes.

        Returns:
            True if the image was taken, False if it was dropped.
        """
        ...

    def wait_until_written(self, timeout_s: float) -> None:
        """Wait until all frames taken before are handed to the file, at most `timeout_s` seconds."""
        ...

    def close(self) -> None:
        """Write the waiting frames and end the path's thread. Safe to call twice."""
        ...
