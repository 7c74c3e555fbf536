"""The daemon's open recording; one file, because requests, windows and interruption share one lock and state.

The recording consists of one file, or of several if the capture process died meanwhile. A capture process
that dies, or hangs and is killed, takes its file with it. The daemon starts another one, and the recording
continues in the next numbered file with the same id and anchor (log time minus host monotonic time). The file
of the dead process is rebuilt beside it, and the loss in between is reported: in the log of the next file, to
every subscriber and on standard error. Requests about an interrupted window (time span of a strike) raise
RecordingBroken.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from foxglove_schemas_protobuf.Log_pb2 import Log

from acquire.camera.base import CameraInfo
from acquire.capture.link import CaptureProcess
from acquire.clock.clock import Clock
from acquire.daemon.manifest import OpenCamera, session_files, session_manifest
from acquire.daemon.recording_state import RecordingState
from acquire.daemon.salvage import Salvage
from acquire.daemon.watch_supervisor import WatchSupervisor
from acquire.daemon.watcher import Watcher
from acquire.errors import AcquireError, CaptureGone, DaemonBusy, RecorderError, RecordingBroken, SessionError
from acquire.recorder.file_series import newest_part, part_path
from acquire.recorder.writer import PART_SUFFIX
from schemas import topics
from schemas.calibration_message import calibration_message
from schemas.rig import RigConfig
from schemas.session_manifest import SessionManifest
from schemas.watch_lines import WatchEvent
from schemas.wording import counted

T = TypeVar("T")

CONTINUE_TIMEOUT_S = 30.0
"""longest wait for a restarted capture process [s]; a camera gives control back 3 s after a client's sudden
death"""
FIRST_FRAME_TIMEOUT_S = 10.0


class LiveRecording:
    """The daemon's recording, at most one at a time.

    Methods may be called from any thread. `write` and `log` do not wait for the capture process, except while
    an interrupted recording is being resumed.

    Args:
        config: the rig.
        rig_toml: text of the rig file.
        capture: capture process.
        clock: host clock.
        on_watch: called with each observation of the newest image by the child process `analyze watch`.
        complain: function that reports a problem (text) to people; it also calls `log`.

    Raises:
        SessionError: from a method that needs an open recording, if none is open.
        RecorderError: from such a method, if the recording was interrupted and could not continue.
    """

    def __init__(
        self,
        config: RigConfig,
        rig_toml: str,
        capture: CaptureProcess,
        clock: Clock,
        on_watch: Callable[[WatchEvent], None],
        complain: Callable[[str], None],
    ) -> None:
        self._config = config
        self._rig_toml = rig_toml
        self._capture = capture
        self._clock = clock
        self._on_watch = on_watch
        self._complain = complain
        self._open: RecordingState | None = None
        self._ended_by = ""
        """reason why the last recording ended without a request; empty otherwise"""
        self._changed = threading.Condition(threading.RLock())

    # --- open and close ---

    def open(self, owner: object, params: dict[str, Any], camera: CameraInfo) -> SessionManifest:
        """Open a recording and return its manifest (object, hash of the plan, camera and clock).

        Args:
            owner: client that opens it.
            params: parameters of the request `recording.open`: path of the recording, texts of object and
                plan, content of the object's shape file.
            camera: identity of the camera.

        Raises:
            DaemonBusy: a recording is open already.
            AcquireError: object, plan or path cannot be used, or the capture process refuses.
        """
        latched = self._retry(self._capture.status).clock_latched
        with self._changed:
            if self._open is not None:
                raise DaemonBusy(
                    "a recording is open already: end that session first, or see `acquire status`"
                )
            files = session_files(params, self._rig_toml)
            anchor = self._clock.wall_ns() - self._clock.monotonic_ns()
            manifest = session_manifest(self._config, OpenCamera(camera, latched), files, anchor)
            opened = RecordingState(
                Path(params["path"]),
                manifest,
                list(files.attachments),
                owner,
                WatchSupervisor(self._on_watch),
            )
            self._begin(opened)
            self._open, self._ended_by = opened, ""
            return manifest

    @property
    def owner(self) -> object | None:
        """Client that opened the recording; None if no recording is open."""
        opened = self._open
        return opened.owner if opened is not None else None

    @property
    def anchor_ns(self) -> int | None:
        """Log time (Unix time in the recording) minus host monotonic time [ns]; None if none is open."""
        opened = self._open
        return opened.manifest.wall_anchor_ns if opened is not None else None

    def close(self) -> dict[str, Any]:
        """Close the recording, once its files that were cut short by an interruption are recovered.

        Returns:
            `path` (the last file, or the first of the series if the recording was interrupted), `files` (the
            last file, after those recovered from interruptions), the numbers `frames` and `lost` over all
            files, and `content_id` (hash of the last file's messages; empty if it was cut short).

        Raises:
            SessionError: no recording is open.
            RecorderError: the recording ended by itself, or the file cannot be finished.
        """
        if (opened := self._open) is not None:
            for salvage in list(opened.salvages):
                salvage.result()  # its report belongs to this recording's log
            self._report_refused(opened)
        with self._changed:
            opened = self._open
            if opened is None:
                raise self._not_open_error()
            self._forget(opened)
            path, frames, lost, content_id = None, 0, 0, ""
            if not opened.broken:
                try:
                    report = self._capture.close_recording()
                    path, frames, lost, content_id = (
                        report.path,
                        report.frames,
                        report.lost,
                        report.content_id,
                    )
                except CaptureGone:
                    opened.broken = f"the capture process {self._capture.end}"
            if opened.broken:
                before, opened.part = opened.part, newest_part(opened.path) + 1
                self._salvage_parts(opened, before, lambda: None)
            self._changed.notify_all()
        earlier = [salvage.result() for salvage in opened.salvages]
        files = [*(file for each in earlier for file in each.files), *([path] if path is not None else [])]
        return {
            "path": str(files[-1] if files and not earlier else opened.path),
            "files": [str(file) for file in files],
            "frames": frames + sum(each.frames for each in earlier),
            "lost": lost + sum(each.lost for each in earlier),
            "content_id": content_id,
        }

    # --- messages and windows ---

    def write(self, topic: topics.Topic, message: Any, host_time_ns: int | None = None) -> bool:
        """Record a small message; during an interruption the next file gets it.

        Does nothing if no recording is open. Messages that the capture process does not take, as too many
        wait for it, are counted, and reported as soon as it takes one again.

        Args:
            topic: topic of the message.
            message: protobuf message of the topic's type.
            host_time_ns: host monotonic time of the message [ns]; None: now.

        Returns:
            False if the message is not recorded.
        """
        opened = self._open
        if opened is None:
            return False
        host_time_ns = self._clock.monotonic_ns() if host_time_ns is None else host_time_ns
        entry = (topic, opened.manifest.wall_anchor_ns + host_time_ns, message.SerializeToString())
        if opened.broken:
            with self._changed:
                if opened.broken:
                    opened.waiting.append(entry)
                    return True
        if not self._capture.write(topic.name, *entry[1:]):
            opened.refused += 1
            return False
        self._report_refused(opened)
        return True

    def _report_refused(self, opened: RecordingState) -> None:
        """Report the number of messages that the capture process did not take since the last report."""
        refused, opened.refused = opened.refused, 0
        if refused:
            self._complain(
                f"{counted(refused, 'message')} of striker and session were not recorded: the capture process"
                " took none for too long: see `acquire status`"
            )

    def log(self, text: str, level: Any = Log.Level.INFO) -> None:
        """Record a line of text with a severity (foxglove.Log level), if a recording is open."""
        now = self._clock.monotonic_ns()
        message = Log(level=level, message=text, name="acquire")
        message.timestamp.FromNanoseconds((self.anchor_ns or 0) + now)
        self.write(topics.LOG, message, now)

    def wait_until_recording(self) -> None:
        """Wait until the recording continues after an interruption, at most CONTINUE_TIMEOUT_S.

        Returns at once if the recording is not interrupted.

        Raises:
            SessionError: no recording is open.
            RecorderError: the recording did not continue in that time.
        """
        self._uninterrupted()

    def write_record(self, topic: topics.Topic, message: Any) -> None:
        """Record a strike or toss (StrikeRecord, TossRecord); on return the capture process has it.

        Args:
            topic: topic of such messages.
            message: the message.

        Raises:
            RecordingBroken: its images are in a file that was cut short, or the capture process
                died with the message.
            SessionError: no recording is open.
            RecorderError: the recording could not continue, or the capture process takes no messages.
        """
        opened = self._uninterrupted()
        opened.refuse_earlier_file(message.window_start_ns)
        taken = self.write(topic, message)
        try:
            self._capture.status()
        except CaptureGone as error:
            raise RecordingBroken(str(error)) from None
        if not taken:
            raise RecorderError(
                "the strike or toss was not recorded: the capture process takes no messages: "
                "see `acquire status`"
            )

    def require_space(self) -> None:
        """Raise RecorderError if the disk has no room for the images of a window (time span of a strike).

        Does nothing if no recording is open.

        Raises:
            RecorderError: too little space is free, the recording could not continue after an interruption,
                or no capture process runs after CONTINUE_TIMEOUT_S (CaptureGone).
            SessionError: the recording was closed meanwhile.
        """
        if self._open is not None:
            self._ask(self._capture.require_space)

    def open_window(self) -> int:
        """Open a window (time span of a strike): record every image from the pre-trigger time before now on.

        Returns:
            Start of the window as a log time [ns].

        Raises:
            SessionError: no recording is open.
            RecorderError: a window is open already, the file accepts no more images, the recording could not
                continue after an interruption, or no capture process runs (CaptureGone).
        """
        start_ns = self._ask(self._capture.open_window)
        opened = self._uninterrupted()
        opened.window_part = opened.part
        return start_ns

    def close_window(self, end_ns: int = 0) -> dict[str, Any]:
        """Close the window (time span of a strike) and report its content.

        Args:
            end_ns: log time [ns] at which the window ends if that time has passed, so that later images are
                not waited for; 0, or a time to come: it ends now.

        Returns:
            `start_ns` and `end_ns`, log times of the first and last image, and the numbers `frames` and
            `lost`.

        Raises:
            RecordingBroken: the window was opened in a file that was cut short, or the capture process dies
                now.
            SessionError: no recording is open.
            RecorderError: the recording could not continue, or no window is open.
        """
        opened = self._uninterrupted()
        part, opened.window_part = opened.window_part, None
        if part is not None and part != opened.part:
            raise RecordingBroken(f"the window was cut off: {part_path(opened.path, part).name} ends in it")
        try:
            return asdict(self._capture.close_window(end_ns))
        except CaptureGone as error:
            raise RecordingBroken(f"the window was cut off: {error}") from None

    # --- death of the capture process ---

    def interrupt(self, reason: str) -> None:
        """Mark the recording as interrupted by the death of the capture process, and report it.

        Does nothing if no recording is open, or it is interrupted already.

        Args:
            reason: reason of the death, in words that continue "the capture process", as "ended (exit
                code 1)".
        """
        with self._changed:
            opened = self._open
            if opened is None or opened.broken:
                return
            opened.broken = reason
            opened.watch.stop()
        self._complain(f"the recording was interrupted: the capture process {reason}")

    def resume(self) -> None:
        """Continue an interrupted recording in the next file, now that the capture process runs; report it.

        The files of the dead capture process are recovered meanwhile. If the next file cannot be begun, the
        recording ends, and later requests raise RecorderError with the reason. Does nothing if no recording
        is open, or it is not interrupted.
        """
        with self._changed:
            opened = self._open
            if opened is None or not opened.broken:
                return
            before, broken = opened.part, opened.broken
            opened.part = newest_part(opened.path) + 1
            try:
                self._begin(opened)
            except AcquireError as error:
                opened.part = before
                self._ended_by = (
                    f"the recording ended: the capture process {broken}, "
                    f"and the recording could not continue: {error}"
                )
                self._forget(opened)
                report = self._ended_by
            else:
                opened.broken = ""
                file = part_path(opened.path, opened.part)
                report = f"the recording continues in {file.name}"
                self._salvage_parts(opened, before, lambda: self._wait_for_first_frame(file))
            self._changed.notify_all()
        self._complain(report)

    def _salvage_parts(
        self, opened: RecordingState, first: int, next_frame_ns: Callable[[], int | None]
    ) -> None:
        """Start to rebuild a dead capture process's files: number `first` up to that before the current file.

        Args:
            opened: state of the recording, to which the recovery is added; `part` is the current file.
            first: number of the first file that the dead process wrote.
            next_frame_ns: function that waits for the current file's first frame and returns its log time
                [ns]; None if there is none.
        """
        camera = self._config.camera
        files = [part_path(opened.path, number) for number in range(first, opened.part)]
        opened.salvages.append(
            Salvage(
                files,
                camera.name,
                camera.frame_rate_hz,
                next_frame_ns,
                lambda found: self._complain(found.text),
            )
        )

    def _wait_for_first_frame(self, file: Path) -> int | None:
        """Wait for the first frame of the recording that continues in `file`, up to FIRST_FRAME_TIMEOUT_S.

        Returns:
            Log time of that frame [ns]; None if none comes in that time, or another file than `file` is
            being recorded.
        """
        end = time.monotonic() + FIRST_FRAME_TIMEOUT_S
        while time.monotonic() < end:
            with contextlib.suppress(AcquireError):
                status = self._capture.status()
                if status.recording is None or status.recording.absolute() != file.absolute():
                    return None
                if status.first_frame_ns is not None:
                    return status.first_frame_ns
            time.sleep(0.1)
        return None

    # --- watch ---

    @property
    def watcher(self) -> Watcher | None:
        """Child process `analyze watch` of the open recording; None if there is no recording or child."""
        opened = self._open
        return opened.watch.watcher if opened is not None else None

    def series(self) -> tuple[Path, int]:
        """First file of the open recording, as it is written, and the number of the present one.

        Raises:
            SessionError: no recording is open.
        """
        opened = self._uninterrupted()
        return Path(f"{part_path(opened.path, 1)}{PART_SUFFIX}"), opened.part

    def expect(self, plan_strike_id: str) -> None:
        """Make `analyze watch` compare the object's placement with a strike of the plan from now on.

        Args:
            plan_strike_id: id of the strike in the plan.

        Raises:
            SessionError: no recording is open.
            RecorderError: the recording could not continue after an interruption.
        """
        opened = self._uninterrupted()
        opened.watch.expect(plan_strike_id)

    def revive_watcher(self) -> None:
        """Restart the child process `analyze watch` if it ended, a limited number of times; report it.

        Does nothing while another thread opens, closes or resumes the recording.
        """
        if not self._changed.acquire(blocking=False):
            return
        try:
            opened = self._open
            report = opened.restart_watching_if_ended() if opened is not None else ""
        finally:
            self._changed.release()
        if report:
            self._complain(report)

    # --- under the lock ---

    def _begin(self, opened: RecordingState) -> None:
        """Make the capture process begin the recording's current file, and start `analyze watch` on it.

        The file's first messages are the camera's calibration and those that waited for this file.

        Args:
            opened: state of the recording; `part` is the number of the current file.

        Raises:
            AcquireError: the capture process cannot begin the file.
        """
        now = self._clock.monotonic_ns()
        anchor = opened.manifest.wall_anchor_ns
        self._capture.open_recording(
            opened.path, opened.manifest.model_copy(update={"part": opened.part}), opened.attachments
        )
        opened.began_ns = anchor + now
        camera = self._config.camera
        calibration = calibration_message(camera.calibration, "camera").SerializeToString()
        self._capture.write(topics.camera_calibration(camera.name).name, anchor + now, calibration)
        for topic, log_time_ns, data in opened.waiting:
            self._capture.write(topic.name, log_time_ns, data)
        opened.waiting.clear()
        opened.start_watching()

    def _forget(self, opened: RecordingState) -> None:
        self._open = None
        opened.watch.stop()

    # --- waiting ---

    def _not_open_error(self) -> AcquireError:
        return RecorderError(self._ended_by) if self._ended_by else SessionError("no recording is open")

    def _uninterrupted(self) -> RecordingState:
        """State of the open recording; waits while the recording is interrupted.

        Raises:
            SessionError: no recording is open.
            RecorderError: the recording ended by itself, or did not continue within CONTINUE_TIMEOUT_S.
        """
        with self._changed:
            opened = self._open
            if opened is None:
                raise self._not_open_error()
            self._changed.wait_for(lambda: not opened.broken or self._open is not opened, CONTINUE_TIMEOUT_S)
            if self._open is not opened:
                raise self._not_open_error()
            if opened.broken:
                raise RecorderError(
                    f"the recording was interrupted and did not continue: "
                    f"the capture process {opened.broken}: see `acquire status`"
                )
            return opened

    def _ask(self, ask: Callable[[], T]) -> T:
        """Make a request to the capture process once the recording is not interrupted; return the result.

        Args:
            ask: function that sends the request and returns the result; called again if the process died.

        Raises:
            SessionError: no recording is open.
            RecorderError: the recording ended by itself or did not continue, the capture process refused the
                request, or none runs (CaptureGone).
        """

        def attempt() -> T:
            self._uninterrupted()
            return ask()

        return self._retry(attempt)

    def _retry(self, ask: Callable[[], T]) -> T:
        """Make a request to the capture process, again with the next one if it died; return the result.

        Args:
            ask: function that sends the request and returns the result; raises CaptureGone if the process
                died.

        Raises:
            CaptureGone: there is no running process after CONTINUE_TIMEOUT_S.
        """
        end = time.monotonic() + CONTINUE_TIMEOUT_S
        while True:
            try:
                return ask()
            except CaptureGone:
                if time.monotonic() > end:
                    raise
                time.sleep(0.1)  # the daemon notices the death as soon
