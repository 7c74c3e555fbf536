"""What a service manager wants to hear from the daemon (systemd, Type=notify): sd_notify(3), a datagram for each word.

Without NOTIFY_SOCKET in the environment nobody listens and nothing is sent. A manager that has gone away changes nothing either.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Callable, Iterator, Mapping, MutableMapping


class ServiceManager:
    """The manager that started this process.

    Args:
        environment: NOTIFY_SOCKET, where it listens; WATCHDOG_USEC and WATCHDOG_PID, whether and how often it wants a sign of life.
        pid: this process.
        monotonic_ns: host time.
    """

    def __init__(self, environment: Mapping[str, str], pid: int, monotonic_ns: Callable[[], int]) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        self._now_ns = monotonic_ns
        patience_us = environment.get("WATCHDOG_USEC", "")
        watched = patience_us.isdecimal() and environment.get("WATCHDOG_PID", str(pid)) == str(pid)
        # Four signs of life in the manager's patience: one lost or late changes nothing.
        self._interval_ns = int(patience_us) * 250 if watched else None
        self._next_ns = 0

    @classmethod
    def of_this_process(cls, environment: MutableMapping[str, str] = os.environ) -> ServiceManager:
        """The manager named in the environment, from which it is taken: children must not speak for the daemon."""
        manager = cls(environment, os.getpid(), time.monotonic_ns)
        for name in ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"):
            environment.pop(name, None)
        return manager

    @contextlib.contextmanager
    def serving(self, status: str) -> Iterator[Callable[[], None]]:
        """Says READY on the way in and STOPPING on the way out; what it gives is to be called while all is well, as often as you like."""
        self._send(f"READY=1\nSTATUS={status}")
        try:
            yield self._alive
        finally:
            self._send("STOPPING=1\nSTATUS=finishing the recording, releasing the devices")

    def _alive(self) -> None:
        if self._interval_ns is not None and (now_ns := self._now_ns()) >= self._next_ns:
            self._next_ns = now_ns + self._interval_ns
            self._send("WATCHDOG=1")

    def _send(self, text: str) -> None:
        if not self._address:
            return
        # "@" stands for the zero byte of an abstract socket's name.
        address = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.sendto(text.encode(), address)
