"""The daemon: owns camera, striker and recorder, and serves clients over a local socket (server.py).

Capture (camera and file) is a process of its own; striker, API and watcher run here and can fail without
losing a frame. A child process that dies, or hangs and is killed, is started again and reported: as an event,
in the recording's log, on standard error and in `status`. The recording itself is in live_recording.py.
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
from typing import Any

from foxglove_schemas_protobuf.Log_pb2 import Log

from acquire.capture.link import CaptureProcess
from acquire.clock.clock import SystemClock
from acquire.config import RigLimits
from acquire.daemon.adviser import Adviser
from acquire.daemon.attendance import Attendance
from acquire.daemon.compactor import Compactor
from acquire.daemon.live_recording import LiveRecording
from acquire.daemon.prompts import Prompts
from acquire.daemon.server import ApiServer, Connection
from acquire.daemon.service import ServiceManager
from acquire.daemon.session_board import SessionBoard
from acquire.daemon.striker_control import StrikerControl
from acquire.errors import AcquireError, SessionError
from acquire.striker.base import Striker
from acquire.striker.kinds import make_striker
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from schemas.rig import RigConfig
from schemas.watch_lines import AdviceRequest, JudgeRequest, TossRequest, WatchEvent

TICK_S = 0.1
"""interval between checks of signals, the parent and the child processes [s]"""
CAPTURE_RETRY_S = 1.0
URGENT = frozenset({"striker.stop", "recording.close", "shutdown"})
"""requests that are carried out however many programs are connected"""


class Daemon:
    """Daemon of one rig (camera and striker), which serves clients until a signal or a client stops it.

    Args:
        config: the rig.
        rig_toml: text of the rig file, attached to every recording.
        capture: capture process; None: a new one for this rig.
    """

    def __init__(self, config: RigConfig, rig_toml: str, capture: CaptureProcess | None = None) -> None:
        self._config = config
        self._clock = SystemClock()
        # A plain flag: a signal handler that took a lock could wait for the very code that it interrupts.
        self._stop_requested = False
        self._ending = False
        self._capture = capture or CaptureProcess(config)
        self._recording = LiveRecording(
            config, rig_toml, self._capture, self._clock, self._on_watch, self._complain
        )
        self._control = StrikerControl(self._make_striker(), self._recording.require_space)
        self._prompts = Prompts(self._publish, lambda: self._control.stopped)
        self._adviser = Adviser(lambda estimate: self._publish("estimate", estimate.model_dump(mode="json")))
        self._compactor = Compactor(config.recorder, self._complain)
        self._attendance = Attendance(self._publish, lambda: self._control.stopped)
        self._board = SessionBoard(self._publish)
        self._server: ApiServer | None = None
        self._stopped_for: Connection | None = None
        self._reviver: threading.Thread | None = None

    def run(self, on_ready: Any = None, goes_on: Callable[[], bool] = lambda: True) -> None:
        """Open the devices and serve clients until a stop request; then release everything.

        Stop requests are the signals SIGTERM, SIGINT and SIGHUP, for which handlers are installed, and a
        client's `shutdown`.

        Args:
            on_ready: called once with the answer to `status` (a JSON object), when clients are served and all
                devices are open.
            goes_on: function called ten times a second; when it returns False, the daemon ends as after a
                stop request.

        Raises:
            AcquireError: a device or the socket is not available; everything is released.
        """
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._request_stop)
        service = ServiceManager.from_environment()  # before there are child processes
        with contextlib.ExitStack() as cleanup:
            self._server = ApiServer(
                self._config.daemon.socket_path(),
                self._handlers(),
                urgent=URGENT,
                complain=self._complain,
                greet=self._prompts.repeat,
            )
            for part in (self._server, self._prompts, self._adviser, self._compactor, self._attendance):
                cleanup.callback(part.close)
            cleanup.callback(self._capture.stop)
            self._camera = self._capture.start()
            cleanup.callback(self._join_reviver)
            cleanup.callback(self._end_recording)
            # Runs before the others: finishing a file may take long, releasing the torque must not.
            cleanup.callback(self._release_striker)
            self._control.striker.open()
            if on_ready is not None:
                on_ready(self._status(None, {}))
            report_alive = cleanup.enter_context(
                service.running(f"{self._camera.model} at {self._config.camera.address}")
            )
            while not self._stop_requested and goes_on():
                time.sleep(TICK_S)
                self._supervise()
                if self._server.accepting:
                    report_alive()

    def _request_stop(self, *_: object) -> None:
        self._stop_requested = True

    # --- composition ---

    def _make_striker(self) -> Striker:
        return make_striker(
            self._config.striker,
            lambda sample: self._write_timed(topics.STRIKER_SAMPLE, sample),
            self._on_event,
            lambda sample: self._write_timed(topics.CLOCK_SAMPLE, sample),
            self._clock,
        )

    def _handlers(self) -> dict[str, Any]:
        owned = {
            "recording.state": self._write_state,
            "recording.strike": self._write_strike,
            "recording.toss": self._write_toss,
            "window.open": lambda *_: {"start_ns": self._recording.open_window()},
            "window.close": lambda _, params: self._recording.close_window(int(params.get("end_ns", 0))),
            "striker.home": lambda _, params: self._control.home(params),
            "striker.arm": lambda *_: self._control.arm(),
            "striker.cock": lambda *_: self._control.cock(),
            "striker.strike": lambda _, params: self._control.strike(params),
            "watch.expect": self._expect,
            "watch.judge": self._judge,
            "watch.judge_toss": self._judge_toss,
            "watch.advise": self._advise,
            "prompt": self._prompts.ask,
            "session.report": self._board.report,
            "hold.wait": self._attendance.wait,
        }
        return {name: self._for_owner(handler) for name, handler in owned.items()} | {
            "status": self._status,
            "rig": lambda *_: RigLimits.from_config(self._config).as_dict(),
            "shutdown": self._shutdown,
            "recording.open": self._open_recording,
            "recording.close": lambda *_: self._close_recording(),
            "striker.stop": self._stop_striker,
            "watch.latest": self._latest,
            "prompt.answer": self._prompts.answer,
            "session.status": self._board.status,
            "session.curve": self._board.curve,
            "hold": self._attendance.hold,
            "hold.status": self._attendance.status,
            "hold.release": self._attendance.release,
            "attend": self._attendance.attend,
            "attend.leave": self._attendance.leave,
            "preview": lambda *_: self._capture.preview.address(),
        }

    def _for_owner(self, handler: Callable[[Connection, dict[str, Any]], dict[str, Any]]) -> Any:
        """Restrict a request to the client that opened the recording, while a recording is open.

        Other clients may still make the unrestricted requests: look, stop the arm, answer a prompt, end the
        recording or the daemon.

        Args:
            handler: function that carries out the request, given connection and parameters.

        Returns:
            Function that calls `handler`, or raises SessionError for other clients.
        """

        def call(connection: Connection, params: dict[str, Any]) -> dict[str, Any]:
            owner = self._recording.owner
            if owner is not None and owner is not connection:
                raise SessionError(
                    "another program's session is open: wait for its end, or end it with `acquire stop`"
                )
            return handler(connection, params)

        return call

    # --- recording ---

    def _open_recording(self, connection: Connection, params: dict[str, Any]) -> dict[str, Any]:
        stops = self._control.stops
        self._adviser.close()
        manifest = self._recording.open(connection, params, self._camera)
        self._compactor.pause()
        self._control.clear_stops(stops)  # a person starts again
        self._attendance.begin_session()
        self._board.begin_session()
        connection.on_close.append(lambda: self._owner_left(connection))
        return {"recording_id": manifest.recording_id, "wall_anchor_ns": manifest.wall_anchor_ns}

    def _close_recording(self) -> dict[str, Any]:
        closed = self._recording.close()
        self._compactor.enqueue(closed["files"])
        return closed

    def _end_recording(self) -> None:
        if self._recording.owner is not None:
            with contextlib.suppress(SessionError):  # its client closed it first
                self._close_recording()

    def _owner_left(self, connection: Connection) -> None:
        """Stop the striker and close the recording when the client that opened it has gone.

        Does nothing if that client is not the one of `connection`, or no recording is open.
        """
        if self._recording.owner is connection:
            self._control.striker.stop()
            with contextlib.suppress(AcquireError):
                self._close_recording()

    def _write_state(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        self._recording.wait_until_recording()
        message = pb.SessionState(**params)
        self._recording.write(topics.SESSION_STATE, message)
        name = pb.SessionState.State.Name(message.state)
        self._recording.log(f"{name} {message.strike_id or message.toss_id} {message.text}".strip())
        keys = ("strike_id", "attempt", "text", "toss_id")
        self._publish("state", {"state": name} | {key: getattr(message, key) for key in keys})
        return {}

    def _write_strike(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        self._recording.write_record(topics.SESSION_STRIKE, pb.StrikeRecord(**params))
        self._attendance.note_strike()
        if self._attendance.attended and not self._adviser.asked:
            self._adviser.inform(*self._recording.series(), str(params["strike_id"]))
        return {}

    def _write_toss(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        self._recording.write_record(topics.SESSION_TOSS, pb.TossRecord(**params))
        return {}

    # --- striker ---

    def _stop_striker(self, *_: object) -> dict[str, Any]:
        state = self._control.stop()
        self._prompts.stop()
        self._recording.log("striker stopped on request", Log.Level.WARNING)
        return state

    def _release_striker(self) -> None:
        self._ending = True
        self._control.release()

    def _write_timed(self, topic: topics.Topic, message: pb.StrikerSample | pb.ClockSample) -> None:
        self._recording.write(topic, message, (message.host_before_ns + message.host_after_ns) // 2)

    def _on_event(self, message: pb.StrikerEvent) -> None:
        self._recording.write(topics.STRIKER_EVENT, message, message.host_time_ns)
        self._publish("striker", {"kind": pb.StrikerEvent.Kind.Name(message.kind), "text": message.text})
        if message.kind == pb.StrikerEvent.FAULT:
            self._control.note_fault(message.text)
            self._complain(f"the striker is in a fault: {message.text}")

    # --- watch ---

    def _on_watch(self, event: WatchEvent) -> None:
        self._publish("watch", event.model_dump(mode="json"))

    def _latest(self, *_: object) -> dict[str, Any]:
        watcher = self._recording.watcher
        event = watcher.latest if watcher is not None else None
        estimate = self._adviser.latest
        return {
            "event": event.model_dump(mode="json") if event else None,
            "estimate": estimate.model_dump(mode="json") if estimate else None,
            "alive": watcher is not None and watcher.alive,
        }

    def _expect(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        self._recording.expect(str(params["plan_strike_id"]))
        return {"now_ns": (self._recording.anchor_ns or 0) + self._clock.monotonic_ns()}

    def _judge(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        timeout = float(params.pop("timeout_s", 10.0))
        watcher = self._recording.watcher
        verdict = (
            watcher.judge(JudgeRequest(kind="judge", **params), timeout) if watcher is not None else None
        )
        self._board.keep_curve(verdict)
        return {"verdict": verdict.model_dump(mode="json") if verdict else None}

    def _judge_toss(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        timeout = float(params.pop("timeout_s", 10.0))
        watcher, request = self._recording.watcher, TossRequest(**params)
        verdict = watcher.judge_toss(request, timeout) if watcher is not None else None
        return {"verdict": verdict.model_dump(mode="json") if verdict else None}

    def _advise(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        timeout = float(params.pop("timeout_s", 10.0))
        file, part = self._recording.series()
        estimate = self._adviser.ask(file, part, AdviceRequest(**params), timeout)
        return {"estimate": estimate.model_dump(mode="json") if estimate else None}

    # --- clients and child processes that ended ---

    def _supervise(self) -> None:
        self._attendance.supervise()
        owner = self._recording.owner
        if isinstance(owner, Connection) and owner is not self._stopped_for and owner.gone:
            self._stopped_for = owner
            # A strike in progress occupies the owner's own thread; _owner_left does the rest.
            self._control.striker.stop()
        if self._capture.alive:
            self._recording.revive_watcher()
        elif self._reviver is None or not self._reviver.is_alive():
            self._reviver = threading.Thread(target=self._revive_capture, name="revive-capture")
            self._reviver.start()  # an absent camera takes long, and so does one whose last client died

    def _revive_capture(self) -> None:
        ended = self._capture.end
        self._recording.interrupt(ended)
        reported = ""
        while not self._ending:
            self._capture.stop()
            try:
                self._camera = self._capture.start()
            except AcquireError as error:
                if str(error) != reported:
                    reported = str(error)
                    self._complain(f"the capture process does not start: {reported}")
                time.sleep(CAPTURE_RETRY_S)
            else:
                self._complain(f"the capture process {ended}; it was started again")
                self._recording.resume()
                return

    def _join_reviver(self) -> None:
        if self._reviver is not None:
            self._reviver.join()

    def _complain(self, text: str) -> None:
        """Report the problem `text` in the recording's log, to subscribers and on standard error."""
        self._recording.log(text, Log.Level.WARNING)
        self._publish("trouble", {"text": text})
        with contextlib.suppress(OSError):
            sys.stderr.write(f"acquire: {text}\n")

    # --- status ---

    def _publish(self, event: str, data: dict[str, Any]) -> None:
        if self._server is not None:
            self._server.publish(event, data)

    def _status(self, *_: object) -> dict[str, Any]:
        try:
            capture = asdict(self._capture.status())
        except AcquireError as error:
            capture = {"error": str(error)}
        numbers = (
            "frames",
            "lost",
            "foreign_packets",
            "dropped",
            "waiting_bytes",
            "fps",
            "bytes_written",
            "receive_buffer_bytes",
        )
        return {
            "rig": self._config.name,
            "pid": os.getpid(),
            "socket": str(self._config.daemon.socket_path()),
            "striker": self._control.striker.state.value,
            "stops": self._control.stops,
            "striker_trouble": self._control.trouble,
            "servo": asdict(health) if (health := self._control.striker.health) is not None else None,
            **{name: capture.get(name, 0) for name in numbers},
            "recording": str(capture["recording"]) if capture.get("recording") else None,
            "camera": {name: getattr(self._camera, name) for name in ("vendor", "model", "serial")},
            "connected": capture.get("connected", False),
            "trouble": capture["error"],
            "warnings": list(capture.get("warnings", ())),
            "watching": (watcher := self._recording.watcher) is not None and watcher.alive,
        }

    def _shutdown(self, *_: object) -> dict[str, Any]:
        self._stop_requested = True
        return {}
