"""Client of the daemon's local API: JSON lines over a unix socket (protocol in server.py)."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from acquire import errors
from acquire.daemon.peer import read_peer
from acquire.errors import DaemonBusy, DaemonError, DaemonNotRunning, DaemonSilent

PATIENCE_S = 6.0
"""silence after which the daemon counts as hung [s]: six busy reports, so that a slow computer may delay
them"""
_RETRY_S = 0.001
"""pause before the next try to connect, while the queue of waiting connections is full [s]"""


class DaemonClient:
    """Client of the daemon's local API; as a context manager it closes itself.

    It sends one request at a time: use one client per thread.

    Args:
        path: path of the daemon's socket.
        patience_s: longest wait [s] for the next line from the daemon. An answer may take longer, because
            the daemon reports once a second that it is busy.

    Raises:
        DaemonNotRunning: no daemon listens at `path`, or it went away.
        DaemonSilent: the daemon does not answer. The client cannot be used any more.
        DaemonError: the socket belongs to another user, or its answer is invalid.
        AcquireError: from `call`, the error that the daemon raised, as the same class; DaemonError if this
            version has no such class.
    """

    def __init__(self, path: Path, patience_s: float = PATIENCE_S) -> None:
        self._path = path
        self._patience_s = patience_s
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(patience_s)
        try:
            _connect(self._socket, path, patience_s)
        except TimeoutError:
            self._socket.close()
            raise DaemonSilent(
                f"the daemon at {path} has taken no connection for {patience_s:g} s: it hangs, or other "
                f"programs connect without end: find them with `fuser {path}` and end those; if only the "
                "daemon is left, end it with `kill -9` and start it again"
            ) from None
        except OSError:
            self._socket.close()
            raise DaemonNotRunning(
                f"no daemon listens at {path}: start one with `acquire run RIG.toml`"
            ) from None
        self._daemon = read_peer(self._socket)
        if self._daemon.uid not in {os.getuid(), 0}:
            self._socket.close()
            raise DaemonError(
                f"{path}: the socket belongs to user {self._daemon.uid}: "
                "set [daemon] socket in the rig file to another path"
            )
        self._stream = self._socket.makefile("rb")
        self._next_id = 1

    def call(self, method: str, **params: Any) -> Any:
        """Send a request and wait for its answer.

        Args:
            method: `status`, `striker.home`, `striker.arm`, `striker.cock`, `striker.strike`, `striker.stop`,
                `recording.open`, `recording.close`, `window.open`, `window.close`, `shutdown`, and the others
                of `Daemon`.
            params: parameters of the method, as JSON values.

        Returns:
            `result` of the daemon's answer, a JSON value.

        Raises:
            DaemonSilent: neither an answer nor a report that the daemon is busy came in time.
            DaemonNotRunning: the daemon went away.
            DaemonError: the answer is invalid.
            AcquireError: the daemon refused the request; the same class as raised there (e.g.
                StrikerRefused).
        """
        request_id, self._next_id = self._next_id, self._next_id + 1
        request = {"id": request_id, "method": method, "params": params}
        line = json.dumps(request, allow_nan=False).encode() + b"\n"
        try:
            # A daemon that refuses this client sends the reason before it hangs up: it is read below.
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                self._socket.sendall(line)
            answer = self._receive()
            while "busy_s" in answer:
                answer = self._receive()
        except TimeoutError:
            pid = self._daemon.pid
            raise DaemonSilent(
                f"the daemon (process {pid}) has not answered {method!r} for {self._patience_s:g} s: "
                f"it hangs: end it with `kill -9 {pid}` and start it again with `acquire run RIG.toml`"
            ) from None
        except (OSError, EOFError):
            raise DaemonNotRunning(f"the daemon at {self._path} went away during {method}") from None
        try:
            if "error" not in answer:
                return answer["result"]
            name, message = str(answer["error"]["kind"]), str(answer["error"]["message"])
        except (KeyError, TypeError):
            raise self._invalid_answer() from None
        raise errors.by_name(name, DaemonError)(message)

    def events(self) -> Iterator[dict[str, Any]]:
        """Subscribe to the daemon's events, and yield them until the connection ends or a line is no JSON.

        The client cannot make another call afterwards.

        Yields:
            Events as JSON objects: `{"event": name, ...}`.

        Raises:
            AcquireError: the daemon did not accept the subscription.
        """
        self.call("subscribe")
        yield from self.subscribed_events()

    def subscribed_events(self) -> Iterator[dict[str, Any]]:
        """Yield the daemon's events after the call `subscribe`, as `events` does."""
        self._socket.settimeout(None)  # the time between two events is unlimited
        with contextlib.suppress(OSError, ValueError):
            while line := self._stream.readline():
                yield json.loads(line)

    def another(self) -> DaemonClient:
        """Connect to this client's daemon again, and return the new client.

        Use the new client after an interrupted call, whose answer this one may still receive.

        Raises:
            DaemonError: the daemon does not listen or takes no connections, or its socket belongs to
                another user.
        """
        return DaemonClient(self._path, self._patience_s)

    def close(self) -> None:
        """End the connection; any thread may call it, also twice."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        with contextlib.suppress(OSError):
            self._stream.close()
        self._socket.close()

    def __enter__(self) -> DaemonClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _receive(self) -> dict[str, Any]:
        line = self._stream.readline()
        if not line:
            raise EOFError
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError):
            raise self._invalid_answer() from None
        if not isinstance(answer, dict):
            raise self._invalid_answer()
        return answer

    def _invalid_answer(self) -> DaemonError:
        return DaemonError(
            f"{self._path}: the program that listens there is not a daemon of Percuss: "
            "see [daemon] socket in the rig file"
        )


def _connect(sock: socket.socket, path: Path, patience_s: float) -> None:
    """Connect to the socket at `path`, also if its queue of waiting connections is full for a while.

    Raises:
        TimeoutError: the queue was full for `patience_s` [s].
        OSError: nothing listens at `path`.
    """
    end_s = time.monotonic() + patience_s
    while True:
        try:
            sock.connect(str(path))
        except BlockingIOError:  # at once: unix sockets do not wait for a place in the queue
            if time.monotonic() > end_s:
                raise TimeoutError from None
            time.sleep(_RETRY_S)
        else:
            return


def wait_for_socket(path: Path, alive: Callable[[], bool], timeout_s: float = 20.0) -> None:
    """Wait until a daemon that was just started takes connections at `path`.

    Args:
        path: path of the socket.
        alive: function that returns True while the starting daemon's process runs; checked meanwhile.
        timeout_s: longest wait [s].

    Raises:
        DaemonBusy: no daemon listens after `timeout_s`, or `alive` returned False before.
        DaemonError: the socket belongs to another user, or its daemon hangs.
    """
    end = time.monotonic() + timeout_s
    while time.monotonic() < end and alive():
        with contextlib.suppress(DaemonNotRunning), DaemonClient(path):
            return
        time.sleep(0.05)
    raise DaemonBusy(f"the daemon did not come up within {timeout_s:g} s at {path}")
