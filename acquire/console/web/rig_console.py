"""Rig as the console shows and orders it: daemon, session, check, archive and live image together."""

from __future__ import annotations

import contextlib
import math
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from acquire.config import read_rig
from acquire.console.web import view
from acquire.console.web.archive import Archive
from acquire.console.web.backend import Viewer
from acquire.console.web.card_drawings import CardDrawings
from acquire.console.web.listing import Listing
from acquire.console.web.orders import Answer, ArchiveEntry, Curve, StartSession, StopDone
from acquire.console.web.preview import LiveImage
from acquire.console.web.programs import Analyses, CheckRun, Detached, start_daemon
from acquire.console.web.refusal import Refusal
from acquire.console.web.rig_link import RigLink
from acquire.console.web.snapshot import CheckLine, CheckView, DaemonView, Snapshot, StopView
from acquire.daemon.client import DaemonClient
from acquire.errors import AcquireError, DaemonSilent, SessionError

TICK_S: Final = 0.1
SLOW_S: Final = 2.0
"""interval between two looks at folders and disk [s]"""
BEGIN_S: Final = 60.0
"""longest wait for a started session to open its recording [s]"""
SETTLE_S: Final = 3.0
"""longest wait for a check that has ended to close the recording that it made [s]"""
END_S: Final = 20.0
"""longest wait for a stopped session to close its recording [s]"""
STOP_PATIENCE_S: Final = 2.0


class RigConsole:
    """Rig behind the console's routes (backend.py); any thread may call its methods.

    Args:
        rig_path: rig file.
        recordings: folder of the recordings.
        objects: folder of objects and plans.
        present: function that returns True while the operator's browser is connected.

    Raises:
        ConfigError: the rig file cannot be used.
    """

    def __init__(self, rig_path: Path, recordings: Path, objects: Path, present: Callable[[], bool]) -> None:
        self._rig_path, self._recordings = rig_path.resolve(), recordings.resolve()
        self._rig = read_rig(self._rig_path)
        self._listing = Listing(objects.resolve())
        self._analyses = Analyses()
        self._archive = Archive(self._recordings, self._analyses)
        self._cards = CardDrawings()
        self._link = RigLink(self._rig.daemon.socket_path(), present)
        self._live = LiveImage(self._link.preview)
        self._daemon: Detached | None = None
        self._session: Detached | None = None
        self._session_began_ns = 0
        self._aborting = False
        self._starting = threading.Lock()
        self._check: CheckRun | None = None
        self._check_view = CheckView(running=False, passed=None, lines=[])
        self._latency_ms: float | None = None
        self._stopped_while = ""
        self._free_bytes = 0
        self._moved_s = math.inf
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._look_after, name="console-look")
        self._thread.start()

    def close(self) -> None:
        """End all threads and programs but the daemon and the session, which the daemon then holds."""
        self._closed.set()
        self._analyses.close()
        if self._check is not None:
            self._check.close()
        self._thread.join()
        self._link.close()
        self._cards.close()

    # --- state ---

    def snapshot(self, viewer: Viewer) -> Snapshot:
        """State for one browser, without waiting for anything."""
        report = self._link.report
        status = report.status
        camera_trouble = [] if status is None else [status["trouble"], *status["warnings"]]
        refusal = "" if status is None else str(status["striker_trouble"])
        stopped = refusal == "stopped on request"
        return Snapshot(
            time_ns=time.time_ns(),
            role=viewer.role,
            operator_present=viewer.operator_present,
            watchers=viewer.watchers,
            daemon=self._daemon_view(status),
            check=self._check_view,
            camera=view.camera_view(report, self._rig, self._live.aids),
            striker=view.striker_view(report),
            disk=view.disk_view(self._free_bytes, self._rig),
            trouble=[text for text in (*camera_trouble, *report.trouble) if text],
            choices=self._listing.choices,
            session=view.session_view(report, self._ended_by()),
            prompt=view.prompt_view(report, time.monotonic() - self._moved_s),
            armed=view.armed_view(report),
            estimate=report.estimate,
            stop=StopView(
                stopped=stopped,
                text=refusal if stopped else "",
                latency_ms=self._latency_ms,
                was=self._stopped_while,
            ),
        )

    def _daemon_view(self, status: dict[str, Any] | None) -> DaemonView:
        socket = str(self._link.socket)
        if status is not None:
            return DaemonView(running=True, text=f"{status['rig']}, process {status['pid']}", socket=socket)
        text = "no daemon runs for this rig"
        if self._daemon is not None and not self._daemon.running and self._daemon.code != 0:
            text = f"the daemon ended: {self._daemon.complaint() or self._daemon.code}"
        return DaemonView(running=False, text=text, socket=socket)

    def _ended_by(self) -> str:
        """Reason why the session ended without a last report; empty if it runs, or reported its end."""
        report = self._link.report
        if report.session is None:
            return ""
        ours = self._session is not None and report.session["began_ns"] >= self._session_began_ns
        if ours and self._session is not None and not self._session.running:
            return self._session.complaint() or f"the session's program ended with {self._session.code}"
        if report.status is None:
            return "the daemon ended"
        return "the session's program ended" if report.status["recording"] is None and not ours else ""

    # --- orders ---

    def stop(self) -> StopDone:
        """Stop the striker.

        Raises:
            DaemonSilent: the daemon does not answer: the arm may move.
            DaemonNotRunning: no daemon runs.
        """
        began_s = time.perf_counter()
        try:
            with DaemonClient(self._link.socket, STOP_PATIENCE_S) as client:
                answer = client.call("striker.stop")
        except DaemonSilent as error:
            raise DaemonSilent(f"NOT STOPPED: if the arm moves, cut the motor's power: {error}") from None
        self._latency_ms = round(1e3 * (time.perf_counter() - began_s), 2)
        self._stopped_while = str(answer["was"])
        return StopDone(state=str(answer["state"]), was=self._stopped_while, latency_ms=self._latency_ms)

    def clear_stop(self) -> None:
        """Home the striker again after a stop, once the session that it ended has closed its recording.

        Raises:
            Refusal: that session is still ending.
        """
        if not self._is_free(END_S):
            raise Refusal(409, "SessionOpen", "the session is still ending", "wait for its end, then home")
        status = self._link.call("status")
        self._link.call("striker.home", stops_seen=status["stops"])

    def start_daemon(self) -> None:
        """Start the daemon in a process of its own; return when it listens or has failed.

        A check that runs holds camera and servo: it is ended, and begun again through the daemon.
        """
        with self._one_start():
            if self._link.running:
                raise Refusal(409, "Running", "the daemon runs already")
            checking = self._check_view.running
            if checking and self._check is not None:
                self._check.close()
                self._check_view = CheckView(running=False, passed=None, lines=[])
            self._daemon = start_daemon(self._rig_path, self._link.socket)
            _wait(lambda: self._link.running, 5.0)
            if checking:
                self._begin_check()

    def start_check(self) -> None:
        """Start the preflight check; its lines appear in the snapshot."""
        with self._one_start():
            if self._check_view.running:
                raise Refusal(409, "Running", "the check runs already")
            self._begin_check()

    def start_session(self, order: StartSession) -> None:
        """Start a session in a process of its own; return when its recording is open.

        Raises:
            Refusal: no daemon runs, a session is open, the check did not pass and no reason to start all the
                same is given, or the name is taken.
            AcquireError: the session's program ended; the message is what it printed.
        """
        with self._one_start():
            if self._link.report.status is None:
                raise Refusal(409, "NoDaemon", "no daemon runs", "start the daemon first")
            if not self._is_free(SETTLE_S):
                raise Refusal(409, "SessionOpen", "a session is open", "wait for its end, or end it")
            note = self._note(order)
            thing, plan, name = self._listing.paths(order.object_id, order.plan_id)
            path = self._archive.new_path(order.name, name)
            arguments = ["acquire", "session", str(thing), str(plan), "-o", str(path)]
            arguments += ["--rig", str(self._rig_path), "--prompts", "others"]
            earlier = self._archive.all_before(order.resume)
            self._archive.note_earlier(path, earlier)
            options = [*order.options().items(), ("--note", note), *(("--resume", each) for each in earlier)]
            arguments += [text for name, value in options if value for text in (name, str(value))]
            self._aborting, self._session_began_ns = False, time.time_ns()
            self._cards.draw(thing, plan)
            log = self._link.socket.with_name(f"{self._link.socket.name}.session.log")
            self._session = session = Detached(arguments, log)
            self._link.attend()
            _wait(lambda: self._session_began() or not session.running, BEGIN_S)
            if not self._session_began():
                self._link.attending = False
                if session.running:
                    session.end()
                    raise SessionError(
                        f"the session did not open its recording within {BEGIN_S:g} s and was ended: see "
                        "whether this computer is busy, then start it again"
                    )
                raise AcquireError(session.complaint() or f"the session ended with {session.code}")

    def pause(self, when: str) -> None:
        """Hold the session before its next arming."""
        self._require_session()
        self._link.attend()
        self._link.call("hold", when=when, text="paused by the operator")

    def resume(self) -> None:
        """Release a hold; this console attends the session from now on."""
        self._require_session()
        self._link.attend()
        end_s = time.monotonic() + 2.0
        while True:
            try:
                self._link.call("hold.release")
            except SessionError:
                if time.monotonic() > end_s:
                    raise
                time.sleep(TICK_S)  # until the daemon knows that the operator's browser is back
            else:
                return

    def abort(self) -> None:
        """Stop the striker and end the session; its recording is kept."""
        self._require_session()
        self._aborting = True
        self.stop()

    def answer(self, answer: Answer) -> None:
        """Answer a prompt; this console attends the session from now on."""
        self._link.attend()
        text = "" if answer.ok else "ended by the operator"
        self._link.call("prompt.answer", prompt_id=answer.id, ok=answer.ok, text=text, order=answer.order)

    # --- drawings, curves, archive ---

    def card(self, strike_id: str) -> bytes:
        """Drawing (SVG) of a strike's placement card."""
        return self._cards.card(strike_id)

    def curve(self, strike_id: str) -> Curve:
        """Curve of a strike of the session."""
        found = self._link.call("session.curve", strike_id=strike_id)
        strikes = (self._link.report.session or {"strikes": []})["strikes"]
        phi = next((each["phi_rad"] for each in strikes if each["id"] == strike_id), None)
        window = found["fit_time_s"] or found["time_s"]
        return Curve(
            time_s=found["time_s"],
            theta_deg=[round(math.degrees(each), 4) for each in found["theta_rad"]],
            fit_time_s=found["fit_time_s"],
            fit_deg=[round(math.degrees(each), 4) for each in found["fit_rad"]],
            phi_deg=None if phi is None else round(math.degrees(phi), 4),
            window_s=[window[0], window[-1]] if window else [],
        )

    def preview(self) -> tuple[int, bytes] | None:
        """Number and JPEG bytes of the newest preview image; None if there is none."""
        return self._live.jpeg()

    def archive(self) -> list[ArchiveEntry]:
        """Recordings in the folder of recordings."""
        return self._archive.entries()

    def estimate(self, recording_id: str) -> dict[str, Any]:
        """Estimate a recording (again), and return the result document."""
        return self._archive.estimate(recording_id)

    def report(self, recording_id: str) -> Path:
        """Path of the recording's report (HTML), made if none is kept."""
        return self._archive.report(recording_id)

    def recording(self, recording_id: str) -> Path:
        """Path of a recording."""
        return self._archive.finished(recording_id)

    # --- behind the orders ---

    @contextlib.contextmanager
    def _one_start(self) -> Any:
        """Refuse a second start while one is carried out.

        Raises:
            Refusal: another start is being carried out.
        """
        if not self._starting.acquire(blocking=False):
            raise Refusal(409, "Busy", "another start is being carried out", "wait for its end")
        try:
            yield
        finally:
            self._starting.release()

    def _is_free(self, timeout_s: float) -> bool:
        """True once no recording is open at the daemon; False if one still is after a time [s]."""
        return _wait(lambda: self._link.call("status")["recording"] is None, timeout_s)

    def _begin_check(self) -> None:
        if self._check is not None:
            self._check.close()
        self._check_view = CheckView(running=True, passed=None, lines=[])
        self._check = CheckRun(self._rig_path, self._add_check, self._end_check)

    def _require_session(self) -> None:
        status = self._link.report.status
        if status is None or status["recording"] is None:
            raise Refusal(409, "NoSession", "no session is open")

    def _session_began(self) -> bool:
        session = self._link.report.session
        return session is not None and session["began_ns"] >= self._session_began_ns

    def _note(self, order: StartSession) -> str:
        """Note for the recording about a session that starts although the check did not pass.

        Raises:
            Refusal: it did not pass, and no reason is given.
        """
        check = self._check_view
        if check.passed:
            return ""
        failed = [f"{line.name}: {line.text}" for line in check.lines if line.outcome == "fail"]
        found = "; ".join(failed) or "it was not run"
        if not order.override.strip():
            remedy = "run the check, or state why the session starts all the same"
            raise Refusal(409, "CheckNotPassed", f"the check did not pass: {found}", remedy)
        return f"started by the operator although the check did not pass ({found}): {order.override.strip()}"

    def _add_check(self, line: dict[str, Any]) -> None:
        lines = [*self._check_view.lines, view.check_line(line)]
        self._check_view = CheckView(running=True, passed=None, lines=lines)

    def _end_check(self, passed: bool | None) -> None:
        lines = self._check_view.lines
        if passed is None:
            text = "the check's program failed"
            remedy = f"run `acquire check {self._rig_path}` in a terminal"
            lines = [*lines, CheckLine(name="check", outcome="fail", text=text, remedy=remedy)]
        self._check_view = CheckView(running=False, passed=bool(passed), lines=lines)

    def _look_after(self) -> None:
        """Thread: look at folders and disk, end a session that is aborted, note when something moves."""
        again_s = 0.0
        while not self._closed.wait(TICK_S):
            report = self._link.report
            if report.watch is None or not view.is_still(report.watch):
                self._moved_s = time.monotonic()
            prompt = report.prompt
            if self._aborting and prompt is not None:
                with contextlib.suppress(AcquireError):
                    self._link.call("prompt.answer", prompt_id=prompt["prompt_id"], ok=False, text="ended")
                    self._aborting = False
            if time.monotonic() > again_s:
                again_s = time.monotonic() + SLOW_S
                with contextlib.suppress(OSError):
                    self._listing.refresh()
                folder = self._recordings if self._recordings.is_dir() else self._recordings.parent
                with contextlib.suppress(OSError):
                    self._free_bytes = shutil.disk_usage(folder).free


def _wait(done: Callable[[], bool], timeout_s: float) -> bool:
    """True once `done` does; False if it did not within a time [s]."""
    end_s = time.monotonic() + timeout_s
    while not (found := done()) and time.monotonic() < end_s:
        time.sleep(0.05)
    return found
