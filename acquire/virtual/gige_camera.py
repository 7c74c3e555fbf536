"""Virtual GigE Vision camera: Aravis's fake camera sends rendered images over loopback.

The protocols are the real ones, GVCP (control) and GVSP (stream). Exposure slot n starts n frame periods
after the start of the acquisition, by the camera's own clock. A render thread requests each slot's image as
soon as the image source has data for its whole exposure; the fake's fill callback takes the oldest image that
was not sent yet and waits if there is none. So the slots set the rate, every slot is sent exactly once, and a
slow computer sends late but never fewer frames; a camera that is behind sends at twice its frame rate, never
faster. A source that stalls also stalls the control channel, like a camera that hangs.
"""

from __future__ import annotations

import random
import socket
import tempfile
import threading
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acquire.errors import CameraError
from acquire.virtual import aravis_ctypes
from acquire.virtual.camera_makes import DEFAULTS, TL_LOCK, TRIGGER_MODE
from acquire.virtual.camera_statistics import CameraStatistics, CountedSource
from acquire.virtual.device_clock import DRIFT, DeviceClock
from acquire.virtual.gige_faults import USUAL, CameraHabits
from acquire.virtual.gige_interposer import ControlRelay, StreamRelay, Told
from acquire.virtual.gige_sockets import (
    GVCP_PORT,
    LOOPBACK,
    adopt_fake_sockets,
    claim_control_port,
    descriptors,
    udp_socket,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.clock.clock import Clock
from acquire.virtual.image_source import ImageSource, StreamSettings

SENSOR_WIDTH, SENSOR_HEIGHT = 656, 492
QUEUE_SLOTS = 32
"""number of exposures whose images were not sent yet at which rendering pauses; it catches up later"""
WIRE_BYTES_S = 125e6
"""gigabit data rate [bytes/s]"""
_SENSOR_WIDTH, _SENSOR_HEIGHT, _WIDTH, _HEIGHT = 0x11C, 0x118, 0x100, 0x104
_EXPOSURE_US, _FRAME_PERIOD, _GAIN = 0x120, 0x138, 0x110
_OFFSET_X, _OFFSET_Y, _ACQUISITION, _PRIVILEGE = 0x130, 0x134, 0x124, 0xA00
_VENDOR, _MODEL, _OWN_ADDRESS, _CAPABILITY, _RESEND_BIT = 0x48, 0x68, 0x24, 0x934, 4
_SOURCE_PORT, _TICKS_HIGH, _TICKS_LOW = 0xD1C, 0x93C, 0x940
# Not "Prosilica": Aravis takes vendor-specific code paths for that name.
VENDOR, MODEL = "Allied Vision Technologies", "GUPPY-SIM GE656"


@dataclass(frozen=True)
class _Slot:
    """Rendered image (height, width) of one exposure, with its stamp on the camera's clock [ns]."""

    device_time_ns: int
    image: NDArray[np.uint8]


class VirtualGigeCamera:
    """Virtual GigE Vision camera at a loopback address, in operation from construction to `close`.

    Does not model: optics (the source does), chunk data, PTP, a trigger's delay and jitter, jumbo-frame
    limits.

    Args:
        address: IP address of the camera, 127.x.x.x.
        serial: serial number that it reports.
        source: source of its images.
        clock: the host's clock.
        drift: relative rate error of the camera's clock.
        packet_loss: fraction of stream packets to drop, 0 to 1.
        seed: seed of the packet losses.
        habits: what it does otherwise than Aravis's fake camera.

    Raises:
        CameraError: the control port is in use, the address is not one of this host, libaravis is missing, or
            its fake camera opened no control socket.
    """

    def __init__(
        self,
        address: str,
        serial: str,
        source: ImageSource,
        clock: Clock,
        drift: float = DRIFT,
        packet_loss: float = 0.0,
        seed: int = 0,
        habits: CameraHabits = USUAL,
    ) -> None:
        self._habits, self._make = habits, habits.make
        self.device_clock = DeviceClock(clock, drift)
        self._address, self._source, self._clock = address, source, clock
        self._condition = threading.Condition()
        self._slots: deque[_Slot] = deque()
        self._streaming = self._closed = False
        self._run = 0
        self._wire_free_ns = self._interval_ns = 0
        self._counted = CountedSource(source, clock)
        self._library = aravis_ctypes.load()
        control = claim_control_port(address, clock)
        try:
            self._gv_fake, inner, source_port = self._make_fake(serial)
        except BaseException:
            control.close()
            raise
        self._fake: int = self._library.gv_fake_get_fake(self._gv_fake)
        losses = random.Random(seed)  # noqa: S311 - not a secret
        self._stream = StreamRelay(packet_loss, losses, address) if packet_loss > 0 else None
        self._write_registers(packet_loss, source_port if self._stream is None else self._stream.source_port)
        self._relay = ControlRelay(
            control,
            inner,
            lambda: self._ticks(self.device_clock.now_ns()),
            8333,
            Told(self._on_acquisition, self._on_claim, self._load_user_set),
            habits,
        )
        self._fill_pattern = aravis_ctypes.FILL_PATTERN(self._fill)
        self._library.fake_set_fill_pattern(self._fake, self._fill_pattern, None)
        self._renderer = threading.Thread(target=self._render, name="gige-render")
        self._renderer.start()
        self._relay.start(self._stream)

    @property
    def packet_counts(self) -> dict[str, int]:
        """Numbers of stream packets by what happened to them; empty without packet loss.

        Keys are sent, dropped, resent and resend_missed (a resend was requested, the packet no longer kept);
        a key is missing while its number is 0.
        """
        return {} if self._stream is None else dict(self._stream.counts)

    @property
    def statistics(self) -> CameraStatistics:
        """Frames sent since the camera was made, mean rendering time and largest delay [ms], late images.

        An image counts as late if it was rendered more than two frame periods after its exposure's end.
        """
        return self._counted.statistics

    def close(self) -> None:
        """Remove the camera from the network: end its threads and close its sockets. May be repeated.

        A client finds that the camera no longer answers.
        """
        with self._condition:
            if self._closed:
                return
            self._closed, self._streaming = True, False
            self._condition.notify_all()
        self._renderer.join()
        self._library.object_unref(self._gv_fake)
        self._relay.close()
        if self._stream is not None:
            self._stream.close()

    def _make_fake(self, serial: str) -> tuple[int, socket.socket, int]:
        # The fake is always created on 127.0.0.1 and its sockets are swapped afterwards. While the port there
        # is kept busy the fake does not use it, so that a camera at another address never disturbs the one at
        # 127.0.0.1.
        try:
            guard = udp_socket(LOOPBACK, GVCP_PORT)
        except OSError:
            guard = None
        try:
            before = descriptors()
            gv_fake = self._new_fake(serial)
            try:
                return gv_fake, *adopt_fake_sockets(before, self._address)
            except CameraError:
                self._library.object_unref(gv_fake)
                raise
        finally:
            if guard is not None:
                guard.close()

    def _new_fake(self, serial: str) -> int:
        """Make Aravis's fake camera, with the description of the make."""
        if self._make is None:
            return self._library.gv_fake_new_full(LOOPBACK.encode(), serial.encode(), None)
        with tempfile.NamedTemporaryFile("w", suffix=".xml", encoding="utf-8") as file:
            file.write(self._make.xml(SENSOR_WIDTH, SENSOR_HEIGHT))
            file.flush()
            return self._library.gv_fake_new_full(LOOPBACK.encode(), serial.encode(), file.name.encode())

    def _load_user_set(self) -> None:
        """Load the "Default" user set: what was remembered is gone."""
        for register, value in DEFAULTS.items():
            self._library.write_register(self._fake, register, value)

    def _ticks(self, device_ns: int) -> int:
        """Ticks of the camera's clock at a time on it [ns]."""
        return device_ns * self._habits.ticks_hz // 1_000_000_000

    def _write_registers(self, packet_loss: float, source_port: int) -> None:
        write = self._library.write_register
        for register, value in (
            (_SENSOR_WIDTH, SENSOR_WIDTH),
            (_SENSOR_HEIGHT, SENSOR_HEIGHT),
            (_WIDTH, SENSOR_WIDTH),
            (_HEIGHT, SENSOR_HEIGHT),
            # With a period of 1 us the fake polls once between frames (woken by `poke`) and then waits in the
            # callback; with a longer one it would spin during the last millisecond of each wait.
            (_FRAME_PERIOD, 1),
            (_OWN_ADDRESS, int.from_bytes(socket.inet_aton(self._address))),
            (_SOURCE_PORT, source_port),
        ):
            write(self._fake, register, value)
        if packet_loss > 0:
            write(self._fake, _CAPABILITY, self._library.read_register(self._fake, _CAPABILITY) | _RESEND_BIT)
        make = self._make
        self._library.write_text(self._fake, _VENDOR, 32, VENDOR if make is None else make.vendor)
        self._library.write_text(self._fake, _MODEL, 32, MODEL if make is None else make.model)
        if make is not None:
            low = 1 if make.raw_gain is None else make.raw_gain[0]
            used = DEFAULTS | make.remembered | {TL_LOCK: int(self._habits.faults.left_locked)}
            if self._habits.pulses_hz > 0:
                used[TRIGGER_MODE] = 0  # the relay keeps it: the fake camera runs freely
            for register, value in {**used, _TICKS_HIGH: 0, _TICKS_LOW: make.ticks_hz, _GAIN: low}.items():
                write(self._fake, register, value)

    def _on_acquisition(self, streaming: bool) -> None:
        with self._condition:
            self._streaming = streaming
            self._run += 1
            self._slots.clear()
            self._condition.notify_all()

    def _on_claim(self) -> None:
        """Stop the image stream if no client holds control: the one that started it left without stopping it.

        Called when a client asks for control, before the fake camera grants it.
        """
        if self._library.read_register(self._fake, _PRIVILEGE) == 0:
            self._library.write_register(self._fake, _ACQUISITION, 0)
            self._on_acquisition(False)

    def _settings(self) -> StreamSettings:
        def read(register: int) -> int:
            return self._library.read_register(self._fake, register)

        return StreamSettings(
            width=read(_WIDTH),
            height=read(_HEIGHT),
            offset_x=read(_OFFSET_X),
            offset_y=read(_OFFSET_Y),
            exposure_us=float(read(_EXPOSURE_US)),
            gain_db=float(read(_GAIN)) if self._make is None else self._make.gain_db(read(_GAIN)),
        )

    def _render(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._streaming or self._closed)
                if self._closed:
                    return
                run = self._run
            settings = self._settings()
            period_ns = self._relay.period_us * 1000
            if self._relay.triggered:
                period_ns = round(1e9 / self._habits.pulses_hz)
            exposure_ns = round(settings.exposure_us * 1e3)
            wire_ns = round(settings.width * settings.height / WIRE_BYTES_S * 1e9)
            self._interval_ns = max(wire_ns, period_ns // 2)
            device_time_ns = self.device_clock.now_ns()
            self._counted.begin_stream()
            while self._is_wanted(run):
                start_ns = self.device_clock.to_host(device_time_ns)
                if not self._wait_until_covered(start_ns + exposure_ns, run):
                    break
                image = self._counted.image(start_ns, settings, period_ns)
                stamp_ns = device_time_ns + exposure_ns * self._habits.stamps_end
                self._queue(_Slot(stamp_ns, np.ascontiguousarray(image)), run)
                device_time_ns += period_ns
            self._counted.end_stream(self.device_clock.to_host(device_time_ns), exposure_ns, period_ns)

    def _queue(self, slot: _Slot, run: int) -> None:
        with self._condition:
            self._condition.wait_for(lambda: len(self._slots) < QUEUE_SLOTS or not self._is_wanted(run))
            if self._is_wanted(run):
                self._slots.append(slot)
                self._condition.notify_all()

    def _is_wanted(self, run: int) -> bool:
        """True while the camera streams and `run` is the number of the current stream.

        The number changes with every start and stop, so that a killed client's stream ends at the next start.
        """
        return self._streaming and run == self._run

    def _wait_until_covered(self, end_ns: int, run: int) -> bool:
        """True once the image source can render up to `end_ns` (host monotonic) [ns]; waits for that.

        False if stream number `run` ended before.
        """
        while self._is_wanted(run):
            wait_ns = end_ns - self._clock.monotonic_ns()
            if wait_ns <= 0:
                if self._source.latest_time_ns() >= end_ns:
                    return True
                wait_ns = 500_000
            self._clock.sleep(min(wait_ns, 50_000_000) / 1e9)
        return False

    def _fill(self, buffer: int, _data: object, _exposure_us: int, _gain: int, _pixel_format: int) -> None:
        """Fill an ArvBuffer with the oldest unsent image and its device time; wait if there is none.

        The fake camera's thread calls this and sends the buffer afterwards. If the stream stopped and no
        image is left, the buffer's time is set to 0. Must not raise.
        """
        with self._condition:
            # The fake starts on its own, before the relay has reported the start: only its register
            # distinguishes that from the end of a stream.
            self._condition.wait_for(
                lambda: (
                    self._slots or self._closed or not self._library.read_register(self._fake, _ACQUISITION)
                )
            )
            slot = self._slots.popleft() if self._slots else None
            self._condition.notify_all()
        if slot is not None:
            now_ns = self._clock.monotonic_ns()
            if self._wire_free_ns > now_ns:
                self._clock.sleep((self._wire_free_ns - now_ns) * 1e-9)
            self._wire_free_ns = max(self._wire_free_ns, now_ns) + self._interval_ns
            self._library.fill(buffer, slot.image)
            self._library.buffer_set_timestamp(buffer, self._ticks(slot.device_time_ns))
            self._counted.frames += 1
        else:
            # The fake finishes sending a buffer even when it is stopped, stamped with the wall clock's time.
            # A stamp of 0 distinguishes it from a frame.
            self._library.buffer_set_timestamp(buffer, 0)
        if not self._closed:
            self._relay.poke()
