"""Requests of V4L2 as a driver of a webcam answers them: formats, controls, buffers, errors.

Behaviour after the kernel's "Video for Linux API" and its videobuf2 core. Not modelled: the input and
priority calls, several planes, other memory than mapped one, events, the USB bus behind the driver.
"""

from __future__ import annotations

import errno
import os
import select
import struct
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from acquire.camera import v4l2_abi as abi

if TYPE_CHECKING:
    from collections.abc import Callable

_PAGE = 4096
_RATES_HZ = (30.0, 60.0, 90.0, 120.0, 200.0, 240.0, 365.0)
"""frame rates that the camera has"""


@dataclass
class Control:
    """A control of the camera: name, range and present value."""

    name: str
    minimum: int
    maximum: int
    value: int


def webcam_controls() -> dict[int, Control]:
    """Controls of a webcam that another program has left with everything automatic, by their numbers."""
    return {
        abi.CID_AUTO_WHITE_BALANCE: Control("White Balance, Automatic", 0, 1, 1),
        abi.CID_GAIN: Control("Gain", 16, 255, 64),
        abi.CID_BACKLIGHT_COMPENSATION: Control("Backlight Compensation", 0, 2, 1),
        abi.CID_EXPOSURE_AUTO: Control("Auto Exposure", 0, 3, 3),
        abi.CID_EXPOSURE_ABSOLUTE: Control("Exposure Time, Absolute", 1, 5000, 157),
        abi.CID_EXPOSURE_AUTO_PRIORITY: Control("Exposure, Dynamic Framerate", 0, 1, 1),
    }


@dataclass
class _DriverBuffer:
    flags: int = abi.BUF_MAPPED
    bytes_used: int = 0
    stamp_ns: int = 0
    sequence: int = 0


@dataclass
class VideoDriver:
    """State of a video device, as its driver keeps it. Its methods are called under one lock by its owner."""

    width: int
    """width of the sensor [px]"""
    height: int
    """height of the sensor [px]"""
    codes: tuple[str, ...] = ("GREY", "YUYV", "MJPG")
    """pixel formats that it offers"""
    stamp_flags: int = abi.TIMESTAMP_MONOTONIC | abi.STAMP_START_OF_EXPOSURE
    """clock and instant of its stamps"""
    driver: str = "percuss"
    on_stream: Callable[[bool], None] = lambda _on: None
    """called when the stream starts and stops"""
    controls: dict[int, Control] = field(default_factory=webcam_controls)
    code: str = "YUYV"
    rate_hz: float = 30.0
    streaming: bool = False
    _owner: int = 0
    _buffers: list[_DriverBuffer] = field(default_factory=list)
    _queued: deque[int] = field(default_factory=deque)
    _done: deque[int] = field(default_factory=deque)

    @property
    def row_bytes(self) -> int:
        """Bytes from a row of an image to the next; rows of webcams may be longer than their pixels."""
        return 2 * self.width if self.code == "YUYV" else self.width

    @property
    def image_bytes(self) -> int:
        """Largest size of an image [bytes]."""
        return 2 * self.width * self.height if self.code == "MJPG" else self.row_bytes * self.height

    @property
    def buffer_bytes(self) -> int:
        """Distance of the buffers in the file: an image in whole pages [bytes]."""
        return -(-self.image_bytes // _PAGE) * _PAGE

    @property
    def exposure_us(self) -> float:
        """Exposure time [us]."""
        return self.controls[abi.CID_EXPOSURE_ABSOLUTE].value * abi.EXPOSURE_UNIT_US

    def next_buffer(self) -> int | None:
        """Number of the buffer to fill next; None if the program has queued none, and the image is lost."""
        return self._queued.popleft() if self._queued and self.streaming else None

    def filled(self, index: int, bytes_used: int, stamp_ns: int, sequence: int) -> None:
        """Hand buffer number `index` with an image to the program."""
        if index < len(self._buffers) and self.streaming:
            flags = abi.BUF_MAPPED | abi.BUF_DONE
            self._buffers[index] = _DriverBuffer(flags, bytes_used, stamp_ns, sequence)
            self._done.append(index)

    def events(self, handle: int) -> int:
        """Events of poll: readable with a filled buffer, an error while nothing streams."""
        if not self.streaming or handle != self._owner:
            return select.POLLERR
        return select.POLLIN | select.POLLRDNORM if self._done else 0

    def release(self, handle: int) -> None:
        """End the stream of the program that closed the device."""
        if handle == self._owner:
            self._stop()
            self._buffers.clear()
            self._owner = 0

    def ioctl(self, handle: int, request: int, data: bytes) -> bytes:
        """Answer of a request; OSError with the driver's error number where it refuses."""
        answer = _ANSWERS.get(request)
        if answer is None:
            raise OSError(errno.ENOTTY, "no such request")
        return answer(self, handle, data)

    def _stop(self) -> None:
        if self.streaming:
            self.streaming = False
            self.on_stream(False)
        self._queued.clear()
        self._done.clear()
        for buffer in self._buffers:
            buffer.flags = abi.BUF_MAPPED

    def _refuse_others(self, handle: int, *, while_streaming: bool = False) -> None:
        if (self._owner not in {0, handle}) or (while_streaming and self._buffers):
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))

    def query(self, _handle: int, _data: bytes) -> bytes:
        """Identity and abilities."""
        abilities = abi.CAP_VIDEO_CAPTURE | abi.CAP_STREAMING
        return bytes(
            abi.Capability(
                driver=self.driver.encode(),
                card=b"Virtual webcam",
                bus_info=b"usb-virtual-1",
                version=0x060100,
                capabilities=abilities | abi.CAP_META_CAPTURE | abi.CAP_DEVICE_CAPS,
                device_caps=abilities,
            )
        )

    def enumerate_formats(self, _handle: int, data: bytes) -> bytes:
        """One of the pixel formats."""
        asked = abi.FormatDescription.from_buffer_copy(data)
        if asked.index >= len(self.codes):
            raise OSError(errno.EINVAL, "no more")
        asked.pixelformat = abi.fourcc(self.codes[asked.index])
        asked.description = self.codes[asked.index].encode()
        return bytes(asked)

    def set_format(self, handle: int, data: bytes) -> bytes:
        """Take the pixel format, or the first one; the size is that of the sensor, whatever is asked for."""
        self._refuse_others(handle, while_streaming=True)
        asked = abi.fourcc_name(abi.ImageFormat.from_buffer_copy(data).pixelformat)
        self.code = asked if asked in self.codes else self.codes[0]
        return self.get_format(handle, data)

    def get_format(self, _handle: int, _data: bytes) -> bytes:
        """Present format."""
        return bytes(
            abi.ImageFormat(
                type=abi.VIDEO_CAPTURE,
                width=self.width,
                height=self.height,
                pixelformat=abi.fourcc(self.code),
                field=abi.FIELD_NONE,
                bytesperline=0 if self.code == "MJPG" else self.row_bytes,
                sizeimage=self.image_bytes,
            )
        )

    def set_parameters(self, handle: int, data: bytes) -> bytes:
        """Take the nearest of the camera's frame rates."""
        self._refuse_others(handle, while_streaming=True)
        asked = abi.StreamParameters.from_buffer_copy(data)
        wanted_hz = asked.denominator / asked.numerator if asked.numerator else _RATES_HZ[0]
        self.rate_hz = min(_RATES_HZ, key=lambda rate: abs(rate - wanted_hz))
        return self.get_parameters(handle, data)

    def get_parameters(self, _handle: int, _data: bytes) -> bytes:
        """Time per frame in units of 100 ns, as webcams state it."""
        return bytes(
            abi.StreamParameters(
                type=abi.VIDEO_CAPTURE,
                capability=abi.CAP_TIMEPERFRAME,
                numerator=round(1e7 / self.rate_hz),
                denominator=10_000_000,
            )
        )

    def query_control(self, _handle: int, data: bytes) -> bytes:
        """Range of a control."""
        asked = abi.ControlRange.from_buffer_copy(data)
        known = self._control(asked.id)
        asked.name = known.name.encode()[:31]
        asked.minimum, asked.maximum, asked.step = known.minimum, known.maximum, 1
        return bytes(asked)

    def get_control(self, _handle: int, data: bytes) -> bytes:
        """Value of a control."""
        asked = abi.ControlValue.from_buffer_copy(data)
        asked.value = self._control(asked.id).value
        return bytes(asked)

    def set_control(self, _handle: int, data: bytes) -> bytes:
        """Take the value of a control, at the nearest end of its range if it is beyond."""
        asked = abi.ControlValue.from_buffer_copy(data)
        known = self._control(asked.id)
        if (
            asked.id == abi.CID_EXPOSURE_ABSOLUTE
            and self.controls[abi.CID_EXPOSURE_AUTO].value != abi.EXPOSURE_MANUAL
        ):
            raise OSError(errno.EACCES, "the automatic has it")
        asked.value = known.value = min(max(asked.value, known.minimum), known.maximum)
        return bytes(asked)

    def _control(self, number: int) -> Control:
        if number not in self.controls:
            raise OSError(errno.EINVAL, "no such control")
        return self.controls[number]

    def request_buffers(self, handle: int, data: bytes) -> bytes:
        """Make buffers, at most 32; the program that asks first owns the stream."""
        self._refuse_others(handle)
        if self.streaming:
            raise OSError(errno.EBUSY, "streaming")
        asked = abi.BufferRequest.from_buffer_copy(data)
        asked.count = min(asked.count, abi.MAX_BUFFERS)
        self._buffers = [_DriverBuffer() for _ in range(asked.count)]
        self._owner = handle if asked.count else 0
        return bytes(asked)

    def query_buffer(self, _handle: int, data: bytes) -> bytes:
        """Place and state of a buffer."""
        return self._described(self._index(data))

    def queue_buffer(self, handle: int, data: bytes) -> bytes:
        """Take a buffer to be filled."""
        index = self._index(data)
        if handle != self._owner or index in self._queued or index in self._done:
            raise OSError(errno.EINVAL, "not the program's")
        self._buffers[index].flags = abi.BUF_MAPPED | abi.BUF_QUEUED
        self._queued.append(index)
        return self._described(index)

    def dequeue_buffer(self, handle: int, _data: bytes) -> bytes:
        """Hand over the oldest filled buffer."""
        if not self.streaming or handle != self._owner:
            raise OSError(errno.EINVAL, "no stream")
        if not self._done:
            raise OSError(errno.EAGAIN, "no image yet")
        index = self._done.popleft()
        described = self._described(index)
        self._buffers[index].flags = abi.BUF_MAPPED
        return described

    def stream_on(self, handle: int, _data: bytes) -> bytes:
        """Start the stream."""
        if handle != self._owner or not self._buffers:
            raise OSError(errno.EINVAL, "no buffers")
        if not self.streaming:
            self.streaming = True
            self.on_stream(True)
        return b""

    def stream_off(self, handle: int, _data: bytes) -> bytes:
        """Stop the stream, and take back every buffer."""
        if handle == self._owner:
            self._stop()
        return b""

    def _index(self, data: bytes) -> int:
        (index,) = struct.unpack_from("<I", data)
        if index >= len(self._buffers):
            raise OSError(errno.EINVAL, "no such buffer")
        return index

    def _described(self, index: int) -> bytes:
        state = self._buffers[index]
        return bytes(
            abi.Buffer(
                index=index,
                type=abi.VIDEO_CAPTURE,
                bytesused=state.bytes_used,
                flags=state.flags | self.stamp_flags,
                field=abi.FIELD_NONE,
                seconds=state.stamp_ns // 1_000_000_000,
                microseconds=state.stamp_ns % 1_000_000_000 // 1000,
                sequence=state.sequence,
                memory=abi.MEMORY_MMAP,
                offset=index * self.buffer_bytes,
                length=self.buffer_bytes,
            )
        )


_ANSWERS: dict[int, Callable[[VideoDriver, int, bytes], bytes]] = {
    abi.QUERYCAP: VideoDriver.query,
    abi.ENUM_FMT: VideoDriver.enumerate_formats,
    abi.G_FMT: VideoDriver.get_format,
    abi.S_FMT: VideoDriver.set_format,
    abi.G_PARM: VideoDriver.get_parameters,
    abi.S_PARM: VideoDriver.set_parameters,
    abi.QUERYCTRL: VideoDriver.query_control,
    abi.G_CTRL: VideoDriver.get_control,
    abi.S_CTRL: VideoDriver.set_control,
    abi.REQBUFS: VideoDriver.request_buffers,
    abi.QUERYBUF: VideoDriver.query_buffer,
    abi.QBUF: VideoDriver.queue_buffer,
    abi.DQBUF: VideoDriver.dequeue_buffer,
    abi.STREAMON: VideoDriver.stream_on,
    abi.STREAMOFF: VideoDriver.stream_off,
}
"""answers by request number"""
