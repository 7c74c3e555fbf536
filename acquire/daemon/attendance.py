"""Holds: reasons for which a session must not arm the striker again until a person goes on.

A console attends a session: it renews its lease twice a second, and states whether the operator's browser is
connected. If the browser is lost, or the console is killed, nobody may be beside the stop button: the daemon
holds. A hold never interrupts a swing; the session asks before it arms, and waits.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from acquire.daemon.server import Connection
from acquire.errors import SessionError, StrikerStopped

LEASE_S: Final = 2.0
"""time without a renewal after which an attending console counts as lost [s]"""
_LOOK_S: Final = 0.2
"""interval at which a waiting session's connection is checked [s]"""
CONSOLE_LOST: Final = "the operator's console was lost"
BROWSER_LOST: Final = "the operator's browser was lost"


@dataclass
class _Lease:
    """Attendance of one console."""

    renewed_s: float
    present: bool


class Attendance:
    """Consoles that attend a session, and the holds that pause it before its next arming.

    Args:
        publish: function that sends an event (name, data) to all clients that subscribed to events.
        stopped: function that returns True while the striker is stopped on request.
        monotonic_s: function that returns a monotonic time [s].
    """

    def __init__(
        self,
        publish: Callable[[str, dict[str, Any]], None],
        stopped: Callable[[], bool],
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._publish, self._stopped, self._monotonic_s = publish, stopped, monotonic_s
        self._changed = threading.Condition(threading.RLock())
        self._leases: dict[Connection, _Lease] = {}
        self._reason = ""
        """reason of the hold; empty if there is none"""
        self._after_strike = ""
        """reason of a hold that begins when the present strike is recorded; empty if there is none"""
        self._closed = False

    @property
    def attended(self) -> bool:
        """True while a console attends."""
        return bool(self._leases)

    # --- requests ---

    def attend(self, connection: Connection, params: dict[str, Any]) -> dict[str, Any]:
        """Attend, or renew it; hold if the operator's browser is lost.

        Args:
            connection: the console.
            params: `present`, false if the operator's browser is lost.

        Returns:
            The hold, as `status`.
        """
        present = bool(params.get("present", True))
        with self._changed:
            if connection not in self._leases:
                connection.on_close.append(lambda: self._lost(connection))
            self._leases[connection] = _Lease(self._monotonic_s(), present)
            if not present and not any(lease.present for lease in self._leases.values()):
                self._hold(BROWSER_LOST)
        return self.status()

    def leave(self, connection: Connection, _: dict[str, Any]) -> dict[str, Any]:
        """End the attendance of a console that ends in order; nothing is held for it afterwards."""
        with self._changed:
            self._leases.pop(connection, None)
        return self.status()

    def hold(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        """Hold on a person's order.

        Args:
            params: `text`, the reason; `when`, "now" (before the next arming) or "after_strike" (once the
                strike that is being prepared has been recorded).

        Raises:
            SessionError: `when` is neither.
        """
        text, when = str(params.get("text", "paused by the operator")), params.get("when", "now")
        if when not in {"now", "after_strike"}:
            raise SessionError(f'"when" is "now" or "after_strike", not {when!r}')
        with self._changed:
            if when == "after_strike":
                self._after_strike = text
                self._announce()
            else:
                self._hold(text)
        return self.status()

    def release(self, *_: object) -> dict[str, Any]:
        """Release every hold on a person's order.

        Raises:
            SessionError: the consoles that attend have lost the operator's browser.
        """
        with self._changed:
            if self._leases and not any(lease.present for lease in self._leases.values()):
                raise SessionError("no browser of an operator is connected: the session stays paused")
            self._reason = self._after_strike = ""
            self._announce()
        return self.status()

    def status(self, *_: object) -> dict[str, Any]:
        """Hold in force: `held`, `text` (its reason), `later` (reason of one after the present strike)."""
        with self._changed:
            return {"held": bool(self._reason), "text": self._reason, "later": self._after_strike}

    def wait(self, connection: Connection, _: dict[str, Any]) -> dict[str, Any]:
        """Wait until there is no hold.

        Returns:
            The hold, as `status`.

        Raises:
            StrikerStopped: the striker was stopped meanwhile.
            SessionError: the daemon stops, or the client has gone.
        """
        with self._changed:
            while self._reason:
                if self._closed or connection.gone:
                    raise SessionError("the pause ended: the daemon is stopping, or the session has left")
                if self._stopped():
                    raise StrikerStopped
                self._changed.wait(_LOOK_S)
        return self.status()

    # --- from the daemon ---

    def begin_session(self) -> None:
        """Release all holds: a person starts a session."""
        with self._changed:
            self._reason = self._after_strike = ""
            self._announce()

    def note_strike(self) -> None:
        """Note that a strike was recorded: a hold "after_strike" is in force from now on."""
        with self._changed:
            if self._after_strike:
                self._hold(self._after_strike)

    def supervise(self) -> None:
        """Hold if a console has not renewed its lease; called ten times a second."""
        now_s = self._monotonic_s()
        with self._changed:
            late = [each for each, lease in self._leases.items() if now_s - lease.renewed_s > LEASE_S]
            for connection in late:
                self._lost(connection)

    def close(self) -> None:
        """Let no session wait any longer."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _lost(self, connection: Connection) -> None:
        with self._changed:
            lease = self._leases.pop(connection, None)
            if lease is not None and not any(each.present for each in self._leases.values()):
                self._hold(CONSOLE_LOST)

    def _hold(self, reason: str) -> None:
        if not self._reason:
            self._reason, self._after_strike = reason, ""
            self._announce()

    def _announce(self) -> None:
        self._changed.notify_all()
        self._publish("hold", self.status())
