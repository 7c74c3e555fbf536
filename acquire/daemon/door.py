"""Door of the daemon's socket: takes connections, and keeps those that have not made a request yet.

A client that only connects, or stops in the middle of its first request, costs no thread. If too many do, the
one that has waited longest is sent away.
"""

from __future__ import annotations

import contextlib
import json
import selectors
import socket
import time
from dataclasses import dataclass, field

from acquire.daemon.peer import read_peer
from acquire.daemon.request_reader import LINE_S

FIRST_BYTES = 1 << 16
"""size from which on a first request goes to a thread before its end has come [bytes]"""
MAX_WAITING = 256
"""connections that may be open without having made a request"""
SILENT_S = 3600.0
"""longest time that a connection may be open without having sent anything [s]"""
_AT_ONCE = 64
"""connections taken before those that have sent something are looked at again"""


@dataclass(eq=False)
class Caller:
    """Client that has connected, with what it has sent so far."""

    sock: socket.socket
    """its connection"""
    sent: bytearray = field(default_factory=bytearray)
    """its first request with the line's end, once it is let in, and what came after it"""
    since_s: float = field(default_factory=time.monotonic)
    """when it connected, or sent its first byte (monotonic) [s]"""

    def listen(self) -> bool:
        """Read what it has sent, without waiting; False if it has hung up."""
        try:
            data = self.sock.recv(FIRST_BYTES, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return True
        except OSError:
            return False
        if not self.sent:
            self.since_s = time.monotonic()
        self.sent += data
        return bool(data)

    @property
    def late(self) -> bool:
        """True if it has been silent, or in the middle of its first request, for too long."""
        return time.monotonic() - self.since_s > (LINE_S if self.sent else SILENT_S)

    @property
    def speaks(self) -> bool:
        """True once it has made a request, or one so large that a thread must read on."""
        return b"\n" in self.sent or len(self.sent) >= FIRST_BYTES


class Door:
    """Takes the connections of a listening unix socket; the owner of the daemon may come in.

    Args:
        listener: listening socket, which `close` closes.
        served_uid: id of the user whose processes are served.
        name: name of the socket in messages.
    """

    def __init__(self, listener: socket.socket, served_uid: int, name: str) -> None:
        self._listener, self._served_uid, self._name = listener, served_uid, name
        self._listener.setblocking(False)
        self._callers: dict[socket.socket, Caller] = {}
        """clients that have made no request, the oldest first"""
        self._woken, self._waker = socket.socketpair()
        self._waker.setblocking(False)
        self._selector = selectors.DefaultSelector()
        for each in (self._listener, self._woken):
            self._selector.register(each, selectors.EVENT_READ)

    def speaking(self, timeout_s: float) -> list[Caller]:
        """Wait until a client makes a request; return those that did, which are the caller's from now on.

        Returns:
            Clients with their first request; none after `wake`.

        Raises:
            OSError: no connection can be taken, as when the process has too many files open. Those that are
                open are kept, but for the oldest without a request.
        """
        came = False
        speaking: list[Caller] = []
        for key, _ in self._selector.select(timeout_s):
            if key.fileobj is self._listener:
                came = True
            elif key.fileobj is self._woken:
                self._woken.recv(4096)
            else:
                speaking += self._heard(self._callers[key.fileobj])  # pyright: ignore[reportArgumentType]
        for caller in [each for each in self._callers.values() if each.late]:
            self._send_away(caller, "a request did not end in time" if caller.sent else "no request came")
        if came:
            try:
                self._take()
            except OSError:
                speaking += self._send_oldest_away("the daemon has too many files open")
                if not speaking:
                    raise
        while len(self._callers) > MAX_WAITING:
            speaking += self._send_oldest_away("too many connections are open")
        return speaking

    def wake(self) -> None:
        """Let `speaking` return at once; any thread may call it."""
        with contextlib.suppress(OSError):
            self._waker.send(b"\0")

    def close(self) -> None:
        """Stop listening, and hang up on all who have made no request."""
        self._selector.close()
        for sock in (*self._callers, self._listener, self._woken, self._waker):
            sock.close()
        self._callers.clear()

    def _take(self) -> None:
        """Take the connections that the system has queued, but not all of a flood.

        Raises:
            OSError: a connection cannot be taken.
        """
        for _ in range(_AT_ONCE):
            try:
                sock, _address = self._listener.accept()
            except (BlockingIOError, ConnectionAbortedError, InterruptedError):
                return
            sock.setblocking(True)
            if (uid := read_peer(sock).uid) == self._served_uid:
                self._callers[sock] = Caller(sock)
                self._selector.register(sock, selectors.EVENT_READ)
            else:
                hang_up(sock, f"{self._name}: the daemon serves only user {self._served_uid}, not user {uid}")

    def _heard(self, caller: Caller) -> list[Caller]:
        """Read what a client has sent; the client, if it has now made a request."""
        if not caller.listen():
            self._forget(caller)
            caller.sock.close()
        elif caller.speaks:
            self._forget(caller)
            return [caller]
        return []

    def _forget(self, caller: Caller) -> None:
        self._selector.unregister(caller.sock)
        del self._callers[caller.sock]

    def _send_oldest_away(self, why: str) -> list[Caller]:
        """Hang up on the client that has waited longest; or return it, if it has just made its request."""
        if not self._callers:
            return []
        oldest = next(iter(self._callers.values()))
        if (heard := self._heard(oldest)) or oldest.sock not in self._callers:
            return heard
        self._send_away(oldest, why)
        return []

    def _send_away(self, caller: Caller, why: str) -> None:
        self._forget(caller)
        hang_up(caller.sock, f"{why}: the daemon hangs up: connect again")


def hang_up(sock: socket.socket, why: str, kind: str = "DaemonError", request_id: object = None) -> None:
    """Close a connection, after an answer that says why, if the client can take it at once.

    Args:
        sock: connected socket.
        why: message for the client.
        kind: class of the error that the client is to raise.
        request_id: id of the request that this answers; None if there is none.
    """
    answer = {"id": request_id, "error": {"kind": kind, "message": why}}
    with sock, contextlib.suppress(OSError):
        sock.send(json.dumps(answer).encode() + b"\n", socket.MSG_DONTWAIT)
