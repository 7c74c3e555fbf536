"""The daemon's handle of the capture process: it starts the process, sends commands, notices its end."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from acquire import errors
from acquire.camera.base import CameraInfo
from acquire.capture import wire
from acquire.capture.heartbeat import SILENCE_S, HeartbeatListener
from acquire.capture.preview_slot import PreviewMemory, PreviewShape
from acquire.errors import AcquireError, CaptureGone, RecorderError
from acquire.recorder.frame_recorder import WindowReport
from schemas.document import canonical_json
from schemas.rig import RigConfig
from schemas.session_manifest import SessionManifest

BATCH_S: Final = 0.05
"""interval between batches of small messages [s]"""
BATCH_LIMIT_BYTES: Final = 8 << 20
"""bytes that may wait while the capture process does not read; beyond it messages are refused"""
REPLY_TIMEOUT_S: Final = 10.0
START_TIMEOUT_S: Final = 30.0
FINISH_TIMEOUT_S: Final = 90.0
"""longest wait for a recording to finish: a slow disk may have gigabytes to write before fsync returns [s]"""


@dataclass(frozen=True)
class CaptureStatus:
    """Health of camera and recorder in the capture process: frame rate, losses, bytes that wait."""

    frames: int
    """frames since the capture process started"""
    lost: int
    """frames lost on the way from the camera, since then"""
    foreign_packets: int
    """packets from other senders at the camera's image port, since then; none of them was used"""
    dropped: int
    """images dropped because of a slow disk, in this recording"""
    waiting_bytes: int
    """bytes of images in memory that wait for the disk, in this recording"""
    fps: float
    """frame rate measured at present [1/s]"""
    recording: Path | None
    """final path of the file being written; None if no recording is open"""
    first_frame_ns: int | None
    """log time of this recording's first frame [ns]; None before it"""
    bytes_written: int
    """bytes of this recording's files so far"""
    receive_buffer_bytes: int
    """size of the receive buffer of the camera's socket; 0 if unknown"""
    camera: CameraInfo | None
    """identity of the camera; None before it was opened"""
    connected: bool
    """True while the camera answers"""
    clock_latched: bool
    """True if frame times are mapped from the camera's clock; False: they are arrival times"""
    last_frame_age_s: float | None
    """time since the newest frame was read [s]; None before the first frame"""
    error: str
    """problem of the recorder, of a small message or of the camera, whichever comes first in this list; empty
    if there is none"""
    warnings: tuple[str, ...]
    """limitations of the camera"""


@dataclass(frozen=True)
class RecordingReport:
    """Finished recording: path and content id (hash of messages) of its last file, and frame counts."""

    path: Path
    """path of the last file"""
    frames: int
    """frames that arrived during the recording"""
    lost: int
    """frames lost on the way from the camera, and images dropped because of a slow disk"""
    content_id: str
    """hash of the last file's messages"""


class CaptureProcess:
    """The daemon's handle of the capture process, which reads the camera and writes the recording.

    Methods may be called from any thread; all but `write` wait for the process's answer. A process that sends
    no heartbeat (regular sign of life) for SILENCE_S is killed, even while a method waits for it.

    Args:
        rig: camera and recorder configuration.
        command: command line of the process, to which its file descriptors are added.

    Raises:
        CaptureGone: from a method, if the process is not running, or ended during the call.
        RecorderError: from a method, if the process does not answer in time.
        AcquireError: from a method, the error raised in the process, with the same class and text.
    """

    def __init__(
        self, rig: RigConfig, command: Sequence[str] = (sys.executable, "-m", "acquire.capture")
    ) -> None:
        self._rig = rig
        self._command = command
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self._call_lock = threading.Lock()
        self._send_lock = threading.Lock()
        self._batch_lock = threading.Lock()
        self._batch = bytearray()
        self._batch_topics: dict[str, int] = {}
        self._known = frozenset(wire.small_topics(rig.camera.name))
        self._number = 0
        self._stopping = threading.Event()
        self._sender: threading.Thread | None = None
        self._heartbeat: HeartbeatListener | None = None
        self._hung = False
        self._preview: PreviewMemory | None = None

    @property
    def preview(self) -> PreviewMemory:
        """Memory into which the process copies images for the console; made when it is first used."""
        if self._preview is None:
            self._preview = PreviewMemory(PreviewShape(self._rig.camera.width, self._rig.camera.height))
        return self._preview

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        process = self._process
        return process is not None and process.poll() is None

    @property
    def end(self) -> str:
        """Reason why the process ended, as the end of a sentence that begins with "the capture process".

        Waits up to 1 s for the exit code. While the process runs, the text says "ended (exit code None)".
        """
        if self._hung:
            return f"gave no sign of life for {SILENCE_S:g} s and was ended"
        code = None
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = self._process.wait(1.0)
        return f"ended (exit code {code})"

    def start(self) -> CameraInfo:
        """Start the process; in it open the camera and start the stream of frames.

        Returns:
            Identity of the camera: make, model, serial number, address.

        Raises:
            AcquireError: the camera or the rig file cannot be used, or the process ended or does not answer;
                the process has ended in each case.
            OSError: the process cannot be started.
        """
        here, there = socket.socketpair()
        read_fd, write_fd = os.pipe()
        try:
            fds = (there.fileno(), write_fd, self.preview.fd)
            command = [*self._command, "--fd", str(fds[0]), "--heartbeat", str(fds[1])]
            self._process = process = subprocess.Popen(command, pass_fds=fds)
        except OSError:
            os.close(read_fd)
            here.close()
            raise
        finally:
            there.close()
            os.close(write_fd)
        self._hung = False
        self._heartbeat = HeartbeatListener(read_fd, lambda: self._end_hung(process))
        with self._batch_lock:  # messages for the previous process belong to no recording of this one
            self._batch.clear()
            self._batch_topics.clear()
        self._socket = here
        self._stopping.clear()
        self._sender = threading.Thread(target=self._send_batches, name="capture-batches")
        self._sender.start()
        try:
            header = {"op": "start", "rig": self._rig.model_dump_json(), "preview_fd": self.preview.fd}
            return CameraInfo(**self._call(header, timeout_s=START_TIMEOUT_S))
        except AcquireError as error:
            if isinstance(error, RecorderError):  # no answer at all: `stop` would get none either
                process.kill()
            self.stop()
            raise

    def open_recording(
        self, path: Path, manifest: SessionManifest, attachments: list[tuple[str, str, bytes]]
    ) -> None:
        """Begin a recording.

        Args:
            path: final path of the recording's first file.
            manifest: description of the session, written at the head of every file of the recording.
            attachments: (name, media type, content) of the files attached to the recording.

        Raises:
            RecorderError: a recording is open, `path` is taken, the disk refuses or has no room, or the
                process does not run (CaptureGone) or answer.
            CameraError: the camera was not started.
        """
        header = {
            "op": "open_recording",
            "path": str(path.absolute()),
            "manifest": canonical_json(manifest),
            "attachments": [(name, media_type, len(data)) for name, media_type, data in attachments],
        }
        self._call(header, b"".join(data for _, _, data in attachments))

    def require_space(self) -> None:
        """Raise RecorderError if the disk has no room for a window (time span of a strike).

        The window is taken at its greatest length. Called before the striker is armed. The error is raised as
        well if no recording is open, or the process does not run (CaptureGone) or answer.
        """
        self._call({"op": "require_space"})

    def open_window(self) -> int:
        """Open a window (time span of a strike): record every image from `pre_trigger_s` before now on.

        Returns:
            Start of the window as a log time [ns].

        Raises:
            RecorderError: no recording is open, a window is open already, the disk is full or has no room for
                a window, or the process does not run (CaptureGone) or answer.
        """
        return int(self._call({"op": "open_window"})["start_ns"])

    def close_window(self, end_ns: int = 0) -> WindowReport:
        """End the open window (time span of a strike); on return its images are in the file.

        Args:
            end_ns: log time [ns] at which the window ends if that has passed; 0, or a time to come: now.

        Returns:
            Log times of the first and last image (without images, of the window's start and end), and numbers
            of recorded and lost frames.

        Raises:
            RecorderError: no recording or window is open, the file accepts no more images, or the process
                does not run (CaptureGone) or answer.
        """
        return WindowReport(
            **self._call({"op": "close_window", "end_ns": end_ns}, timeout_s=FINISH_TIMEOUT_S)
        )

    def write(self, topic_name: str, log_time_ns: int, data: bytes) -> bool:
        """Record one small message, without waiting.

        Messages travel in batches, in order, and before any later command.

        Args:
            topic_name: name of a small topic (any topic but the camera's images and frame metadata).
            log_time_ns: log time [ns].
            data: serialised message.

        Returns:
            False if the message is not taken: the process does not run, or more than BATCH_LIMIT_BYTES wait
            for it.

        Raises:
            RecorderError: no such topic.
        """
        if topic_name not in self._known:
            raise RecorderError(f"topic {topic_name!r} is not one of a recording's small topics")
        with self._batch_lock:
            if len(self._batch) > BATCH_LIMIT_BYTES or self._socket is None:
                return False
            number = self._batch_topics.setdefault(topic_name, len(self._batch_topics))
            self._batch += wire.pack_message(number, log_time_ns, data)
            return True

    def status(self) -> CaptureStatus:
        """Ask the process for the health of camera and recorder, and return it.

        Returns:
            Frame rate, losses, bytes that wait for the disk, state of the recording, and a problem if any.

        Raises:
            CameraError: the camera was not started.
            RecorderError: the process does not run (CaptureGone) or answer.
        """
        reply = self._call({"op": "status"})
        reply["recording"] = Path(reply["recording"]) if reply["recording"] is not None else None
        reply["camera"] = CameraInfo(**reply["camera"]) if reply["camera"] is not None else None
        reply["warnings"] = tuple(reply["warnings"])
        return CaptureStatus(**reply)

    def close_recording(self) -> RecordingReport:
        """Finish the recording; its last file is called `<path>.part` until then.

        Returns:
            Path of the last file, its content id (hash of its messages), and frame counts of all files.

        Raises:
            RecorderError: no recording is open, a file could not be finished, or the process does not run
                (CaptureGone) or answer.
        """
        reply = self._call({"op": "close_recording"}, timeout_s=FINISH_TIMEOUT_S)
        return RecordingReport(Path(reply["path"]), reply["frames"], reply["lost"], reply["content_id"])

    def stop(self) -> None:
        """End the process; an open recording is finished first if the process still answers.

        A process that does not end within 15 s of that is terminated, and killed after another 15 s. Safe to
        call twice, and before `start`.
        """
        process = self._process
        if process is None:
            return
        with contextlib.suppress(AcquireError):
            self._call({"op": "stop"}, timeout_s=FINISH_TIMEOUT_S)
        self._stopping.set()
        if self._sender is not None:
            self._sender.join()
        with self._batch_lock:
            here, self._socket = self._socket, None
        if here is not None:
            here.close()
        for end in (lambda: None, process.terminate, process.kill):
            end()
            try:
                process.wait(15.0)
                break
            except subprocess.TimeoutExpired:
                continue
        if self._heartbeat is not None:
            self._heartbeat.join()
        self._process = None

    def _end_hung(self, process: subprocess.Popen[bytes]) -> None:
        self._hung = True
        process.kill()  # SIGTERM is handled by the interpreter, which does not run

    # --- transport ---

    def _call(
        self, header: dict[str, Any], payload: bytes = b"", timeout_s: float = REPLY_TIMEOUT_S
    ) -> dict[str, Any]:
        with self._call_lock:
            connection = self._socket
            if connection is None:
                raise CaptureGone(
                    "the capture process is not running: the daemon starts it again, see `acquire status`"
                )
            self._number += 1
            number = self._number
            try:
                self._flush(connection)
                with self._send_lock:
                    wire.send(connection, {"id": number, **header}, payload)
                connection.settimeout(timeout_s)
                while True:
                    reply, _ = wire.receive(connection)
                    if reply.pop("id", None) == number:  # an older number answers a call that timed out
                        break
            except TimeoutError:
                raise RecorderError(
                    f"the capture process did not answer {header['op']!r} within {timeout_s:g} s"
                ) from None
            except wire.WireClosed:
                raise CaptureGone(self._gone_text()) from None
        if "raised" in reply:
            raise errors.by_name(reply["raised"])(reply["message"])
        return reply

    def _gone_text(self) -> str:
        return (
            f"the capture process {self.end}: the daemon starts it again; "
            "`acquire recover` reads the *.part file it left"
        )

    def _flush(self, connection: socket.socket) -> None:
        with self._send_lock:
            with self._batch_lock:
                batch, names = bytes(self._batch), list(self._batch_topics)
                self._batch.clear()
                self._batch_topics.clear()
            if batch:
                wire.send(connection, {"op": "messages", "topics": names}, batch)

    def _send_batches(self) -> None:
        while not self._stopping.wait(BATCH_S):
            connection = self._socket
            if connection is None:
                return
            try:
                self._flush(connection)
            except wire.WireClosed:
                return  # the next call raises the reason
