"""The capture process: it reads the camera and writes the recording, nothing else.

The daemon sends commands over a socket pair (link.py is the other end) and receives heartbeats
(heartbeat.py). The process finishes the recording by itself when it is terminated and when the daemon dies.
Ctrl-C in a terminal reaches every process of the terminal. The capture process ignores it: the daemon reacts.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import signal
import socket
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.Log_pb2 import Log
from pydantic import ValidationError

from acquire.camera.base import Camera, CameraInfo
from acquire.camera.factory import make_camera
from acquire.camera.stream import CameraStream
from acquire.capture import wire
from acquire.capture.heartbeat import Heartbeat
from acquire.capture.open_recording import Attachments, OpenRecording, borrowable_frames
from acquire.capture.preview_slot import PreviewShape, PreviewWriter
from acquire.clock.clock import Clock, SystemClock
from acquire.clock.reading import ClockReading
from acquire.errors import AcquireError, CameraError, ConfigError, RecorderError
from acquire.frames.frame import Frame
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from schemas.rig import CameraConfig, RigConfig
from schemas.session_manifest import SessionManifest

COMMAND_S = 180.0
"""time after which a command counts as hung [s]; the longest commands wait for a slow disk"""
STUCK_S = 5.0
"""time beyond the stall time after which the camera thread counts as stuck: it should have reported the
camera lost [s]"""

MakeCamera = Callable[[CameraConfig, Clock, int], Camera]
"""called with configuration, clock, and number of borrowable frames"""


class Capture:
    """Server of the daemon's commands in the capture process: owns camera and recording.

    It ends when `connection` closes, when the command `stop` arrives, or when a signal wakes `wake_fd`.

    Args:
        connection: socket to the daemon.
        make_camera: function that makes the camera from configuration, clock, and number of camera buffers
            that a recording may borrow.
        clock: host clock.
        wake_fd: descriptor that becomes readable at a signal.
    """

    def __init__(
        self, connection: socket.socket, make_camera: MakeCamera, clock: Clock, wake_fd: int
    ) -> None:
        self._connection = connection
        self._make_camera = make_camera
        self._clock = clock
        self._wake_fd = wake_fd
        self._rig: RigConfig | None = None
        self._stream: CameraStream | None = None
        self._info: CameraInfo | None = None
        self._recording: OpenRecording | None = None
        self._preview: PreviewWriter | None = None
        self._error = ""
        self._begun_ns: int | None = None
        """host monotonic time at which the current command arrived; None while there is none"""
        self._started_ns = 0
        self._commands: dict[str, Callable[[dict[str, Any], bytes], dict[str, Any] | None]] = {
            "start": self._start,
            "open_recording": self._open_recording,
            "require_space": self._require_space,
            "open_window": self._open_window,
            "close_window": self._close_window,
            "messages": self._messages,
            "status": self._status,
            "close_recording": self._close_recording,
            "stop": lambda *_: {},
        }

    def run(self) -> None:
        """Serve the daemon's commands until the end; then finish an open recording and release the camera.

        The service ends with the command `stop`, a signal, the end of the daemon, or an error. Recording and
        camera are finished in each case.
        """
        try:
            while self._serve_one():
                pass
        except wire.WireClosed:
            pass  # the daemon is gone
        finally:
            try:
                if self._recording is not None:
                    self._close_recording({}, b"")
            finally:
                if self._stream is not None:
                    self._stream.stop()

    def is_healthy(self) -> bool:
        """True while the threads that serve commands and read the camera make progress.

        False if a command takes longer than COMMAND_S, or if the camera counts as connected although no frame
        came for STUCK_S longer than the time after which it should count as lost (`stall_s` of the rig).
        """
        now, begun = self._clock.monotonic_ns(), self._begun_ns
        if begun is not None and now - begun > COMMAND_S * 1e9:
            return False
        rig, stream = self._rig, self._stream
        if rig is None or stream is None:
            return True
        status = stream.status()
        newest_ns = max(status.last_frame_ns or 0, self._started_ns)
        return not status.connected or now - newest_ns < (rig.camera.stall_s + STUCK_S) * 1e9

    def _serve_one(self) -> bool:
        ready, _, _ = select.select([self._connection, self._wake_fd], [], [])
        if self._wake_fd in ready:
            return False
        header, payload = wire.receive(self._connection)
        command = header.get("op", "")
        self._begun_ns = self._clock.monotonic_ns()
        try:
            reply = self._commands[command](header, payload)
        except AcquireError as error:
            reply = {"raised": type(error).__name__, "message": str(error)}
        except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
            reply = {"raised": "AcquireError", "message": f"capture: {command}: {error!r}"}
        if command == "messages":
            if reply is not None:
                self._error = reply["message"]
        else:
            wire.send(self._connection, {"id": header.get("id"), **(reply or {})})
        self._begun_ns = None
        return command != "stop"

    # --- commands ---

    def _start(self, header: dict[str, Any], _: bytes) -> dict[str, Any]:
        try:
            self._rig = rig = RigConfig.model_validate_json(header["rig"])
        except ValidationError as error:
            raise ConfigError(f"rig: {error.errors()[0]['msg']}") from None
        if self._stream is not None:
            self._stream.stop()
        if (preview_fd := header.get("preview_fd")) is not None and self._preview is None:
            self._preview = PreviewWriter(preview_fd, PreviewShape(rig.camera.width, rig.camera.height))
        self._stream = CameraStream(
            lambda: self._make_camera(rig.camera, self._clock, borrowable_frames(rig)),
            rig.camera,
            self._clock,
            self._on_frame,
            self._on_clock,
            self._on_text,
        )
        self._info = self._stream.start()
        self._started_ns = self._clock.monotonic_ns()
        return asdict(self._info)

    def _open_recording(self, header: dict[str, Any], payload: bytes) -> dict[str, Any]:
        if self._recording is not None:
            raise RecorderError(f"{self._recording.path} is being recorded: close it first")
        rig, stream = self._started()
        manifest = SessionManifest.model_validate_json(header["manifest"])
        attachments: Attachments = []
        at = 0
        for name, media_type, size in header["attachments"]:
            attachments.append((name, media_type, payload[at : at + size]))
            at += size
        log_time_ns = manifest.wall_anchor_ns + self._clock.monotonic_ns()
        self._recording = OpenRecording(
            Path(header["path"]), manifest, attachments, log_time_ns, rig, stream.borrowable_frames
        )
        self._error = ""
        for text in (*stream.status().warnings, stream.status().trouble):
            if text:
                self._on_text(text)
        stream.latch()
        return {}

    def _require_space(self, *_: object) -> dict[str, Any]:
        self._open().require_space()
        return {}

    def _open_window(self, *_: object) -> dict[str, Any]:
        recording = self._open()
        recording.require_space()
        return {"start_ns": recording.frames.open_window(self._clock.monotonic_ns())}

    def _close_window(self, header: dict[str, Any], *_: object) -> dict[str, Any]:
        frames = self._open().frames
        return asdict(frames.close_window(self._clock.monotonic_ns(), int(header.get("end_ns", 0))))

    def _messages(self, header: dict[str, Any], payload: bytes) -> None:
        recording = self._recording
        if recording is not None:
            names = header["topics"]
            for topic, log_time_ns, data in wire.unpack_messages(payload):
                recording.write(names[topic], log_time_ns, data)

    def _status(self, *_: object) -> dict[str, Any]:
        stream = self._started()[1]
        status, recording = stream.status(), self._recording
        error = recording.frames.error if recording is not None else None
        now = self._clock.monotonic_ns()
        return {
            "frames": status.frames,
            "lost": status.lost,
            "foreign_packets": status.foreign_packets,
            "dropped": recording.frames.dropped if recording is not None else 0,
            "waiting_bytes": recording.waiting_bytes if recording is not None else 0,
            "fps": status.fps,
            "recording": str(recording.path) if recording is not None else None,
            "first_frame_ns": recording.first_frame_ns if recording is not None else None,
            "bytes_written": recording.files.size if recording is not None else 0,
            "receive_buffer_bytes": status.receive_buffer_bytes,
            "camera": asdict(self._info) if self._info is not None else None,
            "connected": status.connected,
            "clock_latched": status.latched,
            "last_frame_age_s": (now - status.last_frame_ns) * 1e-9
            if status.last_frame_ns is not None
            else None,
            "error": str(error) if error is not None else self._error or status.trouble,
            "warnings": status.warnings,
        }

    def _close_recording(self, *_: object) -> dict[str, Any]:
        recording = self._open()
        self._recording = None
        return recording.finish()

    def _started(self) -> tuple[RigConfig, CameraStream]:
        if self._rig is None or self._stream is None:
            raise CameraError("the camera was not started")
        return self._rig, self._stream

    def _open(self) -> OpenRecording:
        if self._recording is None:
            raise RecorderError("no recording is open")
        return self._recording

    # --- from the camera's threads ---

    def _on_frame(self, frame: Frame) -> None:
        recording = self._recording
        if recording is not None:
            if recording.first_frame_ns is None:
                recording.first_frame_ns = recording.anchor + frame.mid_exposure_ns
            recording.frames.add(frame)
        if self._preview is not None:
            self._preview.offer(frame)

    def _on_clock(self, reading: ClockReading) -> None:
        if (recording := self._recording) is not None:
            sample = pb.ClockSample(
                clock=f"camera/{recording.camera}",
                device_time_ns=reading.device_time_ns,
                host_before_ns=reading.host_before_ns,
                host_after_ns=reading.host_after_ns,
            )
            middle = (reading.host_before_ns + reading.host_after_ns) // 2
            self._write_quietly(recording, topics.CLOCK_SAMPLE, middle, sample.SerializeToString())

    def _on_text(self, text: str) -> None:
        if (recording := self._recording) is not None:
            now = self._clock.monotonic_ns()
            message = Log(level=Log.Level.WARNING, message=text, name="capture")
            message.timestamp.FromNanoseconds(recording.anchor + now)
            self._write_quietly(recording, topics.LOG, now, message.SerializeToString())

    def _write_quietly(
        self, recording: OpenRecording, topic: topics.Topic, host_ns: int, data: bytes
    ) -> None:
        # The recording may be closing, or its disk full: neither may end the camera's thread.
        with contextlib.suppress(RecorderError):
            recording.write(topic.name, recording.anchor + host_ns, data)


def serve(fd: int, heartbeat_fd: int, make_camera: MakeCamera) -> None:
    """Run the capture process until the daemon or a signal ends it. Call it in the main thread.

    Args:
        fd: socket to the daemon.
        heartbeat_fd: writing end of the pipe for heartbeats (regular signs of life).
        make_camera: function that makes the camera from configuration, clock, and number of camera buffers
            that a recording may borrow.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    wake_read, wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    for number in (signal.SIGTERM, signal.SIGHUP):
        # The handler does nothing: the wake-up descriptor carries the signal to the select in _serve_one.
        signal.signal(number, lambda *_: None)
    signal.set_wakeup_fd(wake_write, warn_on_full_buffer=False)
    # The camera's thread must get the GIL soon after a frame arrives; the default interval is 5 ms.
    sys.setswitchinterval(0.0005)
    with socket.socket(fileno=fd) as connection:
        capture = Capture(connection, make_camera, SystemClock(), wake_read)
        heartbeat = Heartbeat(heartbeat_fd, capture.is_healthy)
        try:
            capture.run()
        finally:
            heartbeat.stop()


def main() -> None:
    """Parse the command line and run the capture process, with the rig file's camera, until its end."""
    parser = argparse.ArgumentParser(
        description="Capture process of the daemon; not meant to be started by hand."
    )
    parser.add_argument("--fd", type=int, required=True, help="inherited socket to take commands from")
    parser.add_argument("--heartbeat", type=int, required=True, help="inherited pipe to send heartbeats on")
    arguments = parser.parse_args()
    serve(arguments.fd, arguments.heartbeat, make_camera)
