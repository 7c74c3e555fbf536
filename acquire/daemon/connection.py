"""Connection of one client to the daemon: what is sent to it, and what happens when it ends."""

from __future__ import annotations

import contextlib
import json
import queue
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

MAX_EVENTS = 4096
"""events that wait for a subscriber; one that is further behind is disconnected"""
SEND_S = 10.0
"""longest wait for a client that does not read what it is sent [s]; then it is disconnected"""
_LISTEN_S = 0.5
"""interval at which a subscriber is checked for having hung up [s]"""


class Connection:
    """Connection of one client to the daemon; its `on_close` callbacks run when it ends, however it ends.

    Args:
        sock: connected socket.
    """

    def __init__(self, sock: socket.socket) -> None:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", int(SEND_S), 0))
        self._socket = sock
        self._send_lock = threading.Lock()
        self.on_close: list[Callable[[], None]] = []
        self._events: queue.Queue[dict[str, Any] | None] | None = None
        """events to send; None before the client subscribes"""
        self._in_progress: tuple[object, float] | None = None
        """id of the request in progress, and its start (monotonic) [s]"""
        self._idle_since = time.monotonic()
        """end of the last request (monotonic) [s]"""

    @property
    def gone(self) -> bool:
        """True if the client has hung up; requests that wait for something check it."""
        try:
            return self._socket.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
        except BlockingIOError:
            return False
        except OSError:
            return True

    @property
    def idle_s(self) -> float:
        """Time since the last request [s]; 0 for a client that waits, listens, or has a session open."""
        busy = self._in_progress is not None or self._events is not None or bool(self.on_close)
        return 0.0 if busy else time.monotonic() - self._idle_since

    @property
    def subscribed(self) -> bool:
        """True once the client has subscribed to events."""
        return self._events is not None

    def send(self, message: Mapping[str, Any]) -> None:
        """Send the client one message as a line of JSON; waits a while for a client that does not read.

        Raises:
            OSError: the client has hung up, or does not read.
            ValueError, TypeError: `message` holds something that JSON cannot.
        """
        data = json.dumps(message, allow_nan=False).encode() + b"\n"
        with self._send_lock:
            self._socket.sendall(data)

    def subscribe(self) -> None:
        """Queue events for this client from now on."""
        self._events = queue.Queue(MAX_EVENTS)

    def publish(self, event: dict[str, Any]) -> bool:
        """Queue an event without waiting; a client that is too far behind to take it is disconnected.

        Returns:
            False if the client was disconnected.
        """
        if self._events is None:
            return True
        try:
            self._events.put_nowait(event)
        except queue.Full:
            self.close()
            return False
        return True

    def send_events(self) -> None:
        """Send the queued events as they come, until either side hangs up.

        Raises:
            OSError: the client has hung up, or does not read.
        """
        while self._events is not None and not self.gone:
            with contextlib.suppress(queue.Empty):
                if (event := self._events.get(timeout=_LISTEN_S)) is None:
                    return
                self.send(event)

    @contextlib.contextmanager
    def in_progress(self, request_id: object) -> Iterator[None]:
        """Context manager; while it is open, `report_busy` reports `request_id` as in progress."""
        self._in_progress = (request_id, time.monotonic())
        try:
            yield
        finally:
            with self._send_lock:  # no busy report after the answer
                self._idle_since = time.monotonic()
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
        if self._events is not None:
            with contextlib.suppress(queue.Full):
                self._events.put_nowait(None)
