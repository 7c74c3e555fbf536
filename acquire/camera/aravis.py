"""Camera through the library Aravis 0.8; one file, because its threads share one connection."""

from __future__ import annotations

import threading
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from acquire.camera.aravis_library import Connection, aravis_and_glib, close_connection, drain, reason
from acquire.camera.aravis_link import AravisLink, GigeLink
from acquire.camera.base import Camera, CameraInfo
from acquire.camera.frame_loss import FrameLoss
from acquire.camera.settings import write_settings
from acquire.clock.reading import ClockReading
from acquire.errors import CameraError, CameraLost, drop_traceback
from acquire.frames.buffer_pool import BufferPool
from acquire.frames.frame import Frame
from schemas.wording import counted

if TYPE_CHECKING:
    from acquire.camera.sender_filter import ForeignPackets
    from acquire.clock.clock import Clock
    from schemas.rig import CameraConfig

_POP_TIMEOUT_US = 100_000
_CLOSE_JOIN_S = 1.0
OPEN_S = 20.0
"""longest time for connecting and all settings [s]: the work takes a quarter of a second, and each of up to
six missing answers 2.5 s"""
_CLOCK_JUMP_S = 5.0
"""change of device time against host time between two frames [s] that no delay explains: the camera's clock
was set, or it restarted"""


class AravisCamera(Camera):
    """A GigE or USB3 Vision camera. Order of calls: open, start, read (repeatedly), stop, close.

    Frames are popped on the caller's thread: Python in a stream callback blocks reception (Aravis #171) or
    crashes (#453). A frame's image is a view of its buffer in memory that the camera's BufferPool owns; the
    buffer is filled again after its release. Never reopen a camera that was lost: make a new one.

    Args:
        config: section `camera` of the rig file.
        clock: the host's clock.
        borrowable_frames: number of frames whose buffers may be borrowed (kept after the next read) at a
            time; these buffers are in addition to those of the configuration.
        link: GigE or USB.
    """

    def __init__(
        self,
        config: CameraConfig,
        clock: Clock,
        borrowable_frames: int = 0,
        link: type[AravisLink] = GigeLink,
    ) -> None:
        """Prepare a camera that is not connected yet; nothing is sent to it before `open`."""
        self._config, self._clock = config, clock
        self._link = link(config, clock)
        self._borrowable_frames = borrowable_frames
        self._connection: Connection | None = None
        self._lost = threading.Event()
        self._given_up = threading.Event()
        self._closing = threading.Lock()
        self._closer: threading.Thread | None = None
        self._slots: dict[int, int] = {}
        self._exposure_us, self._frame_rate_hz = config.exposure_us, config.frame_rate_hz
        self._latched_once = False
        self._loss = FrameLoss(config.frame_rate_hz)
        self._sequence = 0
        self._last_frame_ns = 0
        self._last_device_ns: int | None = None
        self._exposed_after_ns = -1
        self.incomplete_frames = 0
        """frames that arrived with packets missing; they are counted as lost too"""
        self._size = (0, 0)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Limitations of clock and stream found since `open`, a line of text each; empty if none."""
        return tuple(self._link.warnings)

    @property
    def receive_buffer_bytes(self) -> int:
        """Effective size of the stream's socket buffer; 0 before open, and without a socket."""
        return self._link.receive_buffer_bytes

    @property
    def borrowable_frames(self) -> int:
        """Number of frames whose buffers may be borrowed (kept after the next read) at a time."""
        return self._borrowable_frames

    def open(self) -> CameraInfo:
        """Connect, write every setting of the rig file, read it back and compare.

        Returns:
            The camera's identity: vendor, model, serial number and IP address.

        Raises:
            CameraNotFound: nothing answers at the address.
            CameraSettingError: a setting reads back differently, or is out of the camera's range.
            CameraError: another program controls the camera, it refused the connection or stopped answering,
                no stream can be opened, memory for its buffers is lacking, Aravis is not installed, or all
                this took longer than `OPEN_S` (20 s).
        """
        done: Future[CameraInfo] = Future()
        threading.Thread(target=self._open_in_thread, args=(done,), name="aravis-open", daemon=True).start()
        try:
            return done.result(OPEN_S)
        except TimeoutError:
            self._given_up.set()
            self.close()
            raise CameraError(
                f"camera {self._config.address} is not set up after {OPEN_S:g} s: "
                "switch it off and on, check its cable, then try again"
            ) from None

    def _open_in_thread(self, done: Future[CameraInfo]) -> None:
        """Open the camera, and store its identity, or the exception that was raised, in the future `done`.

        Runs on a thread of its own, because a call that hangs inside Aravis cannot be ended: it is abandoned,
        and the camera closed if the call ever returns.
        """
        try:
            info = self._open()
        except BaseException as error:
            done.set_exception(error)
            return
        done.set_result(info)
        if self._given_up.is_set():
            self.close()

    def _open(self) -> CameraInfo:
        Aravis, GLib = aravis_and_glib()
        address = self._config.address
        self._link.wait_for_control()
        try:
            camera = Aravis.Camera.new(address)
        except GLib.Error as error:
            raise self._link.not_connected(reason(error)) from None
        device = camera.get_device()
        # The handler runs on Aravis's heartbeat thread.
        handler = device.connect("control-lost", lambda _device: self._lost.set())
        try:
            self._link.require_control(camera)
            write_settings(camera, self._config)
            self._exposure_us = camera.get_exposure_time()
            if self._config.trigger == "off":
                self._frame_rate_hz = camera.get_frame_rate()
            self._link.prepare_clock(camera)
            info = CameraInfo(
                vendor=camera.get_vendor_name(),
                model=camera.get_model_name(),
                serial=camera.get_device_serial_number(),
                address=address,
                kind=self._config.kind,
            )
            self._size = camera.get_region()[2:]
            self._connection = self._connect_stream(camera, device, handler)
        except (GLib.Error, CameraError) as error:
            connection = Connection(camera, device, None, handler, [], None)
            camera = device = None
            drop_traceback(error)
            self._close_in_background(connection)
            if isinstance(error, CameraError):
                raise
            raise CameraError(
                f"camera {address} stopped answering while it was set up ({reason(error)}): try again"
            ) from None
        return info

    def start(self) -> None:
        """Start the image stream; frames and losses are counted from 0 again.

        Frames that are left from an earlier stream are dropped.

        Raises:
            CameraLost: the camera no longer answers.
            CameraError: the camera is not open.
        """
        _, GLib = aravis_and_glib()
        connection = self._opened()
        drain(connection.stream, self._config.buffers)
        # The last frame of the previous run may still arrive; it was exposed before now.
        reading = self.latch_clock()
        self._exposed_after_ns = -1 if reading is None else reading.device_time_ns
        self._loss = FrameLoss(self._frame_rate_hz, stamps_arrival=self._link.stamps_arrival)
        self._sequence = self.incomplete_frames = 0
        try:
            connection.camera.start_acquisition()
        except GLib.Error as error:
            raise self._lost_error(reason(error)) from None
        self._last_frame_ns, self._last_device_ns = self._clock.monotonic_ns(), None

    def read(self, timeout_s: float) -> Frame | None:
        """Next complete frame of the stream, or None if none arrived within `timeout_s` [s].

        The frame holds a grey image, the camera's time [ns] at the start of its exposure, and the host
        monotonic time [ns] of its arrival. The caller releases the frame's buffer.

        Raises:
            CameraLost: the camera no longer answers, sent no complete frame for the configured `stall_s`, or
                its clock jumped by more than 5 s.
            CameraError: the camera is not open.
        """
        connection = self._opened()
        now_ns = self._clock.monotonic_ns()
        deadline_ns = now_ns + round(timeout_s * 1e9)
        while True:
            buffer = connection.stream.timeout_pop_buffer(
                max(0, min(_POP_TIMEOUT_US, (deadline_ns - now_ns) // 1000))
            )
            now_ns = self._clock.monotonic_ns()
            if buffer is None:
                self._check_alive(now_ns)
                if now_ns >= deadline_ns:
                    return None
                continue
            frame = self._frame(connection, buffer, now_ns)
            if frame is not None:
                return frame
            connection.stream.push_buffer(buffer)

    def take_foreign_packets(self) -> ForeignPackets:
        """Packets of other senders at the camera's image port since the last call; none of them is used.

        A warning is added if the camera states a wrong port.
        """
        return self._link.take_foreign_packets(any_frame=self._sequence > 0)

    def latch_clock(self) -> ClockReading | None:
        """Read the camera's clock now: latch it (store its present value) and read the stored value.

        A second thread may call this while frames are read. If the first latch fails, no more are tried, and
        a warning is added.

        Returns:
            Device time with the host's monotonic times before and after [ns]; None if the camera cannot latch
            its clock, does not answer, is lost or is not open.
        """
        connection = self._connection
        device = None if connection is None else connection.device  # another thread may be closing it
        if device is None or not self._link.can_latch or self._lost.is_set():
            return None
        _, GLib = aravis_and_glib()
        try:
            before_ns = self._clock.monotonic_ns()
            self._link.latch_now(device)
            after_ns = self._clock.monotonic_ns()
            device_ns = self._link.latched_ns(device)
        except GLib.Error:
            return self._warn_no_latch()
        if device_ns == 0:
            return self._warn_no_latch()
        self._latched_once = True
        return ClockReading(device_ns, before_ns, after_ns)

    def _warn_no_latch(self) -> None:
        """Give up latching (reading) the camera's clock, and add a warning, if no latch ever succeeded.

        If one succeeded before, this failure may be an isolated one, and nothing happens.
        """
        if not self._latched_once:
            self._link.can_latch = False
            self._link.warnings.append(
                f"camera {self._config.address} cannot latch its clock: frame times come from their arrival"
            )

    def stop(self) -> None:
        """Stop streaming and drop the frames that were not read; do nothing if the camera is lost.

        Raises:
            CameraError: the camera is not open.
        """
        _, GLib = aravis_and_glib()
        connection = self._opened()
        if self._lost.is_set():
            return
        try:
            connection.camera.stop_acquisition()
        except GLib.Error:
            self._lost.set()
        drain(connection.stream, self._config.buffers)

    def close(self) -> None:
        """Release the camera. Never raises, and may be repeated.

        A camera that answers is closed on return; a dead one takes longer and is closed in the background.
        """
        with self._closing:
            connection, self._connection = self._connection, None
        if connection is not None:
            if connection.memory is not None:
                connection.memory.close()
            self._link.close()
            self._close_in_background(connection)

    def _opened(self) -> Connection:
        if self._connection is None:
            raise CameraError(f"camera {self._config.address} is not open")
        return self._connection

    def _lost_error(self, why: str) -> CameraLost:
        self._lost.set()
        return CameraLost(
            f"camera {self._config.address} was lost: {why}: check power and cable, then connect again"
        )

    def _check_alive(self, now_ns: int) -> None:
        # control-lost comes about 6 s after the camera's death: the watchdog below notices first.
        if self._lost.is_set():
            raise self._lost_error(self._link.lost_reason)
        stalled_s = (now_ns - self._last_frame_ns) * 1e-9
        if stalled_s > self._config.stall_s:
            incomplete = (
                f" ({counted(self.incomplete_frames, 'frame')} arrived incomplete: "
                f"{self._link.incomplete_remedy})"
            )
            trigger = self._config.trigger
            pulses = f" (trigger = {trigger}: check that its pulses arrive)" if trigger != "off" else ""
            raise self._lost_error(
                f"no frame for {stalled_s:.1f} s{incomplete if self.incomplete_frames else pulses}"
            )

    def _frame(self, connection: Connection, buffer: Any, now_ns: int) -> Frame | None:
        Aravis, _ = aravis_and_glib()
        # hash() of a wrapper is its C pointer: it identifies the buffer's slot.
        slot, memory = self._slots[hash(buffer)], connection.memory
        if memory is None:
            return None
        if buffer.get_status() != Aravis.BufferStatus.SUCCESS:
            self.incomplete_frames += 1
            return None
        width, height = buffer.get_image_width(), buffer.get_image_height()
        if (width, height) != self._size:  # of another stream, or forged: the buffer may be smaller
            self.incomplete_frames += 1
            return None
        frame_id, device_time_ns = buffer.get_frame_id(), buffer.get_timestamp()
        if device_time_ns < self._exposed_after_ns:
            return None
        if self._last_device_ns is not None:
            jump_s = (device_time_ns - self._last_device_ns - (now_ns - self._last_frame_ns)) * 1e-9
            if abs(jump_s) > _CLOCK_JUMP_S:
                raise self._lost_error(f"its clock jumped by {jump_s:.3g} s")
        self._last_frame_ns, self._last_device_ns = now_ns, device_time_ns
        frame = Frame(
            image=memory.image(slot, width, height),
            sequence=self._sequence,
            frame_id=frame_id,
            device_time_ns=device_time_ns,
            # Not get_system_timestamp(): that is CLOCK_REALTIME at the first packet (Aravis #1088).
            host_time_ns=now_ns,
            exposure_us=self._exposure_us,
            lost_before=self._loss.before(frame_id, device_time_ns),
            buffer=memory.buffer(slot),
        )
        self._sequence += 1
        return frame

    def _connect_stream(self, camera: Any, device: Any, handler: int) -> Connection:
        Aravis, _ = aravis_and_glib()
        self._link.prepare_stream(camera)
        payload = camera.get_payload()
        stream = camera.create_stream(None, None)
        if stream is None:
            raise CameraError(
                f"camera {self._config.address}: no stream can be opened: {self._link.stream_remedy}"
            )
        self._link.tune_stream(camera, device, stream)
        buffers: list[Any] = []
        try:
            memory = BufferPool(
                self._config.buffers,
                self._borrowable_frames,
                payload,
                requeue=lambda slot: stream.push_buffer(buffers[slot]),
            )
        except (OSError, MemoryError) as error:  # a CameraError is tried again, and the camera is released
            count = self._config.buffers + self._borrowable_frames
            raise CameraError(
                f"camera {self._config.address}: no memory for {counted(count, 'buffer')} of {payload} B "
                f"({error}): end other programs"
            ) from None
        buffers += [Aravis.Buffer.new(payload, memory.address(slot)) for slot in range(len(memory))]
        self._slots = {hash(buffer): index for index, buffer in enumerate(buffers)}
        for buffer in buffers[: memory.circulating]:
            stream.push_buffer(buffer)
        return Connection(camera, device, stream, handler, buffers, memory)

    def _close_in_background(self, connection: Connection) -> None:
        """Close a connection on a thread of its own, and wait up to 1 s for its end.

        A dead camera blocks for 7.5 s, three time-outs of the control protocol (GVCP).
        """
        self._closer = threading.Thread(
            target=close_connection, args=(connection, self._lost.is_set()), name="aravis-close", daemon=True
        )
        del connection
        self._closer.start()
        self._closer.join(_CLOSE_JOIN_S)
