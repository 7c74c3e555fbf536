"""Notifications to the service manager (systemd, Type=notify): sd_notify(3), one datagram each.

Without NOTIFY_SOCKET in the environment nothing is sent. Datagrams that cannot be delivered are dropped.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Callable, Iterator, Mapping, MutableMapping


class ServiceManager:
    """Service manager (systemd) that started this process, to which notifications are sent.

    Args:
        environment: NOTIFY_SOCKET, the service manager's address; WATCHDOG_USEC and WATCHDOG_PID, its
            watchdog time [us] and the process that it watches. Each may be missing.
        pid: id of this process.
        monotonic_ns: function that returns the host monotonic time [ns].
    """

    def __init__(self, environment: Mapping[str, str], pid: int, monotonic_ns: Callable[[], int]) -> None:
        self._address = environment.get("NOTIFY_SOCKET", "")
        self._now_ns = monotonic_ns
        patience_us = environment.get("WATCHDOG_USEC", "")
        watched = patience_us.isdecimal() and environment.get("WATCHDOG_PID", str(pid)) == str(pid)
        # Four keep-alives in the watchdog time: one that is lost or late has no effect.
        self._interval_ns = int(patience_us) * 250 if watched else None
        self._next_ns = 0

    @classmethod
    def from_environment(cls, environment: MutableMapping[str, str] = os.environ) -> ServiceManager:
        """Service manager of this process, from the environment variables that it set.

        These (NOTIFY_SOCKET, WATCHDOG_USEC, WATCHDOG_PID) are removed from `environment`, so that child
        processes send no notifications for the daemon.
        """
        manager = cls(environment, os.getpid(), time.monotonic_ns)
        for name in ("NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"):
            environment.pop(name, None)
        return manager

    @contextlib.contextmanager
    def running(self, status: str) -> Iterator[Callable[[], None]]:
        """Context manager that notifies the service manager READY on entry and STOPPING on exit.

        Args:
            status: line that the service manager shows while the process runs.

        Yields:
            Function that notifies the watchdog that the process is alive; call it often while it is healthy.
        """
        self._send(f"READY=1\nSTATUS={status}")
        try:
            yield self._keep_alive
        finally:
            self._send("STOPPING=1\nSTATUS=finishing the recording, releasing the devices")

    def _keep_alive(self) -> None:
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
