"""Interface of a camera. One thread calls it, except where a method permits another.

The rig file's `camera.kind` chooses the class (factory.py).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

from acquire.camera.sender_filter import ForeignPackets

if TYPE_CHECKING:
    from acquire.clock.reading import ClockReading
    from acquire.frames.frame import Frame
    from schemas.camera_kind import CameraKindName


@dataclass(frozen=True)
class CameraInfo:
    """Identity of a camera: vendor, model, serial number, address and kind."""

    vendor: str
    model: str
    serial: str
    """serial number"""
    address: str
    """IP address, device id, or path of the device"""
    kind: CameraKindName = "gige"
    """kind of camera, as in the rig file"""


class Camera(ABC):
    """A camera that streams mono8 frames (8-bit grey).

    Order of calls: open, start, read (repeatedly), stop, close; close is always safe. The caller releases
    each frame's buffer once, after the frame is used.
    """

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of the camera found since it was opened, a line of text each; empty if none."""
        return ()

    @property
    def borrowable_frames(self) -> int:
        """Number of frames whose buffers a user may borrow (keep after the next read) at a time.

        If it is above 0, every image begins at the boundary of a memory page.
        """
        return 0

    def take_foreign_packets(self) -> ForeignPackets:
        """Packets of other senders at the camera's image port since the last call; none of them is used.

        The thread that reads the frames calls it.
        """
        return ForeignPackets()

    @abstractmethod
    def open(self) -> CameraInfo:
        """Connect, write every setting, read it back and compare.

        Address and settings are those of the rig file's section `camera`.

        Returns:
            The camera's identity: vendor, model, serial number and IP address.

        Raises:
            CameraNotFound: nothing answers at the address.
            CameraSettingError: a setting is refused or reads back differently.
            CameraError: the camera cannot be used for another reason, e.g. another program controls it.
        """

    @abstractmethod
    def start(self) -> None:
        """Start streaming frames.

        Raises:
            CameraLost: the camera no longer answers.
        """

    @abstractmethod
    def read(self, timeout_s: float) -> Frame | None:
        """Next complete frame of the stream, or None if none arrived within `timeout_s` [s].

        The frame holds a grey image, the camera's time [ns] at the start of its exposure, and the host
        monotonic time [ns] of its arrival.

        Raises:
            CameraLost: the camera no longer answers, or sent no complete frame for the configured `stall_s`.
        """

    @abstractmethod
    def latch_clock(self) -> ClockReading | None:
        """Read the camera's clock now. A second thread may call this while frames are read.

        Returns:
            Time of the camera's clock, and the host's monotonic times before and after the reading, all [ns];
            None if the camera cannot latch its clock (store its present value), or this reading failed.

        Raises:
            CameraLost: the camera does not answer; a class may return None instead.
        """

    @abstractmethod
    def stop(self) -> None:
        """Stop streaming frames; those that were not read may be dropped."""

    @abstractmethod
    def close(self) -> None:
        """Release the camera. Never raises, never blocks long."""
