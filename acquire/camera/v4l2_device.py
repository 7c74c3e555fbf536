"""File of a video device (/dev/video0): its requests, its buffers in shared memory, the wait for an image."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import mmap
import os
import select
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from acquire.camera import v4l2_abi as abi
from acquire.errors import CameraError, CameraNotFound

if TYPE_CHECKING:
    from numpy.typing import NDArray

_LONGEST_RETRY: Final = 100
"""number of times that a request interrupted by a signal is made again"""
AnyStructure = TypeVar("AnyStructure", bound=ctypes.Structure)


class V4l2Device:
    """An open video device. Every method raises OSError with the driver's error number where it refuses.

    Args:
        path: path of the device.

    Raises:
        CameraNotFound: there is no such device.
        CameraError: the device cannot be opened, or is none of the video interface; this system has 32 bits.
    """

    def __init__(self, path: str) -> None:
        if ctypes.sizeof(ctypes.c_void_p) != 8:
            raise CameraError(f"camera {path}: video devices need a 64-bit system: install one")
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise _not_opened(path, error) from None
        self.path = path
        self._images: list[NDArray[np.uint8]] = []
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        try:
            self.capability = self.request(abi.QUERYCAP, abi.Capability())
        except OSError as error:
            self.close()
            raise CameraError(
                f"camera {path} is no video device ({error.strerror}): `acquire discover` lists them"
            ) from None

    @property
    def abilities(self) -> int:
        """Flags of what this device file can do (CAP_*)."""
        given = self.capability
        return given.device_caps if given.capabilities & abi.CAP_DEVICE_CAPS else given.capabilities

    def request(self, number: int, argument: AnyStructure) -> AnyStructure:
        """Make an ioctl with a structure, which the driver changes in place; return the structure."""
        for _ in range(_LONGEST_RETRY):
            with contextlib.suppress(InterruptedError):
                fcntl.ioctl(self._fd, number, argument)  # pyright: ignore[reportArgumentType]
                break
        return argument

    def formats(self) -> list[str]:
        """Four-letter codes of the pixel formats that the device offers."""
        names: list[str] = []
        for index in range(64):
            try:
                found = self.request(abi.ENUM_FMT, abi.FormatDescription(index=index, type=abi.VIDEO_CAPTURE))
            except OSError:
                break
            names.append(abi.fourcc_name(found.pixelformat))
        return names

    def control_range(self, control: int) -> abi.ControlRange | None:
        """Range of a control; None if the device lacks it."""
        try:
            found = self.request(abi.QUERYCTRL, abi.ControlRange(id=control))
        except OSError as error:
            if error.errno in {errno.EINVAL, errno.ENOTTY}:
                return None
            raise
        return None if found.flags & abi.CONTROL_DISABLED else found

    def control(self, control: int) -> int:
        """Present value of a control."""
        return int(self.request(abi.G_CTRL, abi.ControlValue(id=control)).value)

    def set_control(self, control: int, value: int) -> None:
        """Write the value of a control."""
        self.request(abi.S_CTRL, abi.ControlValue(id=control, value=value))

    def map_buffers(self, count: int) -> int:
        """Let the driver make buffers, and map them into memory; return the number that it granted.

        The buffers are those of `image_bytes`. No buffer is queued yet.
        """
        asked = abi.BufferRequest(count=count, type=abi.VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)
        granted = int(self.request(abi.REQBUFS, asked).count)
        for index in range(granted):
            placed = self.request(abi.QUERYBUF, self._buffer(index))
            memory = mmap.mmap(
                self._fd, placed.length, mmap.MAP_SHARED, mmap.PROT_READ, offset=int(placed.offset)
            )
            self._images.append(np.frombuffer(memory, np.uint8))
        return granted

    def buffer_flags(self) -> int:
        """Flags of the first buffer, which tell the clock and the instant of the stamps."""
        return int(self.request(abi.QUERYBUF, self._buffer(0)).flags)

    def image_bytes(self, index: int) -> NDArray[np.uint8]:
        """Bytes of buffer number `index`, uint8; they are the driver's once the buffer is queued again."""
        return self._images[index]

    def queue(self, index: int) -> None:
        """Give buffer number `index` to the driver, to be filled."""
        self.request(abi.QBUF, self._buffer(index))

    def dequeue(self) -> abi.Buffer | None:
        """Take the oldest filled buffer from the driver; None if there is none."""
        try:
            return self.request(abi.DQBUF, self._buffer(0))
        except BlockingIOError:
            return None

    def stream(self, *, on: bool) -> None:
        """Start or stop the stream; stopping takes every buffer from the driver."""
        fcntl.ioctl(
            self._fd,
            abi.STREAMON if on else abi.STREAMOFF,
            ctypes.c_int32(abi.VIDEO_CAPTURE),  # pyright: ignore[reportArgumentType]
        )

    def wait(self, timeout_s: float) -> bool:
        """True once a buffer is filled or the device has an error; False after `timeout_s` [s] without."""
        return bool(self._poll.poll(max(0.0, timeout_s) * 1e3))

    def close(self) -> None:
        """Close the device and release its buffers. May be repeated."""
        self._images.clear()
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with contextlib.suppress(OSError):
                os.close(fd)

    @staticmethod
    def _buffer(index: int) -> abi.Buffer:
        return abi.Buffer(index=index, type=abi.VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)


def _not_opened(path: str, error: OSError) -> CameraError:
    """Exception for a video device that could not be opened, with the remedy."""
    if error.errno in {errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.ENOTDIR, errno.ENOTCONN}:
        return CameraNotFound(
            f"no camera at {path} ({error.strerror}): check its cable; `acquire discover` lists the cameras"
        )
    if error.errno in {errno.EACCES, errno.EPERM}:
        return CameraError(
            f"camera {path} may not be opened by this user: `sudo usermod -aG video $USER`, then log in again"
        )
    return CameraError(f"camera {path} cannot be opened ({error.strerror}): unplug it and plug it in again")
