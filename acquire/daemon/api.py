"""The daemon's local API: JSON lines over a unix socket that only its user can open.

Request  {"id": 1, "method": "striker.arm", "params": {}}
Answer   {"id": 1, "result": {...}}  or  {"id": 1, "error": {"kind": "StrikerRefused", "message": "..."}}
Before an answer that takes its time, once a second: {"id": 1, "busy_s": 3.0}. A client that hears neither knows that the daemon hangs.
After the request `subscribe` the connection carries events only: {"event": "prompt", ...}.

The socket is 0600 in a folder that is 0700 and ours, and the peer's user id is checked, so that another user is refused twice. The client
checks whose daemon it speaks to in the same way.
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
from typing import Any, NamedTuple

from acquire import errors
from acquire.errors import AcquireError, DaemonBusy, DaemonError, DaemonNotRunning, DaemonSilent

MAX_LINE = 64 << 20
"""bytes; a request carries at most one shape file"""
BUSY_S = 1.0
"""a request under work is said to be so this often"""
PATIENCE_S = 6.0
"""a daemon of which a client hears nothing for so long hangs: six signs of life on a machine that keeps each waiting"""

Handler = Callable[["Connection", dict[str, Any]], object]


class Connection:
    """One client, as the daemon sees it. `on_close` callbacks run when it goes away, however it goes."""

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self._send_lock = threading.Lock()
        self.on_close: list[Callable[[], None]] = []
        self.events: queue.SimpleQueue[dict[str, Any] | None] | None = None
        self._asked: tuple[object, float] | None = None
        """id of the request under work, and since when (monotonic)"""

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

    @contextlib.contextmanager
    def at_work(self, request_id: object) -> Iterator[None]:
        """The block answers this request; meanwhile `say_busy` has something to say."""
        self._asked = (request_id, time.monotonic())
        try:
            yield
        finally:
            with self._send_lock:  # no "busy" after the answer
                self._asked = None

    def say_busy(self) -> None:
        """Tell the client, if it waits for an answer, that it is under work. Never waits: a client that does not read gets none."""
        if not self._send_lock.acquire(blocking=False):
            return
        try:
            if self._asked is not None:
                request_id, since = self._asked
                line = json.dumps({"id": request_id, "busy_s": round(time.monotonic() - since, 1)}).encode() + b"\n"
                with contextlib.suppress(OSError):  # a unix socket takes a short line whole or not at all
                    self._socket.send(line, socket.MSG_DONTWAIT)
        finally:
            self._send_lock.release()

    def close(self) -> None:
        """Wake both sides of the connection; its thread then ends."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        if self.events is not None:
            self.events.put(None)


class ApiServer:
    """Accepts clients and runs each one's requests in order in a thread of its own, so that `stop` never waits for `strike`.

    Args:
        path: of the socket.
        handlers: what a request's method leads to.
        served_uid: the user whose processes are served; ours where it is None.

    Raises:
        DaemonBusy: a daemon listens there already.
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
        self._pulse = threading.Thread(target=self._say_busy, name="api-busy")
        self._pulse.start()

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
        self._closed.set()
        self._pulse.join()
        self._path.unlink(missing_ok=True)

    def _accept(self) -> None:
        while not self._closing:
            try:
                sock, _ = self._socket.accept()
            except OSError:
                return
            if (uid := _peer(sock).uid) != self._served_uid:
                with sock, contextlib.suppress(OSError):
                    refusal = _error("DaemonError", f"{self._path}: the daemon serves user {self._served_uid} alone, and not user {uid}")
                    sock.send(json.dumps({"id": None, **refusal}).encode() + b"\n", socket.MSG_DONTWAIT)
                continue
            connection = Connection(sock)
            thread = threading.Thread(target=self._serve, args=(connection, sock), name="api-client")
            with self._lock:
                self._connections.add(connection)
                self._threads.add(thread)
            thread.start()

    def _say_busy(self) -> None:
        while not self._closed.wait(BUSY_S):
            with self._lock:
                connections = list(self._connections)
            for connection in connections:
                connection.say_busy()

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
            with connection.at_work(request_id):
                return request_id, {"result": handler(connection, params)}
        except AcquireError as error:
            return request_id, _error(type(error).__name__, str(error))
        except Exception as error:  # whatever a request leads to, it is answered and the connection lives
            return request_id, _error("DaemonError", f"request not understood: {type(error).__name__}: {error}")


class DaemonClient:
    """A client of the daemon. One request at a time; use one client per thread.

    Args:
        path: of the daemon's socket.
        patience_s: how long it may be silent; an answer may take as long as it needs, as long as the daemon says that it is at work.

    Raises (every call):
        DaemonNotRunning: nobody listens, or the daemon went away.
        DaemonSilent: it is there and says nothing. The client is of no use any more.
        AcquireError: what the daemon raised, as the same class.
    """

    def __init__(self, path: Path, patience_s: float = PATIENCE_S) -> None:
        self._path = path
        self._patience_s = patience_s
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(patience_s)
        try:
            self._socket.connect(str(path))
        except (TimeoutError, BlockingIOError):  # it takes no connections: as many wait as may
            self._socket.close()
            raise DaemonSilent(
                f"the daemon at {path} takes no connections: it hangs: find it with `fuser {path}`, end it with `kill -9`, start it again"
            ) from None
        except OSError:
            self._socket.close()
            raise DaemonNotRunning(f"no daemon listens at {path}: start one with `acquire run RIG.toml`") from None
        self._daemon = _peer(self._socket)
        if self._daemon.uid not in {os.getuid(), 0}:
            self._socket.close()
            raise DaemonError(
                f"{path}: what listens there belongs to user {self._daemon.uid}: set [daemon] socket in the rig file elsewhere"
            )
        self._stream = self._socket.makefile("rb")
        self._next_id = 1

    def call(self, method: str, **params: Any) -> Any:
        """Send a request and wait for its answer."""
        request_id, self._next_id = self._next_id, self._next_id + 1
        request = json.dumps({"id": request_id, "method": method, "params": params}, allow_nan=False).encode() + b"\n"
        try:
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # who refuses us says why before hanging up
                self._socket.sendall(request)
            answer = self._heard()
            while "busy_s" in answer:
                answer = self._heard()
        except TimeoutError:
            pid = self._daemon.pid
            raise DaemonSilent(
                f"the daemon (process {pid}) has not answered {method!r} for {self._patience_s:g} s: it hangs: "
                f"end it with `kill -9 {pid}` and start it again with `acquire run RIG.toml`"
            ) from None
        except (OSError, EOFError):
            raise DaemonNotRunning(f"the daemon at {self._path} went away during {method}") from None
        try:
            if "error" not in answer:
                return answer["result"]
            name, message = str(answer["error"]["kind"]), str(answer["error"]["message"])
        except (KeyError, TypeError):
            raise self._no_daemon() from None
        raise errors.by_name(name, DaemonError)(message)

    def _heard(self) -> dict[str, Any]:
        line = self._stream.readline()
        if not line:
            raise EOFError
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError):
            raise self._no_daemon() from None
        if not isinstance(answer, dict):
            raise self._no_daemon()
        return answer

    def _no_daemon(self) -> DaemonError:
        return DaemonError(f"{self._path}: what listens there is no daemon of ours: see [daemon] socket in the rig file")

    def another(self) -> DaemonClient:
        """A new client of the same daemon: after an interruption the answer to the last call may still be on this one's way."""
        return DaemonClient(self._path, self._patience_s)

    def events(self) -> Iterator[dict[str, Any]]:
        """Subscribe and yield events until the daemon or `close` ends it; the client serves no other call afterwards."""
        self.call("subscribe")
        self._socket.settimeout(None)  # events come when they come
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
        folder = path.parent.lstat()
    except OSError as error:
        raise DaemonError(
            f"{path.parent}: cannot be made for the daemon's socket: {error.strerror}: set [daemon] socket elsewhere"
        ) from None
    if stat.S_ISLNK(folder.st_mode):
        raise DaemonError(f"{path.parent}: is a symbolic link, the daemon's socket wants a folder: set [daemon] socket to where it leads")
    if folder.st_uid != os.getuid() or stat.S_IMODE(folder.st_mode) & 0o077:
        raise DaemonError(f"{path.parent}: must belong to you alone (chmod 700), the daemon's socket lies in it")
    _make_room(path)
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


def _make_room(path: Path) -> None:
    """Remove the socket that a killed daemon left; anything else that lies there is not touched."""
    try:
        found = path.lstat()
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(found.st_mode):
        raise DaemonError(f"{path}: is no socket, and is not touched: set [daemon] socket in the rig file to another path")
    if found.st_uid != os.getuid():
        raise DaemonError(
            f"{path}: belongs to user {found.st_uid}, and is not touched: set [daemon] socket in the rig file to another path"
        )
    try:
        DaemonClient(path).close()
    except DaemonNotRunning:
        path.unlink()
    else:
        raise DaemonBusy(
            f"a daemon already listens at {path}: stop it with `acquire stop --daemon`, or set [daemon] socket to another path"
        )


class _Peer(NamedTuple):
    """Who is at the other end of a unix socket, as the kernel knows it (unix(7), SO_PEERCRED)."""

    pid: int
    uid: int
    gid: int


def _peer(sock: socket.socket) -> _Peer:
    form = struct.Struct("3i")
    return _Peer(*form.unpack(sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, form.size)))
