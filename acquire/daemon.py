"""The daemon: owns camera, striker and recorder, and does what its clients ask over the local socket (api.py).

Capture (camera and file) is a process of its own; striker, API and watcher live here and can fail without losing a frame. What dies
of the child processes is started again, and said: as an event, in the recording's log, on standard error and in `status`.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from foxglove_schemas_protobuf.Log_pb2 import Log

from acquire.api import ApiServer, Connection
from acquire.capture_link import CaptureProcess
from acquire.clock import SystemClock
from acquire.config import RigConfig
from acquire.errors import AcquireError, DaemonBusy, RecorderError, SessionError, StrikerRefused
from acquire.manifest import CameraAtHand, calibration_message, session_files, session_manifest
from acquire.prompts import Prompts
from acquire.service import ServiceManager
from acquire.striker.base import Striker
from acquire.striker.dynamixel import DynamixelStriker
from acquire.striker.manual import ManualStriker
from acquire.watcher import Watcher
from schemas import topics
from schemas.documents import JudgeRequest, WatchEvent
from schemas.proto import percuss_pb2 as pb

TICK_S = 0.1
"""how often signals, the parent and the child processes are looked after"""
CAPTURE_RETRY_S = 1.0
WATCHER_LIVES = 3
"""an `analyze watch` that died this often in one recording is not started again"""


class Daemon:
    """One rig. `run` blocks until a signal or a client asks it to stop; everything is released on the way out."""

    def __init__(self, config: RigConfig, rig_toml: str) -> None:
        self._config = config
        self._rig_toml = rig_toml
        self._clock = SystemClock()
        self._stop_asked = False  # a plain flag: a signal handler that took a lock could wait for the very code it interrupts
        self._ending = False
        self._capture = CaptureProcess(config)
        self._striker = self._make_striker()
        self._striker_lock = threading.Lock()
        self._prompts = Prompts(self._publish)
        self._server: ApiServer | None = None
        self._watcher: Watcher | None = None
        self._wall_anchor_ns: int | None = None
        self._owner: Connection | None = None
        self._session_lock = threading.RLock()
        self._broken_off = ""
        """why the last recording ended, where nobody asked for its end"""
        self._stopped_for: Connection | None = None
        self._watcher_lives = 0
        self._expected = ""
        self._reviver: threading.Thread | None = None

    def run(self, on_ready: Any = None, goes_on: Callable[[], bool] = lambda: True) -> None:
        """Start everything, serve until asked to stop or `goes_on`, asked ten times a second, says no; release everything.

        Raises:
            AcquireError: a device or the socket cannot be had; nothing is left behind.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._ask_to_stop)
        service = ServiceManager.of_this_process()  # before there are children
        with contextlib.ExitStack() as cleanup:
            self._server = ApiServer(self._config.daemon.socket_path(), self._handlers())
            cleanup.callback(self._server.close)
            cleanup.callback(self._prompts.close)
            cleanup.callback(self._capture.stop)
            self._camera = self._capture.start()
            cleanup.callback(self._join_reviver)
            cleanup.callback(self._end_recording)
            cleanup.callback(self._release_striker)  # before all else: a file may take its time, a torque may not
            self._striker.open()
            if on_ready is not None:
                on_ready(self._status(None, {}))
            say_alive = cleanup.enter_context(service.serving(f"{self._camera.model} at {self._config.camera.address}"))
            while not self._stop_asked and goes_on():
                time.sleep(TICK_S)
                self._supervise()
                say_alive()

    def _ask_to_stop(self, *_: object) -> None:
        self._stop_asked = True

    # --- composition ----------------------------------------------------------------------------------------------

    def _make_striker(self) -> Striker:
        arguments = (self._config.striker, self._on_sample, self._on_event, self._on_clock, self._clock)
        return ManualStriker(*arguments) if self._config.striker.kind == "manual" else DynamixelStriker(*arguments)

    def _handlers(self) -> dict[str, Any]:
        return {
            "status": self._status,
            "shutdown": self._shutdown,
            "recording.open": self._open_recording,
            "recording.close": self._close_recording,
            "recording.state": self._write_state,
            "recording.strike": self._write_strike,
            "window.open": self._open_window,
            "window.close": self._close_window,
            "striker.home": self._striker_call("home"),
            "striker.arm": self._arm,
            "striker.cock": self._striker_call("cock"),
            "striker.strike": self._strike,
            "striker.stop": self._stop_striker,
            "watch.latest": self._latest,
            "watch.expect": self._expect,
            "watch.judge": self._judge,
            "prompt": self._prompts.ask,
            "prompt.answer": self._prompts.answer,
        }

    # --- recording ------------------------------------------------------------------------------------------------

    def _open_recording(self, connection: Connection, params: dict[str, Any]) -> dict[str, Any]:
        with self._session_lock:
            if self._wall_anchor_ns is not None:
                raise DaemonBusy("a recording is open already: end that session first, or see `acquire status`")
            path = Path(params["path"])
            files = session_files(params, self._rig_toml)
            anchor = self._clock.wall_ns() - self._clock.monotonic_ns()
            camera = CameraAtHand(self._camera, self._capture.status().clock_latched)
            manifest = session_manifest(self._config, camera, files, anchor)
            self._capture.open_recording(path, manifest, list(files.attachments))
            self._wall_anchor_ns, self._broken_off = anchor, ""
            self._owner = connection
            connection.on_close.append(lambda: self._owner_left(connection))
            camera_config = self._config.camera
            self._write(topics.camera_calibration(camera_config.name), calibration_message(camera_config.calibration))
            self._watcher_lives, self._expected = WATCHER_LIVES, ""
            self._watcher = Watcher(Path(f"{path}.part"), self._on_watch)
            return {"recording_id": manifest.recording_id, "wall_anchor_ns": anchor}

    def _close_recording(self, *_: object) -> dict[str, Any]:
        self._require_recording()
        return self._end_recording() or {}

    def _require_recording(self) -> None:
        if self._wall_anchor_ns is None:
            raise RecorderError(self._broken_off) if self._broken_off else SessionError("no recording is open")

    def _end_recording(self) -> dict[str, Any] | None:
        with self._session_lock:
            if self._wall_anchor_ns is None:
                return None
            self._forget_recording()
            report = self._capture.close_recording()
            return {"path": str(report.path), "frames": report.frames, "lost": report.lost, "content_id": report.content_id}

    def _forget_recording(self) -> None:
        self._wall_anchor_ns, self._owner = None, None
        watcher, self._watcher = self._watcher, None
        if watcher is not None:
            watcher.close()

    def _owner_left(self, connection: Connection) -> None:
        """The session's client is gone: nothing moves any more, and what was recorded is kept."""
        if self._owner is connection:
            self._striker.stop()
            with contextlib.suppress(AcquireError):
                self._end_recording()

    def _open_window(self, *_: object) -> dict[str, Any]:
        self._require_recording()
        return {"start_ns": self._capture.open_window()}

    def _close_window(self, *_: object) -> dict[str, Any]:
        self._require_recording()
        return asdict(self._capture.close_window())

    def _write(self, topic: topics.Topic, message: Any, host_time_ns: int | None = None) -> None:
        if (anchor := self._wall_anchor_ns) is not None:
            host_time_ns = self._clock.monotonic_ns() if host_time_ns is None else host_time_ns
            self._capture.write(topic.name, anchor + host_time_ns, message.SerializeToString())

    def _write_state(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        self._require_recording()
        message = pb.SessionState(**params)
        self._write(topics.SESSION_STATE, message)
        name = pb.SessionState.State.Name(message.state)
        self._log(f"{name} {message.strike_id} {message.text}".strip())
        self._publish("state", {"state": name, "strike_id": message.strike_id, "attempt": message.attempt, "text": message.text})
        return {}

    def _write_strike(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        self._require_recording()
        self._write(topics.SESSION_STRIKE, pb.StrikeRecord(**params))
        return {}

    def _log(self, text: str, level: Any = Log.Level.INFO) -> None:
        now = self._clock.monotonic_ns()
        message = Log(level=level, message=text, name="acquire")
        message.timestamp.FromNanoseconds((self._wall_anchor_ns or 0) + now)
        self._write(topics.LOG, message, now)

    # --- striker --------------------------------------------------------------------------------------------------

    def _striker_call(self, name: str) -> Any:
        def call(*_: object) -> dict[str, Any]:
            with self._striker_lock:
                self._refuse_at_the_end()
                getattr(self._striker, name)()
            return {"state": self._striker.state.value}

        return call

    def _arm(self, *arguments: object) -> dict[str, Any]:
        if self._wall_anchor_ns is not None:
            self._capture.require_space()  # no strike without room to record it
        return self._striker_call("arm")(*arguments)

    def _refuse_at_the_end(self) -> None:
        if self._ending:
            raise StrikerRefused("the daemon is stopping: the striker takes no more orders")

    def _release_striker(self) -> None:
        """End what moves, torque off, and let nobody move it any more."""
        self._ending = True
        while not self._striker_lock.acquire(timeout=0.02):
            self._striker.stop()
        try:
            self._striker.close()
        finally:
            self._striker_lock.release()

    def _strike(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        if not self._striker_lock.acquire(timeout=0.1):
            raise StrikerRefused("the striker is busy with another order")
        try:
            self._refuse_at_the_end()
            outcome = self._striker.strike(str(params["strike_id"]), float(params["tip_speed_m_s"]))
        finally:
            self._striker_lock.release()
        return asdict(outcome)

    def _stop_striker(self, *_: object) -> dict[str, Any]:
        self._striker.stop()
        self._log("striker stopped on request", Log.Level.WARNING)
        return {"state": self._striker.state.value}

    def _on_sample(self, message: pb.StrikerSample) -> None:
        self._write(topics.STRIKER_SAMPLE, message, (message.host_before_ns + message.host_after_ns) // 2)

    def _on_event(self, message: pb.StrikerEvent) -> None:
        self._write(topics.STRIKER_EVENT, message, message.host_time_ns)
        self._publish("striker", {"kind": pb.StrikerEvent.Kind.Name(message.kind), "text": message.text})

    def _on_clock(self, message: pb.ClockSample) -> None:
        self._write(topics.CLOCK_SAMPLE, message, (message.host_before_ns + message.host_after_ns) // 2)

    # --- watch ----------------------------------------------------------------------------------------------------

    def _on_watch(self, event: WatchEvent) -> None:
        self._publish("watch", event.model_dump(mode="json"))

    def _latest(self, *_: object) -> dict[str, Any]:
        watcher = self._watcher
        event = watcher.latest if watcher is not None else None
        return {"event": event.model_dump(mode="json") if event else None, "alive": watcher is not None and watcher.alive}

    def _expect(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        self._expected = str(params["plan_strike_id"])
        if (watcher := self._watcher) is not None:
            watcher.expect(self._expected)
        return {"now_ns": (self._wall_anchor_ns or 0) + self._clock.monotonic_ns()}

    def _judge(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        timeout = float(params.pop("timeout_s", 10.0))
        watcher = self._watcher
        verdict = watcher.judge(JudgeRequest(kind="judge", **params), timeout) if watcher is not None else None
        return {"verdict": verdict.model_dump(mode="json") if verdict else None}

    # --- clients and child processes that are gone ------------------------------------------------------------------

    def _supervise(self) -> None:
        owner = self._owner
        if owner is not None and owner is not self._stopped_for and owner.gone:
            self._stopped_for = owner
            self._striker.stop()  # a strike under way keeps the owner's own thread; the rest is done by _owner_left
        if self._capture.alive:
            if self._session_lock.acquire(blocking=False):
                try:
                    self._revive_watcher()
                finally:
                    self._session_lock.release()
        elif self._reviver is None or not self._reviver.is_alive():
            self._reviver = threading.Thread(target=self._revive_capture, name="revive-capture")
            self._reviver.start()  # a camera that is away takes its time, and so does one whose last client died

    def _revive_capture(self) -> None:
        with self._session_lock:
            if self._wall_anchor_ns is not None:
                self._broken_off = "the recording broke off: the capture process ended; `acquire recover` reads what it left as *.part"
                self._complain(self._broken_off)
                self._forget_recording()
        said = ""
        while not self._ending:
            self._capture.stop()
            try:
                self._camera = self._capture.start()
            except AcquireError as error:
                if str(error) != said:
                    said = str(error)
                    self._complain(f"the capture process does not start: {said}")
                time.sleep(CAPTURE_RETRY_S)
            else:
                self._complain("the capture process ended and was started again")
                return

    def _join_reviver(self) -> None:
        if self._reviver is not None:
            self._reviver.join()

    def _revive_watcher(self) -> None:
        watcher = self._watcher
        if watcher is None or watcher.alive or self._watcher_lives == 0:
            return
        self._watcher_lives -= 1
        watcher.close()
        if self._watcher_lives == 0:
            self._complain("analyze watch keeps ending: the recording goes on without verdicts")
            return
        self._watcher = Watcher(watcher.recording, self._on_watch)
        if self._expected:
            self._watcher.expect(self._expected)
        self._complain("analyze watch ended and was started again")

    def _complain(self, text: str) -> None:
        """Tell everybody who may listen."""
        self._log(text, Log.Level.WARNING)
        self._publish("trouble", {"text": text})
        with contextlib.suppress(OSError):
            sys.stderr.write(f"acquire: {text}\n")

    # --- the rest -------------------------------------------------------------------------------------------------

    def _publish(self, event: str, data: dict[str, Any]) -> None:
        if self._server is not None:
            self._server.publish(event, data)

    def _status(self, *_: object) -> dict[str, Any]:
        try:
            capture = asdict(self._capture.status())
        except AcquireError as error:
            capture = {"error": str(error)}
        numbers = ("frames", "lost", "dropped", "fps", "bytes_written", "receive_buffer_bytes")
        return {
            "rig": self._config.name,
            "pid": os.getpid(),
            "socket": str(self._config.daemon.socket_path()),
            "striker": self._striker.state.value,
            **{name: capture.get(name, 0) for name in numbers},
            "recording": str(capture["recording"]) if capture.get("recording") else None,
            "camera": {"vendor": self._camera.vendor, "model": self._camera.model, "serial": self._camera.serial},
            "connected": capture.get("connected", False),
            "trouble": capture["error"],
            "warnings": list(capture.get("warnings", ())),
            "watching": (watcher := self._watcher) is not None and watcher.alive,
        }

    def _shutdown(self, *_: object) -> dict[str, Any]:
        self._stop_asked = True
        return {}
