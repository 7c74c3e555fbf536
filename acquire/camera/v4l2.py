"""Camera of the kernel's video interface (V4L2): webcams (UVC) and others with a file /dev/video0."""

from __future__ import annotations

import errno
import threading
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Final

import cv2
import numpy as np

from acquire.camera import v4l2_abi as abi
from acquire.camera.base import Camera, CameraInfo
from acquire.camera.frame_loss import FrameLoss
from acquire.camera.v4l2_device import V4l2Device
from acquire.camera.v4l2_settings import StreamFormat, busy, write_v4l2_settings
from acquire.camera.v4l2_stamp import StampedInstant, stamped_instant
from acquire.clock.reading import ClockReading
from acquire.errors import CameraError, CameraLost
from acquire.frames.buffer_pool import BufferPool
from acquire.frames.frame import Frame
from schemas.wording import counted

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.clock.clock import Clock
    from schemas.rig import CameraConfig

_LONGEST_WAIT_S: Final = 0.1
_SYSTEM_DEVICES: Final = Path("/sys/class/video4linux")


class V4l2Camera(Camera):
    """A camera of the kernel's video interface. Order of calls: open, start, read (repeatedly), stop, close.

    The driver fills its own buffers. Each image is copied from there into a buffer of the pool, and the
    driver's buffer is queued again at once, so that what the recorder keeps never makes the driver wait.

    Args:
        config: section `camera` of the rig file.
        clock: the host's clock.
        borrowable_frames: number of frames whose buffers may be borrowed (kept after the next read) at a
            time; these buffers are in addition to those of the configuration.
    """

    def __init__(self, config: CameraConfig, clock: Clock, borrowable_frames: int = 0) -> None:
        """Prepare a camera whose device is not opened yet."""
        self._config, self._clock = config, clock
        self._borrowable_frames = borrowable_frames
        self._device: V4l2Device | None = None
        self._memory: BufferPool | None = None
        self._free: deque[int] = deque()
        self._closing = threading.Lock()
        self._format = StreamFormat("", 0, config.exposure_us, config.frame_rate_hz)
        self._stamped = StampedInstant(False, 0, "")
        self._driver_buffers = 0
        self._loss = FrameLoss(config.frame_rate_hz)
        self._streaming = False
        self._sequence = 0
        self._last_frame_ns = 0
        self.incomplete_frames = 0
        """frames that the driver marked as faulty, or that could not be decoded; they count as lost too"""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Line on how well the frames' times are known, if there is anything to say; empty before `open`."""
        return (self._stamped.warning,) if self._stamped.warning else ()

    @property
    def borrowable_frames(self) -> int:
        """Number of frames whose buffers may be borrowed (kept after the next read) at a time."""
        return self._borrowable_frames

    def open(self) -> CameraInfo:
        """Open the device, write every setting of the rig file, read it back and compare.

        Returns:
            The camera's identity: driver, name, serial number or place on the bus, and path of the device.

        Raises:
            CameraNotFound: there is no such device.
            CameraSettingError: a setting is refused or reads back differently.
            CameraError: another program uses the camera, or it has no images that could be used.
        """
        path = self._config.address
        device = V4l2Device(path)
        try:
            _refuse_other_devices(device)
            self._format = write_v4l2_settings(device, self._config)
            self._driver_buffers = device.map_buffers(min(self._config.buffers, abi.MAX_BUFFERS))
            found = device.capability
            driver = _text(found.driver)
            self._stamped = stamped_instant(
                driver, device.buffer_flags(), self._config, self._format.exposure_us
            )
            self._memory = BufferPool(
                self._config.buffers,
                self._borrowable_frames,
                self._config.width * self._config.height,
                requeue=self._free.append,
            )
        except OSError as error:
            device.close()
            if error.errno == errno.EBUSY:
                raise busy(path) from None
            raise CameraError(
                f"camera {path} failed while it was set up ({error.strerror}): unplug it and plug it in again"
            ) from None
        except BaseException:
            device.close()
            raise
        self._free.extend(range(self._memory.circulating))
        self._device = device
        serial = _serial_number(path) or _text(found.bus_info)
        return CameraInfo(driver, _text(found.card), serial, path, kind="v4l2")

    def start(self) -> None:
        """Start the stream; frames and losses are counted from 0 again.

        Raises:
            CameraLost: the camera is gone.
            CameraError: the camera is not open.
        """
        device = self._opened()
        self._loss = FrameLoss(self._format.frame_rate_hz)
        self._sequence = self.incomplete_frames = 0
        try:
            for index in range(self._driver_buffers):
                device.queue(index)
            device.stream(on=True)
        except OSError as error:
            raise self._lost_error(error.strerror or "its driver refuses") from None
        self._streaming = True
        self._last_frame_ns = self._clock.monotonic_ns()

    def read(self, timeout_s: float) -> Frame | None:
        """Next complete frame of the stream, or None if none arrived within `timeout_s` [s].

        The frame holds a grey image, and on the host's monotonic clock [ns] the start of its exposure (of its
        middle row) and its arrival. Images for which no buffer is free are dropped, and counted as lost.

        Raises:
            CameraLost: the camera is gone, or sent no complete frame for the configured `stall_s`.
            CameraError: the camera is not open.
        """
        device = self._opened()
        deadline_ns = self._clock.monotonic_ns() + round(timeout_s * 1e9)
        while True:
            left_s = (deadline_ns - self._clock.monotonic_ns()) * 1e-9
            if not self._streaming:
                self._clock.sleep(left_s)
                return None
            try:
                buffer = device.dequeue()
                if buffer is not None:
                    frame = self._frame(device, buffer)
                    device.queue(buffer.index)
                    if frame is not None:
                        return frame
                elif left_s > 0:
                    device.wait(min(left_s, _LONGEST_WAIT_S))
            except OSError as error:
                raise self._lost_error(error.strerror or "its driver refuses") from None
            self._check_alive()
            if left_s <= 0:
                return None

    def latch_clock(self) -> ClockReading | None:
        """Reading of the clock that stamps the frames: the host's monotonic clock.

        Returns:
            Its time, between two host times [ns]; None if frames have no stamps of that clock, or the camera
            is not open.
        """
        if self._device is None or not self._stamped.monotonic:
            return None
        before_ns = self._clock.monotonic_ns()
        device_ns = self._clock.monotonic_ns()
        return ClockReading(device_ns, before_ns, max(self._clock.monotonic_ns(), before_ns + 1))

    def stop(self) -> None:
        """Stop the stream and drop the frames that were not read; do nothing if the camera is gone.

        Raises:
            CameraError: the camera is not open.
        """
        device = self._opened()
        self._streaming = False
        try:
            device.stream(on=False)
        except OSError:
            return

    def close(self) -> None:
        """Release the camera. Never raises, and may be repeated."""
        with self._closing:
            device, self._device = self._device, None
        self._streaming = False
        if self._memory is not None:
            self._memory.close()
        if device is not None:
            device.close()

    def _opened(self) -> V4l2Device:
        if self._device is None:
            raise CameraError(f"camera {self._config.address} is not open")
        return self._device

    def _lost_error(self, why: str) -> CameraLost:
        self._streaming = False
        return CameraLost(
            f"camera {self._config.address} was lost: {why}: check its cable, then connect again"
        )

    def _check_alive(self) -> None:
        stalled_s = (self._clock.monotonic_ns() - self._last_frame_ns) * 1e-9
        if stalled_s > self._config.stall_s:
            faulty = (
                f" ({counted(self.incomplete_frames, 'frame')} arrived incomplete: use a USB port of its own)"
            )
            raise self._lost_error(
                f"no frame for {stalled_s:.1f} s{faulty if self.incomplete_frames else ''}"
            )

    def _frame(self, device: V4l2Device, buffer: abi.Buffer) -> Frame | None:
        now_ns = self._clock.monotonic_ns()
        memory = self._memory
        if buffer.flags & abi.BUF_ERROR:
            self.incomplete_frames += 1
            return None
        if memory is None or not self._free:
            # The camera lives, but all buffers are in use: the image is dropped.
            self._last_frame_ns = now_ns
            return None
        grey = self._grey(device.image_bytes(buffer.index), buffer.bytesused)
        if grey is None:
            self.incomplete_frames += 1
            return None
        slot = self._free.popleft()
        image = memory.image(slot, self._config.width, self._config.height)
        image[:] = grey
        stamp_ns = buffer.seconds * 1_000_000_000 + buffer.microseconds * 1000
        if not self._stamped.monotonic:
            stamp_ns = now_ns
        device_time_ns = stamp_ns + self._stamped.start_offset_ns
        self._last_frame_ns = now_ns
        frame = Frame(
            image=image,
            sequence=self._sequence,
            frame_id=buffer.sequence,
            device_time_ns=device_time_ns,
            host_time_ns=now_ns,
            exposure_us=self._format.exposure_us,
            lost_before=self._loss.before(buffer.sequence, device_time_ns),
            buffer=memory.buffer(slot),
        )
        self._sequence += 1
        return frame

    def _grey(self, data: NDArray[np.uint8], size: int) -> NDArray[np.uint8] | None:
        """Grey image (height, width), uint8, of the bytes in a driver's buffer; None if it is incomplete.

        Of YUYV the luminance is taken, which is every second byte. MJPG is decoded: JPEG rounds the grey
        levels of blocks of 8 x 8 pixels.
        """
        width, height = self._config.width, self._config.height
        if self._format.code == "MJPG":
            decoded = cv2.imdecode(data[:size], cv2.IMREAD_GRAYSCALE) if size else None
            whole = decoded is not None and decoded.shape == (height, width)
            return np.asarray(decoded, np.uint8) if whole else None
        row_bytes, step = self._format.row_bytes, 2 if self._format.code == "YUYV" else 1
        if size < row_bytes * (height - 1) + step * width or len(data) < row_bytes * height:
            return None
        return data[: row_bytes * height].reshape(height, row_bytes)[:, : step * width : step]


def _refuse_other_devices(device: V4l2Device) -> None:
    """Refuse a device file that gives no images in the way that is used here.

    Raises:
        CameraError: it is none of a camera, or its images come in several planes or without streaming.
    """
    abilities = device.abilities
    if abilities & abi.CAP_VIDEO_CAPTURE and abilities & abi.CAP_STREAMING:
        return
    if abilities & abi.CAP_META_CAPTURE:
        reason = "holds a camera's metadata, no images: the images are in a neighbouring /dev/video"
    elif abilities & abi.CAP_VIDEO_CAPTURE_MPLANE:
        reason = "gives images in several planes, or raw from the sensor: use a USB or GigE camera"
    else:
        reason = "gives no images: `acquire discover` lists the cameras"
    raise CameraError(f"camera {device.path} {reason}")


def _text(value: bytes) -> str:
    return value.decode("utf-8", "replace").strip()


def _serial_number(path: str) -> str:
    """Serial number of a USB camera, from the system's description of its device; empty if it has none."""
    name = Path(path).resolve().name
    try:
        return (_SYSTEM_DEVICES / name / "device" / ".." / "serial").read_text(encoding="utf-8").strip()
    except OSError:
        return ""
