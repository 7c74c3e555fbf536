"""Keeps one camera streaming: reads frames, maps their times to the host's clock, latches, reconnects when the camera is lost."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from acquire.camera.base import Camera, CameraInfo, ClockReading, Frame
from acquire.clock.clock import Clock, DeviceClockMapper
from acquire.errors import CameraError, CameraLost

if TYPE_CHECKING:
    from acquire.config import CameraConfig

LATCH_S: Final = 0.5
FIRST_LATCH_S: Final = 0.1
"""between latches while the readings span less than `SPAN_S`: the drift is known only as well as they lie apart"""
SPAN_S: Final = 2.0
FIRST_LATCHES: Final = 25
"""before and after the camera is started, which may take long: the first frames have nothing else, so one of them must be quick"""
LATCH_TRIES: Final = 8
"""one after the other, until one is about as quick as the quickest (Cristian 1989)"""
QUICK: Final = 1.3
TELL_LOSSES_NS: Final = 1_000_000_000
RETRY_S: Final = 0.5
READ_TIMEOUT_S: Final = 0.1


class FrameLease:
    """The buffer of one frame: a Lender (recorder/lent_queue.py)."""

    __slots__ = ("_camera", "_frame", "kept")

    def __init__(self, camera: Camera, frame: Frame) -> None:
        self._camera, self._frame = camera, frame
        self.kept = False

    @property
    def pixels(self) -> memoryview:
        """The image's bytes; they begin on a page of the memory."""
        return self._frame.image.data.cast("B")

    def keep(self) -> bool:
        """The image stays as it is until `release`; False: no buffer can take its place."""
        self.kept = self._camera.keep(self._frame)
        return self.kept

    def release(self) -> None:
        """Once, after `keep`; from any thread."""
        self._camera.release(self._frame)


@dataclass(frozen=True)
class TimedFrame:
    """A frame of this stream with its times on the host's clock."""

    frame: Frame
    sequence: int
    """counts frames that arrived since the stream began, across reconnections"""
    mid_exposure_ns: int
    """host monotonic"""
    mapping_sd_ns: int
    lost_before: int
    lease: FrameLease | None = None
    """where the camera can keep frames"""


@dataclass(frozen=True)
class StreamStatus:
    """How the camera does."""

    connected: bool
    frames: int
    lost: int
    fps: float
    last_frame_ns: int | None
    """host monotonic, of the newest frame's mid-exposure"""
    receive_buffer_bytes: int
    latched: bool
    """times are mapped from the camera's own clock; else they are arrival times"""
    trouble: str
    """why there are no frames; empty while the camera is there"""
    warnings: tuple[str, ...]
    """the camera's"""


class CameraStream:
    """Two threads: one pops frames, one latches the clock, because a latch waits for an answer on the wire.

    `on_frame` is called on the first for every complete frame, `on_clock` on the second, `on_text` on the first: the camera's warnings,
    its loss and return, and frames lost in between (gathered, once a second).
    """

    def __init__(
        self,
        make_camera: Callable[[], Camera],
        config: CameraConfig,
        clock: Clock,
        on_frame: Callable[[TimedFrame], None],
        on_clock: Callable[[ClockReading], None],
        on_text: Callable[[str], None],
    ) -> None:
        self._make = make_camera
        self._config = config
        self._clock = clock
        self._on_frame, self._on_clock, self._on_text = on_frame, on_clock, on_text
        self._period_ns = 1e9 / config.frame_rate_hz
        self._stopping = threading.Event()
        self._latch_now = threading.Event()
        self._opened = threading.Event()
        self._failure: CameraError | None = None
        self._info: CameraInfo | None = None
        self._camera: Camera | None = None
        self._connected = False
        self._spare_buffers = 0
        self._mapper = DeviceClockMapper()
        self._sequence = 0
        self._lost = self._lost_told = 0
        self._told_ns = 0
        self._trouble = ""
        self._warnings: tuple[str, ...] = ()
        self._recent: deque[int] = deque(maxlen=round(config.frame_rate_hz) + 1)
        self._arrived_ns: int | None = None
        self._threads: list[threading.Thread] = []

    def start(self) -> CameraInfo:
        """Open the camera and stream.

        Raises:
            CameraError: what `Camera.open` raises.
        """
        self._threads = [
            threading.Thread(target=self._acquire, name="camera-frames"),
            threading.Thread(target=self._latch, name="camera-clock"),
        ]
        self._threads[0].start()
        self._opened.wait()
        if self._info is None:
            self._threads[0].join()
            raise self._failure or CameraLost(f"camera {self._config.address}: stopped while it was opened")
        self._threads[1].start()
        return self._info

    def stop(self) -> None:
        """End both threads and release the camera."""
        self._stopping.set()
        self._latch_now.set()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join()

    @property
    def spare_buffers(self) -> int:
        """The camera's; frames have a lease where there are any."""
        return self._spare_buffers

    def latch(self) -> None:
        """Have the clock latched soon, not only at the next half second."""
        self._latch_now.set()

    def status(self) -> StreamStatus:
        """How the camera does now."""
        recent = list(self._recent)
        span = recent[-1] - recent[0] if len(recent) > 1 else 0
        return StreamStatus(
            connected=self._connected,
            frames=self._sequence,
            lost=self._lost,
            fps=(len(recent) - 1) * 1e9 / span if span else 0.0,
            last_frame_ns=self._arrived_ns,
            receive_buffer_bytes=int(getattr(self._camera, "receive_buffer_bytes", 0)),
            latched=self._mapper.latched,
            trouble=self._trouble,
            warnings=self._warnings,
        )

    # --- acquisition thread ---

    def _acquire(self) -> None:
        try:
            self._connect()
        except CameraError as error:
            self._failure = error
            return
        finally:
            self._opened.set()
        while not self._stopping.is_set():
            try:
                self._stream()
            except CameraLost as error:
                self._trouble = f"camera lost: {error}"
                self._tell_losses()
                self._on_text(self._trouble)
                self._disconnect()
                self._reconnect()
        self._disconnect()

    def _connect(self) -> None:
        camera = self._make()
        try:
            info = camera.open()
            mapper = DeviceClockMapper()
            _latch_first(camera, mapper)
            camera.start()
            _latch_first(camera, mapper)
        except CameraError:
            camera.close()
            raise
        self._mapper = mapper
        self._info, self._camera, self._connected = info, camera, True
        self._spare_buffers = camera.spare_buffers
        self._trouble, self._warnings = "", camera.warnings

    def _disconnect(self) -> None:
        camera, self._camera, self._connected = self._camera, None, False
        if camera is not None:
            with contextlib.suppress(CameraError):
                camera.stop()
            camera.close()

    def _reconnect(self) -> None:
        while not self._stopping.wait(RETRY_S):
            try:
                self._connect()
            except CameraError:
                continue
            self._on_text("camera is back")
            for warning in self._warnings:
                self._on_text(warning)
            self._latch_now.set()
            return

    def _stream(self) -> None:
        camera = self._camera
        if camera is None:
            return
        first, keeps = True, self._spare_buffers > 0
        while not self._stopping.is_set():
            frame = camera.read(READ_TIMEOUT_S)
            if self._lost > self._lost_told and self._clock.monotonic_ns() > self._told_ns + TELL_LOSSES_NS:
                self._tell_losses()
            if frame is None:
                continue
            lease = FrameLease(camera, frame) if keeps else None
            try:
                self._on_frame(self._timed(frame, lease, first=first))
            finally:
                if lease is None or not lease.kept:
                    camera.release(frame)
            first = False

    def _tell_losses(self) -> None:
        if lost := self._lost - self._lost_told:
            self._on_text(f"{lost} frames lost before frame {self._sequence}, {self._lost} in all")
            self._lost_told, self._told_ns = self._lost, self._clock.monotonic_ns()

    def _timed(self, frame: Frame, lease: FrameLease | None, *, first: bool) -> TimedFrame:
        mapper = self._mapper
        mapper.add_arrival(frame.device_time_ns, frame.host_time_ns)  # no effect where the clock is latched
        mid = mapper.to_host(frame.device_time_ns) + round(frame.exposure_us * 500.0)
        lost = frame.lost_before
        if first and self._recent:
            # Nobody counted while the camera was away: the gap in time does.
            lost = max(0, round((mid - self._recent[-1]) / self._period_ns) - 1)
        self._recent.append(mid)
        self._arrived_ns = self._clock.monotonic_ns()  # a camera that is far behind is alive
        timed = TimedFrame(frame, self._sequence, mid, mapper.sd_at(frame.device_time_ns), lost, lease)
        self._sequence += 1
        self._lost += lost
        return timed

    # --- clock thread ---

    def _latch(self) -> None:
        while not self._stopping.is_set():
            self._latch_now.wait(LATCH_S if self._mapper.span_s > SPAN_S else FIRST_LATCH_S)
            self._latch_now.clear()
            camera, mapper = self._camera, self._mapper
            for _ in range(LATCH_TRIES):
                if camera is None or self._stopping.is_set():
                    break
                try:
                    reading = camera.latch_clock()
                except CameraError:
                    break  # the acquisition thread notices by itself, by the frames that stay away
                if reading is None:
                    break
                mapper.add(reading)
                self._on_clock(reading)
                if reading.host_after_ns - reading.host_before_ns <= QUICK * mapper.shortest_round_trip_ns:
                    break


def _latch_first(camera: Camera, mapper: DeviceClockMapper) -> None:
    for _ in range(FIRST_LATCHES):
        if (reading := camera.latch_clock()) is None:
            return
        mapper.add(reading)
