"""The daemon's local API: JSON lines over a unix socket that only its user can open.

Request  {"id": 1, "method": "striker.arm", "params": {}}
Answer   {"id": 1, "result": {...}}  or  {"id": 1, "error": {"kind": "StrikerRefused", "message": "..."}}
After the request `subscribe` the connection carries events only: {"event": "prompt", ...}.

The socket is 0600 in a folder that is 0700 and ours, and the peer's user id is checked, so that another user is refused twice.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import socket
import stat
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from acquire import errors
from acquire.errors import AcquireError, DaemonBusy, DaemonError, DaemonNotRunning

MAX_LINE = 64 << 20
"""bytes; a request carries at most one shape file"""

Handler = Callable[["Connection", dict[str, Any]], object]


class Connection:
    """One client, as the daemon sees it. `on_close` callbacks run when it goes away, however it goes."""

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self._send_lock = threading.Lock()
        self.on_close: list[Callable[[], None]] = []
        self.events: queue.SimpleQueue[dict[str, Any] | None] | None = None

    @property
    def gone(self) -> bool:
        """Whether the client has hung up; for handlers that wait."""
        try:
            return self._socket.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True

    def send(self, message: Mapping[str, Any]) -> None:
        """Send one line."""
        data = json.dumps(message, allow_nan=False).encode() + b"\n"
        with self._send_lock:
            self._socket.sendall(data)

    def close(self) -> None:
        """Wake both sides of the connection; its thread then ends."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        if self.events is not None:
            self.events.put(None)


class ApiServer:
    """Accepts clients and runs each one's requests in order in a thread of its own, so that `stop` never waits for `strike`."""

    def __init__(self, path: Path, handlers: Mapping[str, Handler]) -> None:
        self._path = path
        self._handlers = handlers
        self._connections: set[Connection] = set()
        self._threads: set[threading.Thread] = set()
        self._lock = threading.Lock()
        self._closing = False
        self._socket = _listen(path)
        self._acceptor = threading.Thread(target=self._accept, name="api-accept")
        self._acceptor.start()

    def publish(self, event: str, data: Mapping[str, Any]) -> None:
        """Send an event to every subscriber; a slow one never holds up the caller."""
        with self._lock:
            subscribers = [c.events for c in self._connections if c.events is not None]
        for subscriber in subscribers:
            subscriber.put({"event": event, **data})

    def close(self) -> None:
        """Stop listening, drop the clients, remove the socket."""
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
        self._path.unlink(missing_ok=True)

    def _accept(self) -> None:
        while not self._closing:
            try:
                sock, _ = self._socket.accept()
            except OSError:
                return
            if _peer_uid(sock) != os.getuid():
                sock.close()
                continue
            connection = Connection(sock)
            thread = threading.Thread(target=self._serve, args=(connection, sock), name="api-client")
            with self._lock:
                self._connections.add(connection)
                self._threads.add(thread)
            thread.start()

    def _serve(self, connection: Connection, sock: socket.socket) -> None:
        try:
            with sock, sock.makefile("rb") as stream:
                self._requests(connection, stream)
        except OSError:
            pass  # the client went away; what it had asked for is done or undone by on_close
        finally:
            for callback in connection.on_close:
                callback()
            with self._lock:
                self._connections.discard(connection)
                self._threads.discard(threading.current_thread())

    def _requests(self, connection: Connection, stream: Any) -> None:
        while line := stream.readline(MAX_LINE):
            request_id, answer = self._answer(connection, line)
            try:
                connection.send({"id": request_id, **answer})
            except (ValueError, TypeError) as error:
                connection.send({"id": request_id, **_error("DaemonError", f"the answer cannot be sent as JSON: {error}")})
            if connection.events is not None:
                while (event := connection.events.get()) is not None:
                    connection.send(event)
                return

    def _answer(self, connection: Connection, line: bytes) -> tuple[object, dict[str, Any]]:
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
                return request_id, _error("DaemonError", f"unknown method {method!r}; known: {', '.join(sorted(self._handlers))}")
            return request_id, {"result": handler(connection, params)}
        except AcquireError as error:
            return request_id, _error(type(error).__name__, str(error))
        except Exception as error:  # whatever a request leads to, it is answered and the connection lives
            return request_id, _error("DaemonError", f"request not understood: {type(error).__name__}: {error}")


class DaemonClient:
    """A client of the daemon. One request at a time; use one client per thread.

    Raises (every call):
        DaemonNotRunning: nobody listens, or the daemon went away.
        AcquireError: what the daemon raised, as the same class.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(str(path))
        except OSError:
            self._socket.close()
            raise DaemonNotRunning(f"no daemon listens at {path}: start one with `acquire run RIG.toml`") from None
        self._stream = self._socket.makefile("rb")
        self._next_id = 1

    def call(self, method: str, **params: Any) -> Any:
        """Send a request and wait for its answer."""
        request_id, self._next_id = self._next_id, self._next_id + 1
        try:
            self._socket.sendall(json.dumps({"id": request_id, "method": method, "params": params}, allow_nan=False).encode() + b"\n")
            line = self._stream.readline()
        except OSError:
            line = b""
        if not line:
            raise DaemonNotRunning(f"the daemon at {self._path} went away during {method}")
        try:
            answer = json.loads(line)
            if "error" not in answer:
                return answer["result"]
            name, message = str(answer["error"]["kind"]), str(answer["error"]["message"])
        except (ValueError, KeyError, TypeError, RecursionError):
            raise DaemonError(f"{self._path}: what listens there is no daemon of ours: see [daemon] socket in the rig file") from None
        raise errors.by_name(name, DaemonError)(message)

    def another(self) -> DaemonClient:
        """A new client of the same daemon: after an interruption the answer to the last call may still be on this one's way."""
        return DaemonClient(self._path)

    def events(self) -> Iterator[dict[str, Any]]:
        """Subscribe and yield events until the daemon or `close` ends it; the client serves no other call afterwards."""
        self.call("subscribe")
        with contextlib.suppress(OSError, ValueError):
            while line := self._stream.readline():
                yield json.loads(line)

    def close(self) -> None:
        """End the connection, also from another thread."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        with contextlib.suppress(OSError):
            self._stream.close()
        self._socket.close()

    def __enter__(self) -> DaemonClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def wait_for_socket(path: Path, alive: Callable[[], bool], timeout_s: float = 20.0) -> None:
    """Wait until a daemon listens at `path`; `alive()` False ends the wait early.

    Raises:
        DaemonBusy: it did not come up in time.
    """
    end = time.monotonic() + timeout_s
    while time.monotonic() < end and alive():
        if path.exists():
            return
        time.sleep(0.05)
    raise DaemonBusy(f"the daemon did not come up within {timeout_s:g} s at {path}")


def _error(kind: str, message: str) -> dict[str, Any]:
    return {"error": {"kind": kind, "message": message}}


def _listen(path: Path) -> socket.socket:
    if len(str(path).encode()) > 100:
        raise DaemonError(f"{path}: a socket's path may have 100 bytes; set [daemon] socket in the rig file to a shorter one")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = path.parent.stat()
    except OSError as error:
        raise DaemonError(
            f"{path.parent}: cannot be made for the daemon's socket: {error.strerror}: set [daemon] socket elsewhere"
        ) from None
    if folder.st_uid != os.getuid() or stat.S_IMODE(folder.st_mode) & 0o077:
        raise DaemonError(f"{path.parent}: must belong to you alone (chmod 700), the daemon's socket lies in it")
    if path.exists():
        if not path.is_socket():
            raise DaemonError(f"{path}: is no socket, and is not touched: set [daemon] socket in the rig file to another path")
        try:
            DaemonClient(path).close()
        except DaemonNotRunning:
            path.unlink()  # left by a daemon that was killed
        else:
            raise DaemonBusy(f"a daemon already listens at {path}: stop it with `acquire stop`, or set [daemon] socket to another path")
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    mask = os.umask(0o177)
    try:
        sock.bind(str(path))
    except OSError as error:
        sock.close()
        raise DaemonError(f"{path}: the daemon's socket cannot be made: {error.strerror}: set [daemon] socket elsewhere") from None
    finally:
        os.umask(mask)
    sock.listen(16)
    return sock


def _peer_uid(sock: socket.socket) -> int:
    credentials = sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    return struct.unpack("3i", credentials)[1]
