"""Server of the daemon's local API: JSON lines over a unix socket that only its user can open.

    request  {"id": 1, "method": "striker.arm", "params": {}}
    answer   {"id": 1, "result": {...}}
    error    {"id": 1, "error": {"kind": "StrikerRefused", "message": "..."}}
    busy     {"id": 1, "busy_s": 3.0}

While a slow answer is in preparation, the daemon sends `busy` once a second. A client that receives neither
`busy` nor an answer concludes that the daemon hangs. After the request `subscribe` the connection carries
events only: {"event": "prompt", ...}.

The socket has mode 0600 in a folder of mode 0700 that belongs to the user, and the peer's user id is checked:
another user is refused by both. The client checks the daemon's user in the same way.

Whatever other programs of the user do, `striker.stop` is answered: connections that send nothing cost no
thread (door.py), and beyond `MAX_CLIENTS` `RESERVE` threads answer urgent requests alone, one per connection.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from acquire.daemon.connection import Connection
from acquire.daemon.door import Caller, Door, hang_up
from acquire.daemon.private_socket import listen_privately
from acquire.daemon.request_reader import RequestReader
from acquire.errors import AcquireError, DaemonError

MAX_CLIENTS, RESERVE = 64, 8
"""clients that are served at once, and threads beyond them for urgent requests"""
MAX_URGENT = 256
"""urgent requests that may wait for one of those threads"""
IDLE_S = 3600.0
"""time after which a client without a request is sent away [s]; not one that listens or has a session open"""
YIELD_S = 10.0
"""time without a request after which a client gives its place to another, if there is none left [s]"""
BUSY_S = 1.0
"""interval between the busy reports of a request in progress [s]"""
_ROUND_S, _LATE_S = 1.0, 5.0
"""longest pause between two looks at the door, and time without a look after which it counts as stuck [s]"""
_PAUSE_S = 0.05
"""pause after a connection could not be taken [s]"""

_ALL_TAKEN = (
    f"{MAX_CLIENTS} programs are connected to the daemon, as many as it serves at once: end those that are "
    "not needed (`fuser -v SOCKET` lists them), and try again"
)

Handler = Callable[[Connection, dict[str, Any]], object]


class ApiServer:
    """Server of the daemon's local API, with a thread per client that runs its requests in order.

    Therefore the request `striker.stop` never waits for the `striker.strike` of another client.

    Args:
        path: path of the unix socket.
        handlers: function that carries out each request, by the request's method; it gets the connection and
            the parameters, and returns the result.
        served_uid: id of the user whose processes are served; None: the user of this process.
        urgent: methods that are carried out even when all places are taken.
        complain: called with a line for the user when connections cannot be taken, at most once a minute.
        greet: called with every connection that has just subscribed to events.

    Raises:
        DaemonBusy: a daemon listens at `path` already.
        DaemonError: the socket cannot be made, or its folder is open to others.
    """

    def __init__(
        self,
        path: Path,
        handlers: Mapping[str, Handler],
        served_uid: int | None = None,
        urgent: Collection[str] = (),
        complain: Callable[[str], None] = lambda _: None,
        greet: Callable[[Connection], None] = lambda _: None,
    ) -> None:
        self._path = path
        self._handlers = handlers
        self._urgent, self._complain, self._greet = frozenset(urgent), complain, greet
        self._clients: dict[Connection, threading.Thread] = {}
        self._reserve = ThreadPoolExecutor(RESERVE, thread_name_prefix="api-urgent")
        self._urgent_connections: set[Connection] = set()
        self._lock = threading.Lock()
        self._large = threading.Lock()
        self._closing = False
        self._looked_s = time.monotonic()
        self._complain_again_s = 0.0
        served = os.getuid() if served_uid is None else served_uid
        self._door = Door(listen_privately(path), served, str(path))
        self._closed = threading.Event()
        self._acceptor = threading.Thread(target=self._accept, name="api-accept")
        self._acceptor.start()
        self._busy_reporter = threading.Thread(target=self._report_busy, name="api-busy")
        self._busy_reporter.start()

    @property
    def accepting(self) -> bool:
        """True while new clients are taken; the daemon reports itself alive only then."""
        return self._acceptor.is_alive() and time.monotonic() - self._looked_s < _LATE_S

    def publish(self, event: str, data: Mapping[str, Any]) -> None:
        """Queue an event for every client that subscribed to events, without waiting.

        Args:
            event: name of the event.
            data: further members of the event's JSON object.
        """
        for connection in self._connections():
            connection.publish({"event": event, **data})

    def close(self) -> None:
        """Stop listening, drop the clients, wait for their threads, and remove the socket."""
        self._closing = True
        self._door.wake()
        self._acceptor.join()
        self._door.close()
        with self._lock:
            threads = list(self._clients.values())
        for connection in self._connections():
            connection.close()
        on_reserve = threading.current_thread().name.startswith("api-urgent")
        self._reserve.shutdown(wait=not on_reserve, cancel_futures=True)
        for thread in threads:
            if thread is not threading.current_thread():
                thread.join()
        self._closed.set()
        self._busy_reporter.join()
        self._path.unlink(missing_ok=True)

    def _connections(self) -> list[Connection]:
        with self._lock:
            return [*self._clients, *self._urgent_connections]

    # --- the acceptor's thread

    def _accept(self) -> None:
        while not self._closing:
            self._looked_s = time.monotonic()
            try:
                for caller in self._door.speaking(_ROUND_S):
                    self._admit(caller)
            except Exception as error:
                # Whatever it is, the next client may want to stop the arm.
                self._note_trouble(error)
                self._closed.wait(_PAUSE_S)

    def _note_trouble(self, error: Exception) -> None:
        """Report that a connection could not be taken, at most once a minute."""
        if (now_s := time.monotonic()) < self._complain_again_s:
            return
        self._complain_again_s = now_s + 60.0
        reason = error.strerror if isinstance(error, OSError) else f"{type(error).__name__}: {error}"
        with contextlib.suppress(Exception):
            self._complain(f"a program could not connect to the daemon ({reason}); others are still taken")

    def _admit(self, caller: Caller) -> None:
        """Serve a client in a thread of its own, or send it away, if all places are taken.

        Raises:
            OSError, RuntimeError: the socket is broken, or no thread can be started; the client is sent away.
        """
        try:
            connection = Connection(caller.sock)
            with self._lock:
                if len(self._clients) < MAX_CLIENTS:
                    arguments = (connection, caller)
                    thread = threading.Thread(target=self._serve, args=arguments, name="api-client")
                    self._clients[connection] = thread
                    try:
                        thread.start()
                    except RuntimeError:
                        del self._clients[connection]
                        raise
                    return
            self._admit_urgent(connection, caller)
        except (OSError, RuntimeError):
            hang_up(caller.sock, "the daemon cannot serve another program now: try again", "DaemonBusy")
            raise

    def _admit_urgent(self, connection: Connection, caller: Caller) -> None:
        """Let a client's request be carried out if it is urgent, and one that is idle give up its place."""
        request_id, method = _first_request(caller)
        with self._lock:
            idlest = max(self._clients, key=lambda each: each.idle_s)
            if idlest.idle_s > YIELD_S:
                idlest.close()
            urgent = method in self._urgent and len(self._urgent_connections) < MAX_URGENT
            if urgent:
                self._urgent_connections.add(connection)
        if urgent:
            self._reserve.submit(self._serve, connection, caller, urgent_only=True)
        else:
            hang_up(caller.sock, _ALL_TAKEN, "DaemonBusy", request_id)

    def _report_busy(self) -> None:
        while not self._closed.wait(BUSY_S):
            for connection in self._connections():
                connection.report_busy()

    # --- a client's thread

    def _serve(self, connection: Connection, caller: Caller, *, urgent_only: bool = False) -> None:
        try:
            with caller.sock:
                reader = RequestReader(caller.sock, self._large, caller.sent)
                while self._answer_request(connection, reader) and not urgent_only:
                    pass
        except OSError:
            pass  # the client went away; `on_close` completes or undoes its requests
        finally:
            for callback in connection.on_close:
                callback()
            with self._lock:
                self._clients.pop(connection, None)
                self._urgent_connections.discard(connection)

    def _answer_request(self, connection: Connection, reader: RequestReader) -> bool:
        """Answer a client's next request; False if it was the last.

        Raises:
            OSError: the client has hung up.
        """
        try:
            line = reader.next_line(None if connection.on_close else IDLE_S)
        except DaemonError as error:
            connection.send({"id": None, **_error("DaemonError", str(error))})
            return False
        if line is None:
            return False
        request_id, answer = self._answer(connection, line)
        try:
            connection.send({"id": request_id, **answer})
        except (ValueError, TypeError) as error:
            text = f"the answer cannot be sent as JSON: {error}"
            connection.send({"id": request_id, **_error("DaemonError", text)})
        if connection.subscribed:
            connection.send_events()
            return False
        return True

    def _answer(self, connection: Connection, line: bytes) -> tuple[object, dict[str, Any]]:
        """Carry out the request in `line`, a line of JSON.

        An error of the request is not raised: it is the answer.

        Returns:
            Id of the request, None if the line holds no valid one; and the answer, a JSON object with
            `result` or `error`.
        """
        request_id: object = None
        try:
            request = json.loads(line)
            if not isinstance(request, dict):
                raise DaemonError(f"a request is a JSON object, not {type(request).__name__}")
            given_id = request.get("id")
            request_id = given_id if isinstance(given_id, int | str) else None
            method, params = request["method"], request.get("params", {})
            if method == "subscribe":
                connection.subscribe()
                self._greet(connection)
                return request_id, {"result": {}}
            handler = self._handlers.get(method)
            if handler is None:
                known = ", ".join(sorted(self._handlers))
                return request_id, _error("DaemonError", f"unknown method {method!r}; known: {known}")
            with connection.in_progress(request_id):
                return request_id, {"result": handler(connection, params)}
        except AcquireError as error:
            return request_id, _error(type(error).__name__, str(error))
        except Exception as error:
            # Every request is answered, whatever its error, and the connection stays open.
            return request_id, _error(
                "DaemonError", f"request not understood: {type(error).__name__}: {error}"
            )


def _first_request(caller: Caller) -> tuple[object, object]:
    """Id and method of a client's first request; None where it has none, or is not read to its end."""
    line, _, _ = bytes(caller.sent).partition(b"\n")
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        return None, None
    return (request.get("id"), request.get("method")) if isinstance(request, dict) else (None, None)


def _error(kind: str, message: str) -> dict[str, Any]:
    return {"error": {"kind": kind, "message": message}}
