"""Client of a running console for scripts and notebooks: the same orders and states as in the browser."""

from __future__ import annotations

import contextlib
import http.client
import json
import secrets
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import TypeAdapter, ValidationError

from acquire.console.web.command import key_path
from acquire.console.web.orders import (
    Answer,
    ArchiveEntry,
    ClearStop,
    Curve,
    ErrorAnswer,
    NoBody,
    Order,
    PauseSession,
    StartSession,
    StopDone,
)
from acquire.console.web.snapshot import Snapshot
from acquire.errors import DaemonError, DaemonNotRunning
from schemas.document import Document

TIMEOUT_S = 120.0
"""longest wait for an answer [s]: a daemon that starts, or a report that is made, takes its time"""

D = TypeVar("D", bound=Document)


class ConsoleRefused(DaemonError):
    """The console refused a request; the message holds the remedy."""


class ConsoleClient:
    """Client of the console of a rig, with the rights of a watcher until `take_over`.

    As a context manager it closes itself. While it is the operator it listens to the console's events in a
    thread: if the script ends without `close`, the session pauses before its next arming.

    Args:
        socket: path of the daemon's socket, beside which the console keeps address and key.

    Raises:
        DaemonNotRunning: no console runs for this rig.
    """

    def __init__(self, socket: Path) -> None:
        path = key_path(socket)
        try:
            given = json.loads(path.read_text(encoding="utf-8"))
            self._host = str(given["url"]).removeprefix("http://")
            self._credential = f"{given['key']}.{secrets.token_hex(8)}"
        except (OSError, ValueError, KeyError, TypeError):
            raise DaemonNotRunning(
                f"no console runs for the socket {socket}: start one with `acquire console RIG.toml`"
            ) from None
        self._presence: http.client.HTTPConnection | None = None
        self._thread: threading.Thread | None = None

    def state(self) -> Snapshot:
        """State of the rig, the session and the console."""
        return self._read("/api/state", Snapshot)

    def events(self) -> Iterator[Snapshot]:
        """Yield the state, and again whenever it changes, until the console ends."""
        connection = self._connected()
        with contextlib.closing(connection):
            yield from self._states(connection)

    def take_over(self) -> None:
        """Become the operator, in place of a browser or another script, until `close`."""
        if self._presence is None:
            self._presence = self._connected()
            self._presence.timeout = None
            self._thread = threading.Thread(target=self._be_present, name="console-presence", daemon=True)
            self._thread.start()
        self._order("/api/operator/take", NoBody())

    def stop(self) -> StopDone:
        """Stop the striker; watchers may do it too."""
        return StopDone.model_validate(self._order("/api/stop", NoBody()))

    def clear_stop(self) -> None:
        """Home the striker again after a stop: be sure that the arm is free."""
        self._order("/api/stop/clear", ClearStop(confirm=True))

    def start_daemon(self) -> None:
        """Start the rig's daemon; return when it runs."""
        self._order("/api/daemon/start", NoBody())

    def check(self) -> None:
        """Start the preflight check; its lines appear in `state().check`."""
        self._order("/api/check", NoBody())

    def start_session(self, order: StartSession) -> None:
        """Start a session; the ids of object and plan are in `state().choices`."""
        self._order("/api/session/start", order)

    def pause(self, when: Literal["now", "after_strike"] = "now") -> None:
        """Pause the session before its next arming, or after the present strike."""
        self._order("/api/session/pause", PauseSession(when=when))

    def resume(self) -> None:
        """Go on after a pause."""
        self._order("/api/session/resume", NoBody())

    def abort(self) -> None:
        """Stop the striker and end the session; its recording is kept."""
        self._order("/api/session/abort", NoBody())

    def answer(self, prompt_id: int, *, ok: bool = True, order: Order = "placed") -> None:
        """Answer the prompt of `state().prompt`."""
        self._order("/api/prompt/answer", Answer(id=prompt_id, ok=ok, order=order))

    def curve(self, strike_id: str) -> Curve:
        """Tipping angle over time of a strike of the session."""
        return self._read(f"/api/strikes/{strike_id}/curve", Curve)

    def preview(self) -> bytes:
        """Newest live image (JPEG)."""
        return self._answered("GET", "/api/preview.jpg")

    def archive(self) -> list[ArchiveEntry]:
        """Recordings in the console's folder."""
        return TypeAdapter(list[ArchiveEntry]).validate_json(self._answered("GET", "/api/archive"))

    def estimate(self, recording_id: str) -> dict[str, Any]:
        """Estimate a recording, and return the result document."""
        return self._order(f"/api/archive/{recording_id}/estimate", NoBody())

    def close(self) -> None:
        """End the presence of this script as operator."""
        presence, self._presence = self._presence, None
        if presence is None:
            return
        if presence.sock is not None:
            with contextlib.suppress(OSError):  # it has ended already
                # Closing alone waits for the thread that reads from it.
                presence.sock.shutdown(socket.SHUT_RDWR)
        presence.close()

    def __enter__(self) -> ConsoleClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _be_present(self) -> None:
        connection = self._presence
        if connection is not None:
            with contextlib.suppress(OSError, ValueError, http.client.HTTPException, AttributeError):
                for _ in self._states(connection):
                    pass

    def _states(self, connection: http.client.HTTPConnection) -> Iterator[Snapshot]:
        connection.request("GET", "/api/events", headers=self._headers())
        # An answer that ends with its connection owns the socket.
        with contextlib.closing(connection.getresponse()) as answer:
            if answer.status != 200:
                raise _refused(answer.read())
            for line in answer:
                if line.startswith(b"data: "):
                    yield Snapshot.model_validate_json(line.removeprefix(b"data: "))

    def _read(self, path: str, model: type[D]) -> D:
        return model.model_validate_json(self._answered("GET", path))

    def _order(self, path: str, body: Document) -> dict[str, Any]:
        return json.loads(self._answered("POST", path, body.model_dump_json()))

    def _answered(self, method: str, path: str, body: str | None = None) -> bytes:
        connection = self._connected()
        with contextlib.closing(connection):
            try:
                connection.request(method, path, body, self._headers())
                answer = connection.getresponse()
                data = answer.read()
            except (OSError, http.client.HTTPException):
                raise DaemonNotRunning(
                    f"the console at {self._host} does not answer: start it again"
                ) from None
        if answer.status != 200:
            raise _refused(data)
        return data

    def _connected(self) -> http.client.HTTPConnection:
        return http.client.HTTPConnection(self._host, timeout=TIMEOUT_S)

    def _headers(self) -> dict[str, str]:
        return {
            "Authorization": f"Bearer {self._credential}",
            "Origin": f"http://{self._host}",
            "X-Percuss": "1",
            "Content-Type": "application/json",
        }


def _refused(data: bytes) -> ConsoleRefused:
    try:
        problem = ErrorAnswer.model_validate_json(data).error
    except ValidationError:
        return ConsoleRefused("the console's answer is not understood")
    return ConsoleRefused(f"{problem.message}: {problem.remedy}" if problem.remedy else problem.message)
