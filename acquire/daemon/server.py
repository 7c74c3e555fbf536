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
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import socket
import stat
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from acquire.daemon.client import DaemonClient
from acquire.daemon.peer import read_peer
from acquire.errors import AcquireError, DaemonBusy, DaemonError, DaemonNotRunning

MAX_LINE_BYTES = 64 << 20
"""greatest size of a request [bytes], which carries at most one shape file"""
BUSY_S = 1.0
"""interval between the busy reports of a request in progress [s]"""

Handler = Callable[["Connection", dict[str, Any]], object]


class Connection:
    """Connection of one client to the daemon; its `on_close` callbacks run when it ends, however it ends.

    Args:
        sock: connected socket.
    """

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self._send_lock = threading.Lock()
        self.on_close: list[Callable[[], None]] = []
        self.events: queue.SimpleQueue[dict[str, Any] | None] | None = None
        """events to send; None before the client subscribes"""
        self._in_progress: tuple[object, float] | None = None
        """id of the request in progress, and its start (monotonic) [s]"""

    @property
    def gone(self) -> bool:
        """True if the client has hung up; requests that wait for something check it."""
        try:
            return self._socket.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True

    def send(self, message: Mapping[str, Any]) -> None:
        """Send the client one message as a line of JSON; waits while the client does not read.

        Raises:
            OSError: the client has hung up.
            ValueError, TypeError: `message` holds something that JSON cannot.
        """
        data = json.dumps(message, allow_nan=False).encode() + b"\n"
        with self._send_lock:
            self._socket.sendall(data)

    @contextlib.contextmanager
    def in_progress(self, request_id: object) -> Iterator[None]:
        """Context manager; while it is open, `report_busy` reports `request_id` as in progress."""
        self._in_progress = (request_id, time.monotonic())
        try:
            yield
        finally:
            with self._send_lock:  # no busy report after the answer
                self._in_progress = None

    def report_busy(self) -> None:
        """Send the client a "busy" line: id of the request in progress, and time since it began [s].

        Nothing is sent if no request is in progress, an answer is being sent, or the client does not read.
        """
        if not self._send_lock.acquire(blocking=False):
            return
        try:
            if self._in_progress is not None:
                request_id, since = self._in_progress
                report = {"id": request_id, "busy_s": round(time.monotonic() - since, 1)}
                with contextlib.suppress(OSError):  # a unix socket takes a short line whole or not at all
                    self._socket.send(json.dumps(report).encode() + b"\n", socket.MSG_DONTWAIT)
        finally:
            self._send_lock.release()

    def close(self) -> None:
        """Shut the socket down in both directions; the server's thread for this client then ends."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        if self.events is not None:
            self.events.put(None)


class ApiServer:
    """Server of the daemon's local API, with a thread per client that runs its requests in order.

    Therefore the request `striker.stop` never waits for the `striker.strike` of another client.

    Args:
        path: path of the unix socket.
        handlers: function that carries out each request, by the request's method; it gets the connection and
            the parameters, and returns the result.
        served_uid: id of the user whose processes are served; None: the user of this process.

    Raises:
        DaemonBusy: a daemon listens at `path` already.
        DaemonError: the socket cannot be made, or its folder is open to others.
    """

    def __init__(self, path: Path, handlers: Mapping[str, Handler], served_uid: int | None = None) -> None:
        self._path = path
        self._handlers = handlers
        self._served_uid = os.getuid() if served_uid is None else served_uid
        self._connections: set[Connection] = set()
        self._threads: set[threading.Thread] = set()
        self._lock = threading.Lock()
        self._closing = False
        self._socket = _listen(path)
        self._closed = threading.Event()
        self._acceptor = threading.Thread(target=self._accept, name="api-accept")
        self._acceptor.start()
        self._busy_reporter = threading.Thread(target=self._report_busy, name="api-busy")
        self._busy_reporter.start()

    def publish(self, event: str, data: Mapping[str, Any]) -> None:
        """Queue an event for every client that subscribed to events, without waiting; queues are unbounded.

        Args:
            event: name of the event.
            data: further members of the event's JSON object.
        """
        with self._lock:
            subscribers = [c.events for c in self._connections if c.events is not None]
        for subscriber in subscribers:
            subscriber.put({"event": event, **data})

    def close(self) -> None:
        """Stop listening, drop the clients, wait for their threads, and remove the socket."""
        self._closing = True
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._acceptor.join()
        with self._lock:
            connections, threads = list(self._connections), list(self._threads)
        for connection in connections:
            connection.close()
        for thread in threads:
            if thread is not threading.current_thread():
                thread.join()
        self._closed.set()
        self._busy_reporter.join()
        self._path.unlink(missing_ok=True)

    def _accept(self) -> None:
        while not self._closing:
            try:
                sock, _ = self._socket.accept()
            except OSError:
                return
            if (uid := read_peer(sock).uid) != self._served_uid:
                with sock, contextlib.suppress(OSError):
                    text = f"{self._path}: the daemon serves only user {self._served_uid}, not user {uid}"
                    refusal = {"id": None, **_error("DaemonError", text)}
                    sock.send(json.dumps(refusal).encode() + b"\n", socket.MSG_DONTWAIT)
                continue
            connection = Connection(sock)
            thread = threading.Thread(target=self._serve, args=(connection, sock), name="api-client")
            with self._lock:
                self._connections.add(connection)
                self._threads.add(thread)
            thread.start()

    def _report_busy(self) -> None:
        while not self._closed.wait(BUSY_S):
            with self._lock:
                connections = list(self._connections)
            for connection in connections:
                connection.report_busy()

    def _serve(self, connection: Connection, sock: socket.socket) -> None:
        try:
            with sock, sock.makefile("rb") as stream:
                self._answer_requests(connection, stream)
        except OSError:
            pass  # the client went away; `on_close` completes or undoes its requests
        finally:
            for callback in connection.on_close:
                callback()
            with self._lock:
                self._connections.discard(connection)
                self._threads.discard(threading.current_thread())

    def _answer_requests(self, connection: Connection, stream: Any) -> None:
        while line := stream.readline(MAX_LINE_BYTES):
            request_id, answer = self._answer(connection, line)
            try:
                connection.send({"id": request_id, **answer})
            except (ValueError, TypeError) as error:
                text = f"the answer cannot be sent as JSON: {error}"
                connection.send({"id": request_id, **_error("DaemonError", text)})
            if connection.events is not None:
                while (event := connection.events.get()) is not None:
                    connection.send(event)
                return

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
            given_id = request.get("id")
            request_id = given_id if isinstance(given_id, int | str) else None
            method, params = request["method"], request.get("params", {})
            if method == "subscribe":
                connection.events = queue.SimpleQueue()
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


def _error(kind: str, message: str) -> dict[str, Any]:
    return {"error": {"kind": kind, "message": message}}


def _listen(path: Path) -> socket.socket:
    """Open and return a socket that listens at `path`, with mode 0600 in a private folder.

    The socket that a killed daemon left at `path` is replaced.

    Raises:
        DaemonBusy: a daemon listens at `path` already.
        DaemonError: the path is too long or taken, its folder is not private, or the socket cannot be made.
    """
    if len(str(path).encode()) > 100:
        raise DaemonError(
            f"{path}: a socket's path may have 100 bytes; "
            "set [daemon] socket in the rig file to a shorter one"
        )
    _require_private_folder(path.parent)
    _remove_stale_socket(path)
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    mask = os.umask(0o177)
    try:
        sock.bind(str(path))
    except OSError as error:
        sock.close()
        raise DaemonError(
            f"{path}: the daemon's socket cannot be made: {error.strerror}: set [daemon] socket elsewhere"
        ) from None
    finally:
        os.umask(mask)
    sock.listen(16)
    return sock


def _require_private_folder(folder: Path) -> None:
    """Create the socket's folder if it is missing; raise DaemonError if the folder is not private.

    Raises:
        DaemonError: the folder cannot be made, is a symbolic link, belongs to another user, or others may
            access it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise DaemonError(
            f"{folder}: cannot be made for the daemon's socket: {error.strerror}: "
            "set [daemon] socket elsewhere"
        ) from None
    if stat.S_ISLNK(found.st_mode):
        raise DaemonError(
            f"{folder}: is a symbolic link, but the daemon's socket needs a folder: "
            "set [daemon] socket to a path in the folder that the link leads to"
        )
    if found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        raise DaemonError(
            f"{folder}: the folder of the daemon's socket must belong to you alone: set its mode (chmod 700)"
        )


def _remove_stale_socket(path: Path) -> None:
    """Remove the socket that a killed daemon left at `path`, if there is one; never anything else.

    Raises:
        DaemonBusy: a daemon listens at `path`.
        DaemonError: something else is at `path`, the socket belongs to another user, or the daemon there
            hangs.
    """
    try:
        found = path.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(found.st_mode):
        raise DaemonError(
            f"{path}: is not a socket, and is left as it is: "
            "set [daemon] socket in the rig file to another path"
        )
    if found.st_uid != os.getuid():
        raise DaemonError(
            f"{path}: belongs to user {found.st_uid}, and is left as it is: "
            "set [daemon] socket in the rig file to another path"
        )
    try:
        DaemonClient(path).close()
    except DaemonNotRunning:
        path.unlink()
    else:
        raise DaemonBusy(
            f"a daemon already listens at {path}: "
            "stop it with `acquire stop --daemon`, or set [daemon] socket to another path"
        )
