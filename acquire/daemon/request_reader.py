"""Requests of one client, as lines of bounded size, from a client that may stop in the middle of one."""

from __future__ import annotations

import select
import socket
import threading
import time

from acquire.errors import DaemonError

LINE_BYTES = 1 << 20
"""size of a request up to which any number of clients may send one at once [bytes]"""
LARGE_BYTES = 64 << 20
"""greatest size of a request, with at most one shape file; one client at a time sends one [bytes]"""
LINE_S = 10.0
"""longest time from a request's first byte to its last [s]"""
_CHUNK_BYTES = 1 << 18


class RequestReader:
    """Requests from a connected socket, one line each.

    Args:
        sock: connected socket, in blocking mode.
        large: lock that all clients share; it is held while a request above `LINE_BYTES` arrives.
        sent: what the client has sent already.
    """

    def __init__(self, sock: socket.socket, large: threading.Lock, sent: bytearray) -> None:
        self._socket = sock
        self._large = large
        self._buffer = sent
        self._poll = select.poll()
        self._poll.register(sock, select.POLLIN)

    def next_line(self, idle_s: float | None) -> bytes | None:
        """Next request without its line end; None if the client has hung up.

        Args:
            idle_s: longest wait for the request's first byte [s]; None: without limit.

        Raises:
            DaemonError: the client was idle for too long, or the request is too large or not sent to its end
                in time. Nothing more can be read.
            OSError: the connection broke.
        """
        if not self._buffer and not self._receive(idle_s, f"no request came for {idle_s} s"):
            return None
        end_s, searched = time.monotonic() + LINE_S, 0
        holding = False
        try:
            while (end := self._buffer.find(b"\n", searched)) < 0:
                searched = len(self._buffer)
                if searched > LARGE_BYTES:
                    raise DaemonError(f"a request may have {LARGE_BYTES >> 20} MiB")
                left_s = max(0.0, end_s - time.monotonic())
                if searched > LINE_BYTES and not holding:
                    holding = self._large.acquire(timeout=left_s)
                    if not holding:
                        raise DaemonError("another client's large request did not end: send yours again")
                if not self._receive(left_s, f"a request did not end within {LINE_S:g} s"):
                    return None
        finally:
            if holding:
                self._large.release()
        line = bytes(self._buffer[:end])
        del self._buffer[: end + 1]
        return line

    def _receive(self, timeout_s: float | None, late: str) -> bool:
        """Append what the client sends next; False if it has hung up.

        Raises:
            DaemonError: nothing comes for `timeout_s`; `late` says so.
            OSError: the connection broke.
        """
        if not self._poll.poll(None if timeout_s is None else 1e3 * timeout_s):
            raise DaemonError(f"{late}: the daemon hangs up: connect again")
        data = self._socket.recv(_CHUNK_BYTES)
        self._buffer += data
        return bool(data)
