"""Virtual USB3 Vision camera: a USB device that this process serves, with rendered images.

Aravis reaches it through a stand-in for libusb (usb_library.c). Exposure slot n starts n frame periods after
the start of the acquisition, by the camera's own clock. A render thread draws each slot's image as soon as
the source has data for its whole exposure. The camera keeps some images until the computer asks for them;
when it has no room, an image is lost, and its number with it. A slow computer draws images late, never fewer;
a camera that is behind sends at twice its frame rate, never faster.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np

from acquire.virtual.camera_statistics import CameraStatistics, CountedSource
from acquire.virtual.device_clock import DeviceClock
from acquire.virtual.image_source import ImageSource, StreamSettings
from acquire.virtual.usb3_features import (
    ACQUISITION,
    DB_SCALE,
    DEFAULTS,
    EXPOSURE_US,
    GAIN,
    HEIGHT,
    LIMIT,
    LIMIT_MODE,
    LOAD,
    LOCKED,
    MONO8,
    OFFSET_X,
    OFFSET_Y,
    PERIOD_US,
    WIDTH,
    Usb3Habits,
    description,
    device_guid,
    first_values,
)
from acquire.virtual.usb3_registers import (
    ACCESS_DENIED,
    LEADER,
    STREAM_ENABLE,
    TIMESTAMP_LATCH,
    TRAILER,
    WRITE_PROTECT,
    ControlChannel,
    RegisterError,
    Registers,
)
from acquire.virtual.usb_device import STREAM_IN, UsbDevice
from acquire.virtual.usb_library import SOCKET

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from acquire.clock.clock import Clock

_IMAGE = 1
"""payload type of a leader"""
_PACKETS = 3
"""packets of a frame: leader, image, trailer"""


class VirtualUsb3Camera:
    """Virtual USB3 Vision camera, plugged in from construction to `close`.

    Does not model: optics (the source does), events, chunks, a trigger's pulses.

    Args:
        folder: folder of the stand-in for libusb, in which the device's socket is made.
        serial: serial number that it reports.
        size: width and height of its sensor [px].
        source: source of its images.
        clock: the host's clock.
        habits: what is its own, and what is wrong with it.

    Raises:
        CameraError: the socket cannot be made.
    """

    def __init__(
        self,
        folder: Path,
        serial: str,
        size: tuple[int, int],
        source: ImageSource,
        clock: Clock,
        habits: Usb3Habits | None = None,
    ) -> None:
        self._habits = habits = habits or Usb3Habits()
        self.device_clock = DeviceClock(clock)
        self._source, self._clock = source, clock
        self._condition = threading.Condition()
        self._streaming, self._closed = habits.left_streaming, False
        self._run = self._without_room = 0
        self._counted = CountedSource(source, clock)
        texts = {
            "DeviceVendorName": habits.vendor,
            "DeviceModelName": habits.model,
            "DeviceFamilyName": "USB3",
            "DeviceVersion": "1",
            "DeviceID": serial,
        }
        self._registers = Registers(description(habits, *size), texts)
        self._load(first_values(habits, *size))
        control = ControlChannel(self._registers, self._on_write)
        strings = (habits.vendor, habits.model, serial, device_guid(serial), "USB3")
        self._device = UsbDevice(folder / SOCKET, strings, control.answer, habits.open_status)
        self._renderer = threading.Thread(target=self._render, name="usb3-render")
        self._renderer.start()

    @property
    def packet_counts(self) -> dict[str, int]:
        """Number of images that were lost in the camera, as its memory was full; no packet is lost."""
        return {"memory_full": self._without_room}

    @property
    def statistics(self) -> CameraStatistics:
        """Frames handed over, mean rendering time and largest delay [ms], late images."""
        return self._counted.statistics

    def register(self, address: int) -> int:
        """Value of the 32-bit register at `address`."""
        return self._registers.integer(address)

    def close(self) -> None:
        """Unplug the camera: programs that have it open find it gone. May be repeated."""
        with self._condition:
            if self._closed:
                return
            self._closed = True
            self._condition.notify_all()
        self._device.close()
        self._renderer.join()

    # --- commands, on the device's thread ---

    def _on_write(self, address: int, value: int) -> bool:
        """React to a client's write of a register; True if it takes long.

        Raises:
            RegisterError: the register cannot be written now.
        """
        if self._streaming and address in LOCKED:
            raise RegisterError(ACCESS_DENIED)
        if self._habits.limit_locked and address in (LIMIT, LIMIT_MODE):
            raise RegisterError(WRITE_PROTECT)
        if address == TIMESTAMP_LATCH:
            self._registers.set_timestamp(self.device_clock.now_ns())
        elif address == ACQUISITION:
            self._set_streaming(value == 1)
        elif address == STREAM_ENABLE and not value & 1:
            self._device.drop_packets(STREAM_IN)
        elif address == LOAD:
            self._load(DEFAULTS | {LIMIT: self._habits.limit_bytes_s, LIMIT_MODE: 1})
            return True
        elif address in (WIDTH, HEIGHT):
            other = self._registers.integer(WIDTH if address == HEIGHT else HEIGHT)
            self._registers.set_payload(value * other)
        return False

    def _load(self, values: dict[int, int]) -> None:
        for address, value in values.items():
            self._registers.set_integer(address, value)
        size = self._registers.integer(WIDTH) * self._registers.integer(HEIGHT)
        self._registers.set_payload(size)

    def _set_streaming(self, streaming: bool) -> None:
        with self._condition:
            self._streaming = streaming
            self._run += 1
            self._condition.notify_all()

    # --- images, on the render thread ---

    def _settings(self) -> StreamSettings:
        read = self._registers.integer
        return StreamSettings(
            width=read(WIDTH),
            height=read(HEIGHT),
            offset_x=read(OFFSET_X),
            offset_y=read(OFFSET_Y),
            exposure_us=float(read(EXPOSURE_US)),
            gain_db=(read(GAIN) - 1) / DB_SCALE,
        )

    def _render(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._streaming or self._closed)
                if self._closed:
                    return
                run = self._run
            settings = self._settings()
            period_ns = self._registers.integer(PERIOD_US) * 1000
            exposure_ns = round(settings.exposure_us * 1e3)
            wire_ns = round(settings.width * settings.height / self._habits.port_bytes_s * 1e9)
            interval_ns = max(wire_ns, period_ns // 2)
            stamp_ns, number, sent_ns = self.device_clock.now_ns(), 0, 0
            self._counted.begin_stream()
            while self._wait_until_covered(self.device_clock.to_host(stamp_ns) + exposure_ns, run):
                start_ns = self.device_clock.to_host(stamp_ns)
                image = self._counted.image(start_ns, settings, period_ns)
                self._clock.sleep(max(0, sent_ns + interval_ns - self._clock.monotonic_ns()) * 1e-9)
                sent_ns = self._clock.monotonic_ns()
                self._deliver(image, stamp_ns + exposure_ns * self._habits.stamps_end, number, settings)
                stamp_ns, number = stamp_ns + period_ns, number + 1
            self._counted.end_stream(self.device_clock.to_host(stamp_ns), exposure_ns, period_ns)

    def _deliver(
        self, image: NDArray[np.uint8], stamp_ns: int, number: int, settings: StreamSettings
    ) -> None:
        if self._device.unsent_packets(STREAM_IN) >= _PACKETS * self._habits.memory_frames:
            self._without_room += 1
            return
        region = (settings.width, settings.height, settings.offset_x, settings.offset_y)
        leader = LEADER.pack(b"U3VL", 0, LEADER.size, number, 0, _IMAGE, stamp_ns, MONO8, *region, 0, 0)
        content = np.ascontiguousarray(image).reshape(-1)
        if _is_every(number, self._habits.cut_every):
            content = content[: content.size // 2]
        trailer = TRAILER.pack(b"U3VT", 0, TRAILER.size, number, 0, 0, content.size, settings.height)
        packets = [leader, content.data, trailer]
        if _is_every(number, self._habits.lacks_trailer_every):
            del packets[-1]
        self._device.send(STREAM_IN, *packets)
        self._counted.frames += 1

    def _wait_until_covered(self, end_ns: int, run: int) -> bool:
        """True once the source can render up to `end_ns` (host monotonic) [ns]; False if the stream ended."""
        while self._streaming and run == self._run and not self._closed:
            wait_ns = end_ns - self._clock.monotonic_ns()
            if wait_ns <= 0:
                if self._source.latest_time_ns() >= end_ns:
                    return True
                wait_ns = 500_000
            self._clock.sleep(min(wait_ns, 50_000_000) / 1e9)
        return False


def _is_every(number: int, count: int) -> bool:
    """True for the last of every `count` frames; False for all if `count` is 0."""
    return count > 0 and number % count == count - 1
