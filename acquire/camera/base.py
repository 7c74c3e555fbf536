"""Interface of a camera. One thread calls it, except where a method permits another.

The capture process chooses the class (acquire/capture/process.py).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from acquire.clock.reading import ClockReading
    from acquire.frames.frame import Frame


@dataclass(frozen=True)
class CameraInfo:
    """Identity of a camera."""

    vendor: str
    model: str
    serial: str
    address: str


class Camera(ABC):
    """A camera that streams mono8 frames.

    Order of calls: open, start, read (repeatedly), stop, close; close is always safe. Each frame's buffer is
    released once, after the frame is used.
    """

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations that the camera reported while it was opened, one line each."""
        return ()

    @property
    def borrowable_frames(self) -> int:
        """Number of frames whose buffers may be borrowed at a time.

        Above 0, images begin on a page of the memory.
        """
        return 0

    @abstractmethod
    def open(self) -> CameraInfo:
        """Connect, write every setting, read it back and compare.

        Raises:
            CameraNotFound: nothing answers at the address.
            CameraSettingError: a setting reads back differently.
        """

    @abstractmethod
    def start(self) -> None:
        """Start streaming."""

    @abstractmethod
    def read(self, timeout_s: float) -> Frame | None:
        """Next complete frame, or None if none arrived in time.

        Raises:
            CameraLost: the camera no longer answers, or stalled longer than configured.
        """

    @abstractmethod
    def latch_clock(self) -> ClockReading | None:
        """Read the device clock now. A second thread may call this while frames are read.

        Returns:
            None if the camera cannot latch its clock.

        Raises:
            CameraLost: no answer.
        """

    @abstractmethod
    def stop(self) -> None:
        """Stop streaming."""

    @abstractmethod
    def close(self) -> None:
        """Release the device. Never raises, never blocks long."""
