"""Link to the daemon: what it reports, kept up to date by two threads, and the console's attendance.

One thread listens to the daemon's events. The other asks for its status twice a second, and states that the
console attends (acquire/daemon/attendance.py).
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from acquire.capture.preview_slot import PreviewImage, PreviewReader
from acquire.daemon.client import DaemonClient
from acquire.daemon.operator_client import OperatorClient
from acquire.errors import AcquireError

POLL_S: Final = 0.5
"""interval between two requests for the daemon's status [s]"""
MAX_TROUBLE: Final = 20
"""problems that are kept"""
TROUBLE_S: Final = 60.0
"""time for which a reported problem is shown [s]: those that last are in the daemon's status or come again"""
WATCH_S: Final = 2.0
"""age from which an observation of `analyze watch` is no longer shown [s]"""


@dataclass
class RigReport:
    """Last report of the daemon; all fields are empty while none runs."""

    status: dict[str, Any] | None = None
    """answer to `status`"""
    hold: dict[str, Any] = field(default_factory=dict)
    """answer to `hold.status`"""
    session: dict[str, Any] | None = None
    """SessionStatus, as JSON"""
    curves: frozenset[str] = frozenset()
    """attempts with a curve"""
    prompt: dict[str, Any] | None = None
    """open question"""
    watch: dict[str, Any] | None = None
    """newest WatchEvent, as JSON"""
    watch_s: float = 0.0
    """monotonic time at which it came [s]"""
    estimate: dict[str, Any] | None = None
    """newest estimate of `analyze watch`, as JSON"""
    problems: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=MAX_TROUBLE))
    """problems reported, the newest last, each with its monotonic time [s]"""

    @property
    def trouble(self) -> list[str]:
        """Problems of the last TROUBLE_S, the newest last."""
        since_s = time.monotonic() - TROUBLE_S
        return [text for time_s, text in self.problems if time_s > since_s]


class RigLink:
    """Link to the daemon that listens on a socket, while there is one; any thread may call its methods.

    Args:
        socket: path of the daemon's socket.
        present: function that returns True while the operator's browser is connected.
    """

    def __init__(self, socket: Path, present: Callable[[], bool]) -> None:
        self.socket = socket
        self._present = present
        self.report = RigReport()
        self.attending = False
        """True while the console attends a session: the daemon holds the session if the console is lost"""
        self._closed = threading.Event()
        self._listener: OperatorClient | None = None
        self._preview_lock = threading.Lock()
        self._preview: PreviewReader | None = None
        self._preview_again_s = 0.0
        self._attention = threading.Event()
        self._threads = [
            threading.Thread(target=self._listen, name="console-events"),
            threading.Thread(target=self._poll, name="console-status"),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def running(self) -> bool:
        """True while a daemon answers."""
        return self.report.status is not None

    def call(self, method: str, patience_s: float = 6.0, **params: Any) -> Any:
        """Make one request on a connection of its own.

        Raises:
            AcquireError: no daemon answers, or it refuses.
        """
        with DaemonClient(self.socket, patience_s) as client:
            return client.call(method, **params)

    def attend(self) -> None:
        """Attend from now on: the session is held if this console or the operator's browser is lost."""
        self.attending = True
        self._attention.set()

    def preview(self) -> PreviewImage | None:
        """Newest image of the camera; None if there is none."""
        with self._preview_lock:
            if not self.running:
                self._preview = None
                return None
            if self._preview is None:
                self._preview = PreviewReader(self.call("preview"))
                self._preview_again_s = time.monotonic() + 3.0
            image = self._preview.newest()
            if image is None and time.monotonic() > self._preview_again_s:
                self._preview = None  # another daemon may run by now
            return image

    def close(self) -> None:
        """End both threads; a session that this console attends is then held by the daemon."""
        self._closed.set()
        self._attention.set()
        if (listener := self._listener) is not None:
            listener.close()
        for thread in self._threads:
            thread.join()

    # --- events ---

    def _listen(self) -> None:
        while not self._closed.is_set():
            try:
                self._listener = OperatorClient(self.socket)
                if self._closed.is_set():
                    self._listener.close()
                    return
                with DaemonClient(self.socket) as client:
                    answer = client.call("session.status")
                    self.report.session = answer["session"]
                    self.report.curves = frozenset(answer["curves"])
                    self.report.hold = client.call("hold.status")
                    self.report.estimate = client.call("watch.latest")["estimate"]
                for event in self._listener.events():
                    self._take(event)
            except AcquireError:
                pass
            self.report.prompt = self.report.watch = None
            self._closed.wait(POLL_S)

    def _take(self, event: dict[str, Any]) -> None:
        report = self.report
        match event.get("event"):
            case "prompt":
                report.prompt = event
            case "answered":
                if report.prompt is not None and report.prompt["prompt_id"] == event["prompt_id"]:
                    report.prompt = None
            case "hold":
                report.hold = {name: event.get(name) for name in ("held", "text", "later")}
            case "session":
                self._take_session(event["session"])
            case "watch":
                report.watch = {name: value for name, value in event.items() if name != "event"}
                report.watch_s = time.monotonic()
            case "estimate":
                report.estimate = {name: value for name, value in event.items() if name != "event"}
            case "trouble":
                report.problems.append((time.monotonic(), str(event["text"])))
            case _:
                pass

    def _take_session(self, session: dict[str, Any]) -> None:
        before = self.report.session
        if before is None or before["began_ns"] != session["began_ns"]:
            self.report.estimate = None
            self.report.curves = frozenset()
            self.report.problems.clear()
        if before is None or len(before["strikes"]) != len(session["strikes"]):
            with contextlib.suppress(AcquireError):
                self.report.curves = frozenset(self.call("session.status")["curves"])
        self.report.session = session
        if session["state"] in {"finished", "aborted"}:
            self.attending = False

    # --- status and attendance ---

    def _poll(self) -> None:
        client: DaemonClient | None = None
        attended = False
        while not self._closed.is_set():
            try:
                if client is None:
                    client, attended = DaemonClient(self.socket), False
                self.report.status = client.call("status")
                if self.attending:
                    client.call("attend", present=self._present())
                    attended = True
                elif attended:
                    client.call("attend.leave")
                    attended = False
            except AcquireError:
                self.report.status = None
                if client is not None:
                    client.close()
                client = None
            self._attention.wait(POLL_S)
            self._attention.clear()
        if client is not None:
            client.close()
