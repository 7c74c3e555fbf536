"""What every camera does: open, start, read, release, stop, close. From one thread, but for what says otherwise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class CameraInfo:
    """Who answered."""

    vendor: str
    model: str
    serial: str
    address: str


@dataclass(frozen=True)
class ClockReading:
    """One reading of the device clock between two of the host's monotonic clock."""

    device_time_ns: int
    host_before_ns: int
    host_after_ns: int


@dataclass(frozen=True)
class Frame:
    """One complete frame. `image` is a view that is valid until the frame is released."""

    image: NDArray[np.uint8]
    """(height, width) mono8"""
    sequence: int
    """counts complete frames since start, from 0"""
    frame_id: int
    """GVSP block id"""
    device_time_ns: int
    """camera clock, start of exposure"""
    host_time_ns: int
    """host monotonic clock, at arrival"""
    exposure_us: float
    lost_before: int
    """frames lost between the previous complete frame and this one"""
    token: int
    """identifies the buffer to give back"""


class Camera(ABC):
    """A camera that streams mono8 frames. Order of calls: open, start, (read, release)*, stop, close; close is always safe."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What works less well than it could, one line each; known after `open`."""
        return ()

    @property
    def spare_buffers(self) -> int:
        """Frames that may be kept at a time; then images begin on a page of the memory. 0: none."""
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
        """Next complete frame, or None when none came in time.

        Raises:
            CameraLost: the camera no longer answers, or stalled longer than configured.
        """

    def keep(self, frame: Frame) -> bool:  # noqa: ARG002 - for cameras that have no spare buffers
        """The frame will be released later, by any thread, also after `close`: another buffer takes its place.

        False where there is none: it must be released before the next is read, as any other.
        """
        return False

    @abstractmethod
    def release(self, frame: Frame) -> None:
        """Give the frame's buffer back, once; its image must not be used any more."""

    @abstractmethod
    def latch_clock(self) -> ClockReading | None:
        """Read the device clock now, or None where the camera cannot latch. May be called from a second thread while frames are read.

        Raises:
            CameraLost: no answer.
        """

    @abstractmethod
    def stop(self) -> None:
        """Stop streaming."""

    @abstractmethod
    def close(self) -> None:
        """Release the device. Never raises, never blocks long."""
