"""Preview slot: newest camera image in memory shared by capture process and console, without waiting.

The daemon makes the memory; the capture process copies an image into it at most ten times a second, and only
while a reader asks for it; readers compress it in their own process. Reader and writer never wait for each
other: there are two images, written in turn, and a counter that states which is complete.
"""

from __future__ import annotations

import errno
import mmap
import os
import struct
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from acquire.errors import DaemonNotRunning

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.frames.frame import Frame

INTERVAL_NS: Final = 100_000_000
"""shortest interval between two images [ns]"""
WANTED_NS: Final = 1_500_000_000
"""time for which one request of a reader holds [ns]"""
MAX_WIDTH: Final = 800
"""greatest width of a preview [px]; of wider images every second, third ... pixel is taken"""
_NAME: Final = "percuss-preview"
_HEAD_BYTES: Final = 4096
_WANTED_AT, _COUNT_AT, _TIMES_AT = 0, 8, 16
_INTEGER = struct.Struct("<q")


@dataclass(frozen=True)
class PreviewShape:
    """Size of a camera's image, and of its preview."""

    width: int
    """width of the camera's image [px]"""
    height: int
    """height of the camera's image [px]"""

    @property
    def step(self) -> int:
        """Distance of the pixels that are taken, in both directions [px]."""
        return -(-self.width // MAX_WIDTH)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the preview."""
        return -(-self.height // self.step), -(-self.width // self.step)

    @property
    def slot_bytes(self) -> int:
        """Size of the shared memory."""
        rows, columns = self.shape
        return _HEAD_BYTES + 2 * rows * columns


class PreviewMemory:
    """Shared memory of a preview slot, as the daemon owns it; it lives as long as this object.

    Args:
        shape: size of the camera's image.
    """

    def __init__(self, shape: PreviewShape) -> None:
        self._shape = shape
        self.fd = os.memfd_create(_NAME)
        """descriptor of the memory, inherited by the capture process"""
        os.ftruncate(self.fd, shape.slot_bytes)
        weakref.finalize(self, os.close, self.fd)

    def address(self) -> dict[str, int]:
        """Where another process of the user finds the memory: answer to the request `preview`."""
        return {
            "pid": os.getpid(),
            "fd": self.fd,
            "width": self._shape.width,
            "height": self._shape.height,
        }


class _Slot:
    """Mapped memory of a preview slot."""

    def __init__(self, fd: int, shape: PreviewShape) -> None:
        self._memory = mmap.mmap(fd, shape.slot_bytes)
        rows, columns = shape.shape
        self._images: list[NDArray[np.uint8]] = [
            np.frombuffer(self._memory, np.uint8, rows * columns, _HEAD_BYTES + i * rows * columns).reshape(
                rows, columns
            )
            for i in range(2)
        ]

    def _read(self, at: int) -> int:
        return _INTEGER.unpack_from(self._memory, at)[0]

    def _write(self, at: int, value: int) -> None:
        _INTEGER.pack_into(self._memory, at, value)


class PreviewWriter(_Slot):
    """Writer of a preview slot, on the camera's thread.

    Args:
        fd: descriptor of the memory.
        shape: size of the camera's image.
    """

    def __init__(self, fd: int, shape: PreviewShape) -> None:
        super().__init__(fd, shape)
        self._size, self._step = (shape.height, shape.width), shape.step
        self._next_ns = 0

    def offer(self, frame: Frame) -> None:
        """Copy the frame's image if a reader asks for images and the last one is old enough."""
        now_ns = frame.host_time_ns
        if now_ns < self._next_ns:
            return
        self._next_ns = now_ns + INTERVAL_NS
        if self._read(_WANTED_AT) < now_ns or frame.image.shape != self._size:
            return
        count = self._read(_COUNT_AT) + 1
        np.copyto(self._images[count % 2], frame.image[:: self._step, :: self._step])
        self._write(_TIMES_AT + 8 * (count % 2), now_ns)
        self._write(_COUNT_AT, count)


@dataclass(frozen=True)
class PreviewImage:
    """Newest preview image."""

    number: int
    """number of the image, from 1"""
    time_ns: int
    """host monotonic time at which the image arrived [ns]"""
    step: int
    """distance of neighbouring pixels in the camera's image [px]"""
    image: NDArray[np.uint8]
    """(rows, columns) mono8"""


class PreviewReader(_Slot):
    """Reader of a preview slot, in another process of the user.

    Args:
        address: answer of the daemon to the request `preview`.
        monotonic_ns: function that returns the host monotonic time [ns].

    Raises:
        DaemonNotRunning: the daemon has ended, or keeps its memory from this process.
    """

    def __init__(self, address: dict[str, Any], monotonic_ns: Callable[[], int] = time.monotonic_ns) -> None:
        shape = PreviewShape(int(address["width"]), int(address["height"]))
        self._monotonic_ns, self._step = monotonic_ns, shape.step
        path = Path(f"/proc/{int(address['pid'])}/fd/{int(address['fd'])}")
        try:
            if not str(path.readlink()).startswith(
                f"/memfd:{_NAME}"
            ):  # the daemon has ended, its number is reused
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
            fd = os.open(path, os.O_RDWR)
        except OSError as error:
            raise DaemonNotRunning(
                f"the daemon's preview cannot be opened ({error.strerror}): start the daemon again"
            ) from None
        try:
            super().__init__(fd, shape)
        except (OSError, ValueError):
            raise DaemonNotRunning("the daemon's preview has another size: start the daemon again") from None
        finally:
            os.close(fd)

    def newest(self) -> PreviewImage | None:
        """Newest image, and ask for further ones; None before the first, or if it is being replaced."""
        now_ns = self._monotonic_ns()
        self._write(_WANTED_AT, now_ns + WANTED_NS)
        for _ in range(3):
            count = self._read(_COUNT_AT)
            if count == 0:
                return None
            time_ns = self._read(_TIMES_AT + 8 * (count % 2))
            image = self._images[count % 2].copy()
            if self._read(_COUNT_AT) == count:  # the writer began no other image in this place
                if now_ns - time_ns > WANTED_NS:
                    return None
                return PreviewImage(count, time_ns, self._step, image)
        return None
