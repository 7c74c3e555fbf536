"""Stream of one camera: reads frames, maps their times to the host clock, reconnects a lost camera.

A latch makes the camera store its clock's present value, which is then read.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from acquire.camera.base import Camera, CameraInfo
from acquire.clock.clock import Clock, DeviceClockMapper
from acquire.clock.reading import ClockReading
from acquire.errors import CameraError, CameraLost
from schemas.wording import counted

if TYPE_CHECKING:
    from acquire.frames.frame import Frame
    from schemas.rig import CameraConfig

LATCH_S: Final = 0.5
"""interval between latches of the device clock [s]"""
FIRST_LATCH_S: Final = 0.1
"""interval between latches [s] while the clock readings span at most LATCH_SPAN_S: the shorter the span, the
less precise the drift"""
LATCH_SPAN_S: Final = 2.0
"""span of the clock readings above which the clock is latched every LATCH_S [s]"""
FIRST_LATCHES: Final = 25
"""number of latches before the camera's start, and again after it, because the start may take long: the first
frames are mapped by the quickest of them"""
LATCH_TRIES: Final = 8
"""largest number of latches in a row; one that is about as quick as the quickest so far ends them (Cristian
1989)"""
QUICK_RATIO: Final = 1.3
"""round trip of a quick latch, as a multiple of the shortest"""
LOSS_REPORT_NS: Final = 1_000_000_000
"""shortest time between two reports of lost frames [ns]"""
FOREIGN_READ_NS: Final = 200_000_000
"""shortest time between two readings of the count of packets that are not the camera's [ns]"""
FOREIGN_REPORT_NS: Final = 60_000_000_000
"""shortest time between two reports of packets that are not the camera's [ns]"""
RETRY_S: Final = 0.5
"""interval between attempts to reconnect a lost camera [s]"""
READ_TIMEOUT_S: Final = 0.1
"""longest wait for a frame before the thread checks whether it must end [s]"""


@dataclass(frozen=True)
class StreamStatus:
    """State of a camera and its stream: connection, frames read and lost, foreign packets, rate, warnings."""

    connected: bool
    """True if the camera is open and streams"""
    frames: int
    """number of frames read since the start"""
    lost: int
    """number of frames lost since the start"""
    foreign_packets: int
    """number of packets of other senders at the camera's image port since the start; none was used"""
    fps: float
    """frame rate [Hz] over about the last second of frames; 0 with fewer than two"""
    last_frame_ns: int | None
    """host monotonic time at which the newest frame was read [ns]; None before the first"""
    receive_buffer_bytes: int
    """size of the stream's socket buffer [bytes]; 0 if unknown"""
    latched: bool
    """True if times are mapped from the camera's own clock; False: they are arrival times"""
    trouble: str
    """reason why a lost camera sends no frames; empty unless the camera is lost"""
    warnings: tuple[str, ...]
    """limitations reported by the camera"""


class CameraStream:
    """Stream of frames with host times from one camera, on two threads from `start` to `stop`.

    One thread reads frames and reconnects a lost camera. The other latches (reads) the camera's clock,
    because a latch waits for an answer on the wire.

    Args:
        make_camera: function that makes a new, unopened camera; called again for every reconnection.
        config: section `camera` of the rig file.
        clock: the host's clock.
        on_frame: called on the frame thread with every complete frame, its host time set. To keep the image
            it calls `frame.buffer.borrow()`; a buffer that is not borrowed is released when the call returns.
        on_clock: called on the clock thread with every reading of the camera's clock.
        on_text: called on the frame thread with a line when the camera is lost or back, with its warnings
            after a return, for lost frames (collected, once a second), and for packets of other senders
            (once a minute).
    """

    def __init__(
        self,
        make_camera: Callable[[], Camera],
        config: CameraConfig,
        clock: Clock,
        on_frame: Callable[[Frame], None],
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
        self._borrowable_frames = 0
        self._mapper = DeviceClockMapper()
        self._sequence = 0
        self._lost = self._lost_reported = 0
        self._reported_ns = 0
        self._foreign = self._foreign_reported = 0
        self._foreign_read_ns, self._foreign_reported_ns = 0, -FOREIGN_REPORT_NS
        self._trouble = ""
        self._warnings: tuple[str, ...] = ()
        self._recent: deque[int] = deque(maxlen=round(config.frame_rate_hz) + 1)
        self._arrived_ns: int | None = None
        self._threads: list[threading.Thread] = []

    def start(self) -> CameraInfo:
        """Open the camera, and start streaming on both threads.

        Returns:
            The camera's identity: vendor, model, serial number and IP address.

        Raises:
            CameraError: the camera is not found, refuses a setting, is controlled by another program, or no
                longer answers.
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
        """End both threads and release the camera; return when both have ended."""
        self._stopping.set()
        self._latch_now.set()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join()

    @property
    def borrowable_frames(self) -> int:
        """Number of frames whose buffers may be borrowed (kept after `on_frame` returns) at a time.

        It is 0 before `start`.
        """
        return self._borrowable_frames

    def latch(self) -> None:
        """Request a latch (reading) of the camera's clock now instead of at the end of the usual interval."""
        self._latch_now.set()

    def status(self) -> StreamStatus:
        """State of the camera now: connection, frames read and lost since `start`, frame rate, warnings."""
        recent = list(self._recent)
        span = recent[-1] - recent[0] if len(recent) > 1 else 0
        return StreamStatus(
            connected=self._connected,
            frames=self._sequence,
            lost=self._lost,
            foreign_packets=self._foreign,
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
                self._report_losses()
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
        self._borrowable_frames = camera.borrowable_frames
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
        first = True
        while not self._stopping.is_set():
            frame = camera.read(READ_TIMEOUT_S)
            if (
                self._lost > self._lost_reported
                and self._clock.monotonic_ns() > self._reported_ns + LOSS_REPORT_NS
            ):
                self._report_losses()
            self._count_foreign_packets(camera)
            if frame is None:
                continue
            try:
                self._on_frame(self._mapped(frame, first=first))
            finally:
                if not frame.buffer.borrowed:
                    frame.buffer.release()
            first = False

    def _report_losses(self) -> None:
        if lost := self._lost - self._lost_reported:
            self._on_text(f"{counted(lost, 'frame')} lost before frame {self._sequence}, {self._lost} in all")
            self._lost_reported, self._reported_ns = self._lost, self._clock.monotonic_ns()

    def _count_foreign_packets(self, camera: Camera) -> None:
        """Add up the packets of other senders, five times a second, and report them once a minute."""
        now_ns = self._clock.monotonic_ns()
        if now_ns < self._foreign_read_ns + FOREIGN_READ_NS:
            return
        self._foreign_read_ns = now_ns
        found = camera.take_foreign_packets()
        self._foreign += found.count
        for warning in camera.warnings[len(self._warnings) :]:
            self._on_text(warning)
        self._warnings = camera.warnings
        if (
            self._foreign > self._foreign_reported
            and found.sender is not None
            and now_ns >= self._foreign_reported_ns + FOREIGN_REPORT_NS
        ):
            address, port = found.sender
            self._on_text(
                f"{counted(self._foreign, 'packet')} at the camera's image port came from {address}:{port}, "
                "not from the camera: not used; give the camera a network interface of its own"
            )
            self._foreign_reported, self._foreign_reported_ns = self._foreign, now_ns

    def _mapped(self, frame: Frame, *, first: bool) -> Frame:
        """Copy of a frame with host time of mid-exposure [ns], sequence number and lost frames added.

        The time is host monotonic; its standard deviation [ns] is added too. The sequence number counts the
        complete frames of the stream from 0, over reconnections too. The number of lost frames is the
        camera's own count, except after a reconnection: then it is estimated from the time since the last
        frame before the camera was lost. Also updates the stream's own counts.

        Args:
            frame: frame as the camera returned it.
            first: True for the first frame since the camera was connected or reconnected.
        """
        mapper = self._mapper
        mapper.add_arrival(frame.device_time_ns, frame.host_time_ns)  # no effect if the clock is latched
        half_ns = round(frame.exposure_us * 500.0)
        stamped_ns = mapper.to_host(frame.device_time_ns)
        # Without a clock that can be read the stamp counts as the arrival, which follows the exposure's end.
        at_end = self._config.timestamp_at == "exposure_end" or not mapper.latched
        mid = stamped_ns - half_ns if at_end else stamped_ns + half_ns
        lost = frame.lost_before
        if first and self._recent:
            # No frames were counted while the camera was away: estimate the loss from the gap in time.
            lost = max(0, round((mid - self._recent[-1]) / self._period_ns) - 1)
        self._recent.append(mid)
        # The time of arrival, not of exposure: frames that arrive late still show that the camera is alive.
        self._arrived_ns = self._clock.monotonic_ns()
        mapped = frame._replace(
            sequence=self._sequence,
            lost_before=lost,
            mid_exposure_ns=mid,
            mapping_sd_ns=mapper.sd_at(frame.device_time_ns),
        )
        self._sequence += 1
        self._lost += lost
        return mapped

    # --- clock thread ---

    def _latch(self) -> None:
        while not self._stopping.is_set():
            self._latch_now.wait(LATCH_S if self._mapper.span_s > LATCH_SPAN_S else FIRST_LATCH_S)
            self._latch_now.clear()
            camera, mapper = self._camera, self._mapper
            for _ in range(LATCH_TRIES):
                if camera is None or self._stopping.is_set():
                    break
                try:
                    reading = camera.latch_clock()
                except CameraError:
                    break  # the acquisition thread notices the missing frames itself
                if reading is None:
                    break
                mapper.add(reading)
                self._on_clock(reading)
                if (
                    reading.host_after_ns - reading.host_before_ns
                    <= QUICK_RATIO * mapper.shortest_round_trip_ns
                ):
                    break


def _latch_first(camera: Camera, mapper: DeviceClockMapper) -> None:
    for _ in range(FIRST_LATCHES):
        if (reading := camera.latch_clock()) is None:
            return
        mapper.add(reading)
