"""Virtual webcam: a video device (V4L2) that this process serves, with rendered images.

Exposure slot n starts n frame periods after the start of the stream. A render thread draws each slot's image
as soon as the source has data for its whole exposure, and stores it in the next buffer that the program has
queued. Without a queued buffer the image is lost, as with a real driver: only its number is missing. A camera
that is behind, because the computer is slow, sends at twice its frame rate, never faster.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from acquire.camera import v4l2_abi as abi
from acquire.virtual.camera_statistics import CameraStatistics, CountedSource
from acquire.virtual.fuse_file import FuseFile
from acquire.virtual.image_source import ImageSource, StreamSettings
from acquire.virtual.video_driver import VideoDriver

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from acquire.clock.clock import Clock

NAME = "video0"
_GAIN_STEP_DB = 0.1
"""gain of a step of the control above its minimum [dB]"""
_JPEG_QUALITY = 90


@dataclass(frozen=True)
class WebcamHabits:
    """What differs among webcams and their drivers: formats, and the instant of the stamps."""

    codes: tuple[str, ...] = ("GREY", "YUYV", "MJPG")
    """pixel formats that it offers"""
    stamps_frame_end: bool = False
    """True if the end of the frame is stamped, as most drivers do; False: the start of the exposure"""
    readout_ns: int = 0
    """time from the first row's exposure to the last row's [ns], which is before the end of the frame; all
    rows of the image are drawn as at the middle one"""


class VirtualVideoCamera:
    """Virtual webcam, in operation from construction to `close`.

    Does not model: optics (the source does), the rolling shutter's distortion, the USB bus.

    Args:
        width: width of the sensor [px].
        height: height of the sensor [px].
        source: source of its images.
        clock: the host's clock, which stamps the frames.
        habits: its formats and stamps.

    Raises:
        CameraError: this user may not make a device.
    """

    def __init__(
        self, width: int, height: int, source: ImageSource, clock: Clock, habits: WebcamHabits | None = None
    ) -> None:
        habits = habits or WebcamHabits()
        self._source, self._clock, self._habits = source, clock, habits
        self._condition = threading.Condition()
        self._closed = False
        self._run = 0
        self._counted = CountedSource(source, clock)
        stamp = 0 if habits.stamps_frame_end else abi.STAMP_START_OF_EXPOSURE
        self._driver = VideoDriver(
            width, height, habits.codes, abi.TIMESTAMP_MONOTONIC | stamp, on_stream=self._on_stream
        )
        self._file = FuseFile(NAME, self)
        self._renderer = threading.Thread(target=self._render, name="video-render")
        self._renderer.start()

    @property
    def path(self) -> str:
        """Path of the device while this process runs."""
        return self._file.path

    @property
    def packet_counts(self) -> dict[str, int]:
        """Numbers of stream packets: none, images travel in memory."""
        return {}

    @property
    def statistics(self) -> CameraStatistics:
        """Frames handed over, mean rendering time and largest delay [ms], late images."""
        return self._counted.statistics

    def link(self, path: Path) -> None:
        """Make a link to the device, by which it has a lasting name."""
        path.unlink(missing_ok=True)
        path.symlink_to(self.path)

    def close(self) -> None:
        """Unplug the camera: programs that have it open find it gone. May be repeated."""
        with self._condition:
            if self._closed:
                return
            self._closed = True
            self._condition.notify_all()
        self._renderer.join()
        self._file.close()

    # --- requests, on the file's thread ---

    def release(self, handle: int) -> None:
        """Close the device for the program that opened it as number `handle`."""
        with self._condition:
            self._driver.release(handle)

    def ioctl(self, handle: int, request: int, data: bytes) -> bytes:
        """Answer of a request of V4L2."""
        with self._condition:
            return self._driver.ioctl(handle, request, data)

    def events(self, handle: int) -> int:
        """Present events of poll."""
        with self._condition:
            return self._driver.events(handle)

    # --- images, on the render thread ---

    def _on_stream(self, _on: bool) -> None:
        self._run += 1
        self._condition.notify_all()

    def _render(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._driver.streaming or self._closed)
                if self._closed:
                    return
                run, driver = self._run, self._driver
                period_ns, exposure_ns = round(1e9 / driver.rate_hz), round(driver.exposure_us * 1e3)
                gain = driver.controls[abi.CID_GAIN]
                settings = StreamSettings(
                    driver.width,
                    driver.height,
                    0,
                    0,
                    driver.exposure_us,
                    (gain.value - gain.minimum) * _GAIN_STEP_DB,
                )
            start_ns, number = self._clock.monotonic_ns(), 0
            sent_ns = start_ns
            self._counted.begin_stream()
            while self._wait_until_covered(start_ns + exposure_ns, run):
                image = self._counted.image(start_ns, settings, period_ns)
                self._clock.sleep((sent_ns + period_ns // 2 - self._clock.monotonic_ns()) * 1e-9)
                sent_ns = self._clock.monotonic_ns()
                self._deliver(image, self._stamp_ns(start_ns, exposure_ns), number, run)
                start_ns, number = start_ns + period_ns, number + 1
            self._counted.end_stream(start_ns, exposure_ns, period_ns)

    def _stamp_ns(self, start_ns: int, exposure_ns: int) -> int:
        """Stamp of a frame [ns] whose middle row's exposure starts at `start_ns` [ns]."""
        half_ns = self._habits.readout_ns // 2
        if self._habits.stamps_frame_end:
            return start_ns + half_ns + exposure_ns
        return start_ns - half_ns

    def _deliver(self, image: NDArray[np.uint8], stamp_ns: int, number: int, run: int) -> None:
        with self._condition:
            if run != self._run:
                return
            index, driver = self._driver.next_buffer(), self._driver
            code, size, offset = driver.code, driver.buffer_bytes, (index or 0) * driver.buffer_bytes
        if index is None:
            return
        content = _encoded(image, code)
        pages = np.zeros(size, np.uint8)
        pages[: len(content)] = content
        try:
            self._file.store(offset, pages)
        except OSError:  # no program has the device open any more
            return
        with self._condition:
            if run == self._run:
                self._driver.filled(index, len(content), stamp_ns, number)
                self._counted.frames += 1
        self._file.notify()

    def _wait_until_covered(self, end_ns: int, run: int) -> bool:
        """True once the source can render up to `end_ns` (host monotonic) [ns]; False if the stream ended."""
        while self._driver.streaming and run == self._run and not self._closed:
            wait_ns = end_ns - self._clock.monotonic_ns()
            if wait_ns <= 0:
                if self._source.latest_time_ns() >= end_ns:
                    return True
                wait_ns = 500_000
            self._clock.sleep(min(wait_ns, 50_000_000) / 1e9)
        return False


def _encoded(image: NDArray[np.uint8], code: str) -> NDArray[np.uint8]:
    """Bytes (n,), uint8, of a grey image in a pixel format."""
    if code == "MJPG":
        done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
        return np.asarray(data, np.uint8).ravel() if done else np.empty(0, np.uint8)
    if code == "YUYV":
        pairs = np.full((*image.shape, 2), 128, np.uint8)
        pairs[..., 0] = image
        return pairs.ravel()
    return image.ravel()
