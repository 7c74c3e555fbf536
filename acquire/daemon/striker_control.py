"""Orders to the striker, one at a time; after a stop nothing moves until a person starts again."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from acquire.errors import StrikerRefused, StrikerStopped
from acquire.striker.base import Striker


class StrikerControl:
    """Interlock between the daemon's clients and the striker, the arm that strikes the object.

    After a stop request nothing moves until a person starts again. `stop` never waits for another order. Each
    order returns `{"state": name}`, the striker's state afterwards, unless stated otherwise.

    Args:
        striker: the striker that carries out the orders.
        require_space: function that raises RecorderError if the disk has no room to record a strike.

    Raises:
        StrikerStopped: from an order to move, after a stop request.
        StrikerRefused: from an order to move, after `release`, or if the striker's state forbids it.
        StrikerError: the striker failed.
    """

    def __init__(self, striker: Striker, require_space: Callable[[], None]) -> None:
        self.striker = striker
        self._require_space = require_space
        self._lock = threading.Lock()
        self.stops = 0
        """number of stop requests"""
        self._stops_cleared = 0
        """number of them after which a person started again; while there are later ones nothing moves"""
        self._fault = ""
        """reason of the striker's fault; empty if there is none"""
        self._released = False

    @property
    def trouble(self) -> str:
        """Reason why the striker refuses to move, a stop request or a fault; empty if there is none."""
        return "stopped on request" if self.stopped else self._fault

    def note_fault(self, reason: str) -> None:
        """Remember the reason of a striker's fault, for `trouble`, until the striker is homed."""
        self._fault = reason

    def clear_stops(self, stops: int) -> None:
        """Permit motion again after a person's order, given when `stops` stop requests had been counted.

        Stop requests made since then still forbid motion.
        """
        self._stops_cleared = max(stops, self._stops_cleared)

    def home(self, params: dict[str, Any]) -> dict[str, Any]:
        """Home the arm (move it slowly to its raised angle) and permit motion again after a stop.

        Args:
            params: `after_stop`: True (default) if a person decided to home; a program that continues by
                itself passes False, and is refused after a stop. `stops_seen`: number of all stop requests
                when that person was asked (`stops` in the answer to `status`); if there are more by now, the
                arm is not homed. Without `stops_seen`, only a stop requested during this call counts.

        Returns:
            `{"state": name}`, the striker's state.

        Raises:
            StrikerStopped: a stop was requested since the person was asked; or, with `after_stop` False, at
                any time since a person last started.
            StrikerRefused: the daemon is stopping.
            StrikerError: the striker failed.
        """
        stops = int(params.get("stops_seen", self.stops))
        with self._lock:
            self._refuse_after_release()
            if self.stops != stops:
                raise StrikerStopped
            if not params.get("after_stop", True):
                self._refuse_when_stopped()
            self.striker.home(lambda: self.stops != stops)
            self.clear_stops(stops)
            self._fault = ""
        return self._state()

    def arm(self) -> dict[str, Any]:
        """Arm the striker for one strike, if the disk has room to record it.

        Returns:
            `{"state": name}`, the striker's state.

        Raises:
            RecorderError: the disk has no room for a strike.
            StrikerStopped: a stop was requested; the striker is not armed.
            StrikerRefused: the daemon is stopping, or the striker's state forbids it.
        """
        self._refuse_when_stopped()
        self._require_space()  # no strike without room to record it; waits for a restarting capture process
        with self._lock:
            self._refuse_when_stopped()
            self.striker.arm()
            if self.stopped:  # while the striker was armed
                self.striker.stop()
                raise StrikerStopped
        return self._state()

    def cock(self) -> dict[str, Any]:
        """Draw the arm back and return `{"state": name}`, the striker's state.

        Raises:
            StrikerStopped: a stop was requested.
            StrikerRefused: the daemon is stopping, the striker is not armed, or the arming expired.
            StrikerError: the striker failed.
        """
        with self._lock:
            self._refuse_when_stopped()
            self.striker.cock()
        return self._state()

    def strike(self, params: dict[str, Any]) -> dict[str, Any]:
        """Strike once with the armed and cocked striker.

        Args:
            params: `strike_id`, and `tip_speed_m_s`, the commanded speed of the arm's tip [m/s].

        Returns:
            Fields of StrikeOutcome: contact time [ns], speed of the arm's tip [m/s] and impulse [N s], each
            with 1 sigma; number of contacts; time at which the swing began [ns]. Times are host monotonic;
            contact time and impulse are None if not measured (a miss, a strike by hand).

        Raises:
            StrikerStopped: a stop was requested.
            StrikerRefused: another order is being carried out, the daemon is stopping, the striker is not
                armed and cocked, or the speed is outside the limits.
            StrikerError: the striker failed.
        """
        if not self._lock.acquire(timeout=0.1):
            raise StrikerRefused("the striker is busy with another order")
        try:
            self._refuse_when_stopped()
            outcome = self.striker.strike(str(params["strike_id"]), float(params["tip_speed_m_s"]))
        finally:
            self._lock.release()
        return asdict(outcome)

    def stop(self) -> dict[str, Any]:
        """Stop the striker, and refuse all motion until a person starts again.

        Returns:
            `{"state": name, "was": name}`, the striker's state, and the one in which the stop found it.
        """
        self.stops += 1  # first of all: every motion checks it before it starts
        was = self.striker.state.value
        self.striker.stop()
        return self._state() | {"was": was}

    def release(self) -> None:
        """Stop the striker, switch its torque off, and refuse all further orders that move it.

        An order that is being carried out is stopped, and waited for.
        """
        self._released = True
        while not self._lock.acquire(timeout=0.02):
            self.striker.stop()
        try:
            self.striker.close()
        finally:
            self._lock.release()

    @property
    def stopped(self) -> bool:
        """True while a stop request forbids motion."""
        return self.stops > self._stops_cleared

    def _refuse_when_stopped(self) -> None:
        self._refuse_after_release()
        if self.stopped:
            raise StrikerStopped

    def _refuse_after_release(self) -> None:
        if self._released:
            raise StrikerRefused("the daemon is stopping: the striker takes no more orders")

    def _state(self) -> dict[str, Any]:
        return {"state": self.striker.state.value}
