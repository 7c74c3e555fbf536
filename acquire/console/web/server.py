"""Web server of the console: loopback only, with limits on slow clients and on connections of strangers."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from typing import Any, Final

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from acquire.console.web.gate import KNOWN
from acquire.errors import AcquireError

HOST: Final = "127.0.0.1"
REQUEST_S: Final = 5.0
"""longest time from the connection, or the first byte of a further request, to the end of its headers [s]"""
MAX_HEAD_BYTES: Final = 16 << 10
MAX_STRANGERS: Final = 32
"""connections without a valid cookie; beyond it the oldest of them is closed"""


class PatientProtocol(H11Protocol):
    """HTTP connection that is closed if a request's headers do not come in time.

    Connections that have shown no valid cookie make room for others: any program on this computer can open
    connections, and none may keep the operator's browser from stopping the striker.
    """

    _deadline: asyncio.TimerHandle | None = None
    _began_s: float = 0.0

    @property
    def is_stranger(self) -> bool:
        """True until a request has shown a valid cookie."""
        scope: Any = self.scope
        return not (scope or {}).get(KNOWN, False)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Take a connection; close the oldest connection of a stranger if there are many."""
        super().connection_made(transport)  # pyright: ignore[reportArgumentType]
        self._began_s = self.loop.time()
        ours = [each for each in self.connections if isinstance(each, PatientProtocol)]
        strangers = [each for each in ours if each.is_stranger]
        if len(strangers) > MAX_STRANGERS:
            min(strangers, key=lambda each: each._began_s)._hang_up()
        self._set_deadline()

    def data_received(self, data: bytes) -> None:
        """Read; wait for the rest of a request at most REQUEST_S."""
        super().data_received(data)
        if self.cycle is None or self.cycle.response_complete:
            self._set_deadline()
        else:
            self._clear_deadline()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._clear_deadline()
        super().connection_lost(exc)

    def _set_deadline(self) -> None:
        if self._deadline is None:
            self._deadline = self.loop.call_later(REQUEST_S, self._expire)

    def _clear_deadline(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _expire(self) -> None:
        self._deadline = None
        if self.cycle is None or self.cycle.response_complete:
            self._hang_up()

    def _hang_up(self) -> None:
        if not self.transport.is_closing():
            self.transport.abort()


def listen(port: int) -> socket.socket:
    """Listening socket on the loopback interface.

    Args:
        port: port; 0 for one that is free.

    Raises:
        AcquireError: the port is taken.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
    except OSError as error:
        listener.close()
        raise AcquireError(
            f"port {port} of {HOST} cannot be used ({error.strerror}): another console may run; give --port"
        ) from None
    listener.listen(128)
    return listener


class WebServer:
    """Server of an ASGI application on a listening socket.

    Args:
        app: the application.
        listener: listening socket; closed at the end.
        ended: set when `end` is called, before requests that still run are given up.
    """

    def __init__(self, app: Any, listener: socket.socket, ended: threading.Event) -> None:
        self._listener, self._ended = listener, ended
        self._server = uvicorn.Server(
            uvicorn.Config(
                app,
                http=PatientProtocol,
                ws="none",
                lifespan="off",
                log_level="critical",
                access_log=False,
                server_header=False,
                proxy_headers=False,
                date_header=False,
                timeout_keep_alive=20,
                timeout_graceful_shutdown=2,
                h11_max_incomplete_event_size=MAX_HEAD_BYTES,
            )
        )

    def run(self) -> None:
        """Serve until `end` is called."""
        with contextlib.closing(self._listener):
            asyncio.run(self._server._serve([self._listener]))

    def end(self, *_: object) -> None:
        """Make `run` return soon; any thread and a signal handler may call it."""
        self._ended.set()
        self._server.should_exit = True

    @property
    def started(self) -> bool:
        """True once requests are served."""
        return self._server.started


@contextlib.contextmanager
def ended_by_signals(end: Callable[..., None]) -> Iterator[None]:
    """Call `end` on Ctrl-C, SIGTERM and SIGHUP during the block."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, end) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
