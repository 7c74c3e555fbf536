"""Strike sequence of strikers with a device: calls, stop, arming and idle thread around its motions."""

from __future__ import annotations

import threading
from abc import abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

from acquire.errors import StrikerError, StrikerRefused, StrikerStopped
from acquire.striker.base import EventSink, StrikeOutcome, Striker, StrikerState
from acquire.striker.states import StrikerStatus, advance, arming_expired, unhomed_status
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Callable

    from acquire.striker.bus import MonotonicClock
    from schemas.rig import StrikerConfig

_Event = pb.StrikerEvent


class DeviceStriker(Striker):
    """Striker with a device on a port: what all of them do alike.

    Order of calls: open, home, then arm, cock and strike for each strike, close. Blocking calls may come from
    one thread at a time; `stop`, `close` and `state` from any. While no call runs, an idle thread attends to
    the device. Calls, stop and idle thread share one lock.

    Args:
        config: section `striker` of the rig file.
        event_sink: called with the events of a strike: homed, armed, released, contact and so on.
        clock: host monotonic time.
    """

    idle_s: ClassVar[float]
    """interval at which the idle thread attends to the device [s]"""
    speed_remedy: ClassVar[str]
    """what to change in the rig file where a tip speed is refused"""

    def __init__(self, config: StrikerConfig, event_sink: EventSink, clock: MonotonicClock) -> None:
        self._config, self._event_sink, self._clock = config, event_sink, clock
        self._status = StrikerStatus(StrikerState.DISARMED, clock.monotonic_ns())
        self._strike_id = ""
        self._fault_text = ""
        self._stop_requested = False  # a plain flag: a signal handler may do no more than set it
        self._call_lock = threading.Lock()  # not re-entrant: a signal handler must not enter during a call
        self._closing = threading.Event()
        self._idle: threading.Thread | None = None

    @property
    def state(self) -> StrikerState:
        """Current state of the striker, e.g. DISARMED, HOMED, ARMED or FAULT."""
        return self._status.state

    # --- calls

    def open(self) -> None:
        """Open the port, find the device and set it up, and start the idle thread.

        Raises:
            StrikerNotFound: no such port, port in use, or no suitable device on it.
            StrikerError: the device refuses a setting, or does not answer.
        """
        with self._call_lock:
            self._open_device()
            self._closing.clear()
            self._idle = threading.Thread(target=self._attend_idle, name="striker-idle", daemon=True)
            self._idle.start()

    def close(self) -> None:
        """End a running call and the idle thread, make the device safe and release the port. Always safe.

        The state is DISARMED and not homed afterwards.
        """
        self._stop_requested = True  # ends a call that runs in another thread
        self._closing.set()
        self._interrupt()
        idle, self._idle = self._idle, None
        if idle is not None and idle is not threading.current_thread():
            idle.join()
        with self._call_lock:
            self._close_device()
            self._status = unhomed_status(self._clock.monotonic_ns())
            self._stop_requested = False

    def stop(self) -> None:
        """Request an immediate stop: motion ends, and no strike is allowed any longer.

        Never blocks. A call that moves the arm in another thread ends, and raises StrikerStopped.
        """
        self._stop_requested = True
        self._interrupt()
        if self._call_lock.acquire(blocking=False):
            try:
                self._consume_stop()
            finally:
                self._call_lock.release()

    def home(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Clear a fault and go to state HOMED; a port that was lost is opened again.

        Args:
            stopped: function that returns True if a stop was requested after this homing was ordered; called
                after the stop requests received so far were cleared.

        Raises:
            StrikerStopped: a stop was requested after this homing was ordered, or while the arm moves.
            StrikerError: the device is not found, does not answer, is in a fault again, or the arm does not
                come to rest; the state is FAULT then.
        """
        with self._call_lock:
            self._consume_stop()
            if stopped():
                raise StrikerStopped
            if self._status.state not in {StrikerState.FAULT, StrikerState.HOMED, StrikerState.DISARMED}:
                self._enter(StrikerState.DISARMED)
            self._run_guarded(self._home)
            self._enter(StrikerState.HOMED, _Event.HOMED)

    def arm(self) -> None:
        """Allow one strike, for the time `arming_expires_s` of the rig file. The state is ARMED afterwards.

        Raises:
            StrikerRefused: not homed, or a strike is allowed or running already.
            StrikerError: the device is in a fault, refuses or does not answer; the state is FAULT then.
        """
        with self._call_lock:
            self._consume_stop()
            self._disarm_if_expired()
            advance(self._status, StrikerState.ARMED, self._clock.monotonic_ns())
            self._run_guarded(self._arm)
            self._enter(StrikerState.ARMED, _Event.ARMED)

    def cock(self) -> None:
        """Draw the striker back and wait until it rests there. The state is SETTLED afterwards.

        Raises:
            StrikerRefused: not armed, or the arming expired.
            StrikerStopped: a stop was requested; it is a StrikerRefused.
            StrikerError: the device is in a fault, refuses or does not answer, or the striker is not drawn
                back in time; the state is FAULT then.
        """
        with self._call_lock:
            self._consume_stop()
            self._disarm_if_expired()
            self._enter(StrikerState.COCKING)
            self._run_guarded(self._cock)
            self._enter(StrikerState.SETTLED, _Event.COCKED)

    def strike(self, strike_id: str, tip_speed_m_s: float) -> StrikeOutcome:
        """Strike once, count the contacts, and disarm; return what the device measured.

        Args:
            strike_id: id of the strike in the events.
            tip_speed_m_s: tip speed to order [m/s].

        Returns:
            Contact time (host monotonic) [ns], tip speed before contact [m/s], impulse [N s] and number of
            contacts; None where they were not measured. Speed 0 without a contact time: it met nothing.

        Raises:
            StrikerRefused: not armed, not drawn back, the arming expired, or the speed is outside the limits.
            StrikerStopped: a stop was requested; it is a StrikerRefused.
            StrikerError: the device is in a fault, refuses or does not answer, or the arm does not come to
                rest; the state is FAULT then, and the device is safe if it can be reached.
        """
        with self._call_lock:
            self._consume_stop()
            self._disarm_if_expired()
            advance(self._status, StrikerState.RELEASED, self._clock.monotonic_ns())
            # Compared as tip speed, like the plan's limits, so that rounding never makes a planned speed a
            # refused one.
            if problem := self._config.tip_speeds().problem(tip_speed_m_s):
                raise StrikerRefused(f"{problem}; change {self.speed_remedy} in the rig file")
            self._strike_id = strike_id
            outcome: StrikeOutcome = self._run_guarded(lambda: self._strike(tip_speed_m_s))
            return outcome

    # --- what a device does

    @abstractmethod
    def _open_device(self) -> None: ...

    @abstractmethod
    def _close_device(self) -> None:
        """Make the device safe and release its port; it may be closed already. Raises nothing."""

    def _interrupt(self) -> None:
        """Make the device safe at once, from any thread, while a call may run; nothing by default."""

    @abstractmethod
    def _home(self) -> None: ...

    @abstractmethod
    def _arm(self) -> None: ...

    @abstractmethod
    def _cock(self) -> None: ...

    @abstractmethod
    def _strike(self, tip_speed_m_s: float) -> StrikeOutcome:
        """Carry out the strike, from state SETTLED to DISARMED, with its events."""

    @abstractmethod
    def _run_guarded(self, action: Callable[[], Any]) -> Any:
        """Call `action` and return its result; make the device safe after a stop or an error.

        Raises:
            StrikerStopped: a stop was requested during the action.
            StrikerRefused: raised by the action; nothing else happens.
            StrikerError: raised by the action; the state is FAULT.
        """

    @abstractmethod
    def _secure(self, error: StrikerError) -> None:
        """Make the device safe after an error. Raises nothing."""

    def _end_permission(self) -> None:
        """Tell the device that no strike is allowed any longer; nothing by default."""

    @abstractmethod
    def _attend(self) -> None:
        """Read the device while no call runs.

        Raises:
            StrikerError: it failed; the state becomes FAULT.
        """

    # --- states

    def _emit(self, kind: _Event.Kind, **fields: Any) -> None:
        fields.setdefault("host_time_ns", self._clock.monotonic_ns())
        self._event_sink(_Event(kind=kind, strike_id=self._strike_id, **fields))

    def _enter(self, state: StrikerState, kind: _Event.Kind | None = None) -> None:
        now_ns = self._clock.monotonic_ns()
        self._status = advance(self._status, state, now_ns)
        if kind is not None:
            self._emit(kind, host_time_ns=now_ns)
        if state is StrikerState.DISARMED:
            self._strike_id = ""

    def _consume_stop(self) -> None:
        """Clear a stop that was requested while nothing moved, and report it as an event.

        A strike is no longer allowed then, and the arm stays where it is. Without a request nothing happens.
        """
        if not self._stop_requested:
            return
        self._stop_requested = False
        self._emit(_Event.STOPPED)
        self._disarm()

    def _disarm_if_expired(self) -> None:
        if arming_expired(self._status, self._clock.monotonic_ns(), self._config.arming_expires_s):
            self._disarm()

    def _disarm(self) -> None:
        """End a permission to strike, here and at the device; without one nothing happens."""
        if self._status.armed_ns is None:
            return
        self._enter(StrikerState.DISARMED, _Event.DISARMED)
        try:
            self._end_permission()
        except StrikerError as error:
            self._enter_fault(error)

    def _enter_fault(self, error: StrikerError) -> None:
        """Make the device safe and go to state FAULT; the same fault again is not announced twice."""
        again = self._status.state is StrikerState.FAULT and str(error) == self._fault_text
        self._fault_text = str(error)
        self._status = advance(self._status, StrikerState.FAULT, self._clock.monotonic_ns())
        self._secure(error)
        if not again:
            self._emit(_Event.FAULT, text=str(error))

    def _attend_idle(self) -> None:
        """Run the idle thread, until the striker is closed; a device that fails puts it into state FAULT."""
        while not self._closing.wait(self.idle_s):
            if not self._call_lock.acquire(blocking=False):
                continue
            try:
                self._consume_stop()
                self._disarm_if_expired()
                self._attend()
            except StrikerError as error:
                self._enter_fault(error)
            finally:
                self._call_lock.release()
