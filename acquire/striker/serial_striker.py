"""Striker that a microcontroller fires (solenoid, pendulum on a magnet, spring), over a line protocol.

The board keeps the interlocks that must hold without this host: it permits one strike per arming, disarms
itself when the host's requests stop or the arming expires, and limits the time for which it drives. The
protocol is in docs/reference/striker-protocol.md.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from typing import TYPE_CHECKING, Any

from acquire.errors import StrikerError, StrikerFault, StrikerLost, StrikerRefused, StrikerStopped
from acquire.striker.base import ClockSink, EventSink, SampleSink, StrikeOutcome, Striker, StrikerState
from acquire.striker.board_clock import BoardClock
from acquire.striker.board_lines import BoardIdentity, BoardState
from acquire.striker.board_link import BoardLink
from acquire.striker.board_outcome import board_outcome, wait_for_contacts
from acquire.striker.board_problem import refuse_fault, refuse_other_speeds, refuse_unarmed
from acquire.striker.states import GUARD_S, StrikerStatus, advance, arming_expired, unhomed_status
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Callable

    from acquire.clock.reading import ClockReading
    from acquire.striker.bus import MonotonicClock
    from schemas.rig import StrikerConfig

BEAT_S = 0.05
"""interval between requests while a strike is allowed [s]; the board disarms itself after 0.4 s without"""
LOADING_POLL_S = 0.02
"""interval between requests while the striker is being drawn back [s]"""
IDLE_NS = 500_000_000
"""interval between readings of the board's clock while no strike is allowed [ns]"""
CLOCK_READINGS = 8
"""number of readings of the board's clock before and after a strike"""
_Event = pb.StrikerEvent


class SerialStriker(Striker):
    """Striker that a microcontroller on a serial port fires.

    Blocking calls may come from one thread at a time; `stop`, `close` and `state` from any. While no call
    runs, an idle thread sends the board the signs of life without which it disarms itself.

    Args:
        config: section `striker` of the rig file.
        sample_sink: never called, because the board has no encoder.
        event_sink: called with the events of a strike: homed, armed, released, contact and so on.
        clock_sink: called with readings of the board's clock. Neither it nor `event_sink` may block for long.
        clock: host monotonic time.
    """

    def __init__(
        self,
        config: StrikerConfig,
        sample_sink: SampleSink,  # noqa: ARG002 - the constructor is the same for every striker
        event_sink: EventSink,
        clock_sink: ClockSink,
        clock: MonotonicClock,
    ) -> None:
        self._config, self._event_sink, self._clock = config, event_sink, clock
        self._link = BoardLink(config.port, config.baud_rate, clock)
        self._board_clock = BoardClock(clock_sink)
        self._identity: BoardIdentity | None = None
        self._status = StrikerStatus(StrikerState.DISARMED, clock.monotonic_ns())
        self._strike_id = ""
        self._fault_text = ""
        self._stop_requested = False  # a plain flag: a signal handler may do no more than set it
        self._call_lock = threading.Lock()
        self._closing = threading.Event()
        self._idle: threading.Thread | None = None
        self._idle_read_ns = 0

    @property
    def state(self) -> StrikerState:
        """Current state of the striker, e.g. DISARMED, HOMED, ARMED or FAULT."""
        return self._status.state

    # --- open and close

    def open(self) -> None:
        """Open the port, identify the board and start the idle thread.

        Raises:
            StrikerNotFound: no such port, port in use, or no board of this protocol on it.
            StrikerError: the board cannot fire at the speeds in the rig file, or does not answer.
        """
        with self._call_lock:
            self._connect()
            self._closing.clear()
            self._idle = threading.Thread(target=self._keep_alive, name="striker-beat", daemon=True)
            self._idle.start()

    def _connect(self) -> None:
        identity = self._link.open()
        try:
            refuse_other_speeds(self._config, identity)
            self._link.status("stop")
        except StrikerError:
            self._link.close()
            raise
        self._identity = identity
        self._board_clock.restart()

    def close(self) -> None:
        """End a running call and the idle thread, make the board safe and release the port. Always safe.

        The state is DISARMED and not homed afterwards.
        """
        self._stop_requested = True  # ends a call that runs in another thread
        self._closing.set()
        self._link.send_stop()
        idle, self._idle = self._idle, None
        if idle is not None and idle is not threading.current_thread():
            idle.join()
        with self._call_lock:
            if self._link.is_open:
                with contextlib.suppress(StrikerError):
                    self._link.status("stop")
                self._link.close()
            self._status = unhomed_status(self._clock.monotonic_ns())
            self._stop_requested = False

    def stop(self) -> None:
        """Order the board to switch its drive off and to disarm; no strike is allowed any longer.

        Never blocks. The order is sent at once, also during a strike, whose call then raises StrikerStopped.
        """
        self._stop_requested = True
        self._link.send_stop()
        if self._call_lock.acquire(blocking=False):
            try:
                self._consume_stop()
            finally:
                self._call_lock.release()

    # --- strike sequence

    def home(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Make the board safe, and go to state HOMED; a port that was lost is opened again. Nothing moves.

        Args:
            stopped: function that returns True if a stop was requested after this homing was ordered; called
                after the stop requests received so far were cleared.

        Raises:
            StrikerStopped: `stopped` returned True.
            StrikerError: the board is not found, does not answer or is in a fault; the state is FAULT then.
        """
        with self._call_lock:
            self._consume_stop()
            if stopped():
                raise StrikerStopped
            if self._status.state not in {StrikerState.FAULT, StrikerState.HOMED, StrikerState.DISARMED}:
                self._enter(StrikerState.DISARMED)
            self._run_guarded(self._home)

    def _home(self) -> None:
        if self._status.state is StrikerState.FAULT:
            self._link.close()
        if not self._link.is_open:
            self._connect()
        refuse_fault(self._config.port, self._link.status("stop"))
        self._enter(StrikerState.HOMED, _Event.HOMED)

    def arm(self) -> None:
        """Allow one strike, for the time `arming_expires_s` of the rig file. The state is ARMED afterwards.

        Raises:
            StrikerRefused: not homed, or a strike is allowed or running already.
            StrikerError: the board refuses or does not answer; the state is FAULT then.
        """
        with self._call_lock:
            self._consume_stop()
            self._disarm_if_expired()
            advance(self._status, StrikerState.ARMED, self._clock.monotonic_ns())
            self._run_guarded(self._arm)
            self._enter(StrikerState.ARMED, _Event.ARMED)

    def _arm(self) -> None:
        status = self._link.status("arm", round(1000 * self._config.arming_expires_s))
        refuse_unarmed(self._config.port, status)

    def cock(self) -> None:
        """Wait until the board reports the striker drawn back. The state is SETTLED afterwards.

        Raises:
            StrikerRefused: not armed, or the arming expired.
            StrikerStopped: a stop was requested; it is a StrikerRefused.
            StrikerError: the striker is not drawn back within 5 s, or the board does not answer, has disarmed
                itself or is in a fault; the state is FAULT then.
        """
        with self._call_lock:
            self._consume_stop()
            self._disarm_if_expired()
            self._enter(StrikerState.COCKING)
            self._run_guarded(self._cock)

    def _cock(self) -> None:
        end_ns = self._clock.monotonic_ns() + round(GUARD_S[StrikerState.COCKING] * 1e9)
        while self._poll() is not BoardState.ARMED:
            if self._clock.monotonic_ns() > end_ns:
                raise StrikerFault(
                    f"{self._config.port}: the striker is not drawn back; draw it back before you "
                    "confirm that the object is in place"
                )
            time.sleep(LOADING_POLL_S)
        self._enter(StrikerState.SETTLED, _Event.COCKED)

    def strike(self, strike_id: str, tip_speed_m_s: float) -> StrikeOutcome:
        """Fire once, wait for the contact, count the contacts, and disarm; return what the board measured.

        Args:
            strike_id: id of the strike in the events.
            tip_speed_m_s: tip speed to order [m/s].

        Returns:
            Time of firing, and contact time and tip speed where the board measures them; a board that senses
            contacts and felt none gives speed 0. The impulse is None.

        Raises:
            StrikerRefused: not armed, not drawn back, the arming expired, or the speed is outside the limits.
            StrikerStopped: a stop was requested; it is a StrikerRefused.
            StrikerError: the board does not answer, has disarmed itself or is in a fault; the state is FAULT
                then.
        """
        with self._call_lock:
            self._consume_stop()
            self._disarm_if_expired()
            advance(self._status, StrikerState.RELEASED, self._clock.monotonic_ns())
            if problem := self._config.tip_speeds().problem(tip_speed_m_s):
                raise StrikerRefused(f"{problem}; change speed_range_m_s in the rig file")
            self._strike_id = strike_id
            outcome: StrikeOutcome = self._run_guarded(lambda: self._strike(round(1000 * tip_speed_m_s)))
            return outcome

    def _strike(self, speed_mm_s: int) -> StrikeOutcome:
        readings = self._read_clock()
        if self._stop_requested:
            raise StrikerStopped
        self._enter(StrikerState.RELEASED)
        before_ns = self._clock.monotonic_ns()
        status = self._link.fire(speed_mm_s)
        after_ns = self._clock.monotonic_ns()
        if status.state in {BoardState.ARMED, BoardState.LOADING}:
            raise StrikerLost(f"{self._config.port}: the order to fire was lost; check the board's cable")
        refuse_fault(self._config.port, status)
        if self._stop_requested:
            raise StrikerStopped
        fired_ns = (before_ns + after_ns) // 2
        self._emit(_Event.RELEASED, host_time_ns=fired_ns, time_sd_ns=(after_ns - before_ns) / math.sqrt(12))
        status = wait_for_contacts(self._link, self._clock, lambda: self._stop_requested)
        readings += self._read_clock()
        refuse_fault(self._config.port, self._link.status("stop"))
        assert self._identity is not None  # noqa: S101 - set when the port was opened
        outcome = board_outcome(
            self._identity, status, self._board_clock, readings, fired_ns, self._config.contact_sd_s
        )
        self._announce(outcome)
        return outcome

    def _announce(self, outcome: StrikeOutcome) -> None:
        """Report contact or miss as far as the board measured it, and go to state DISARMED."""
        if outcome.contact_time_ns is not None:
            self._emit(
                _Event.CONTACT,
                host_time_ns=outcome.contact_time_ns,
                time_sd_ns=outcome.contact_time_sd_ns,
                tip_speed_m_s=outcome.tip_speed_m_s or 0.0,
                tip_speed_sd_m_s=outcome.tip_speed_sd_m_s,
            )
        elif outcome.missed:
            self._emit(
                _Event.MISSED, text="the board felt no contact; check that the striker reaches the object"
            )
        if outcome.contacts == 1:
            self._emit(_Event.VERIFIED)
        self._enter(StrikerState.DISARMED, _Event.DISARMED)

    def _read_clock(self) -> list[ClockReading]:
        return [self._board_clock.observe(*self._link.read_time()) for _ in range(CLOCK_READINGS)]

    # --- states

    def _poll(self) -> BoardState:
        """State of the armed board.

        Raises:
            StrikerStopped: a stop was requested.
            StrikerError: the board does not answer, has disarmed itself or is in a fault.
        """
        status = self._link.status("state")
        if self._stop_requested:
            raise StrikerStopped
        refuse_unarmed(self._config.port, status)
        return status.state

    def _emit(self, kind: _Event.Kind, **fields: Any) -> None:
        fields.setdefault("host_time_ns", self._clock.monotonic_ns())
        self._event_sink(_Event(kind=kind, strike_id=self._strike_id, **fields))

    def _enter(self, state: StrikerState, kind: _Event.Kind | None = None) -> None:
        self._status = advance(self._status, state, self._clock.monotonic_ns())
        if kind is not None:
            self._emit(kind)
        if state is StrikerState.DISARMED:
            self._strike_id = ""

    def _run_guarded(self, action: Callable[[], Any]) -> Any:
        """Call `action` and return its result; make the board safe after a stop or an error.

        Raises:
            StrikerStopped: a stop was requested during the action; the state is DISARMED, or FAULT if the
                board does not confirm.
            StrikerError: raised by the action; the state is FAULT.
        """
        try:
            return action()
        except StrikerError as error:
            if self._stop_requested:  # whatever the board replied after it was stopped
                self._make_safe()
                raise StrikerStopped from None
            if not isinstance(error, StrikerRefused):
                self._enter_fault(error)
            raise

    def _make_safe(self) -> None:
        """Make the board safe after a stop, which is cleared and reported; the state is then unhomed."""
        self._stop_requested = False
        try:
            refuse_fault(self._config.port, self._link.status("stop"))
        except StrikerError as error:
            self._enter_fault(error)
        else:
            self._status = unhomed_status(self._clock.monotonic_ns())
        self._emit(_Event.STOPPED)

    def _enter_fault(self, error: StrikerError) -> None:
        if self._status.state is not StrikerState.FAULT or self._fault_text != str(error):
            self._emit(_Event.FAULT, text=str(error))
        self._fault_text = str(error)
        self._status = advance(self._status, StrikerState.FAULT, self._clock.monotonic_ns())
        self._link.send_stop()

    def _consume_stop(self) -> None:
        """Clear a stop that was requested while no call ran, report it, and end a permission to strike."""
        if not self._stop_requested:
            return
        self._stop_requested = False
        self._emit(_Event.STOPPED)
        self._disarm()

    def _disarm_if_expired(self) -> None:
        if arming_expired(self._status, self._clock.monotonic_ns(), self._config.arming_expires_s):
            self._disarm()

    def _disarm(self) -> None:
        """End a permission to strike, here and on the board; without one nothing happens."""
        if self._status.armed_ns is None:
            return
        self._enter(StrikerState.DISARMED, _Event.DISARMED)
        try:
            self._link.status("stop")
        except StrikerError as error:
            self._enter_fault(error)

    # --- idle thread

    def _keep_alive(self) -> None:
        while not self._closing.wait(BEAT_S):
            if self._call_lock.acquire(blocking=False):
                try:
                    self._attend()
                except StrikerError as error:
                    self._enter_fault(error)
                finally:
                    self._call_lock.release()

    def _attend(self) -> None:
        """Send the sign of life that an armed board needs; otherwise read its clock twice a second."""
        self._consume_stop()
        self._disarm_if_expired()
        if self._status.state is StrikerState.FAULT or not self._link.is_open:
            return
        now_ns = self._clock.monotonic_ns()
        if self._status.armed_ns is not None:
            with contextlib.suppress(StrikerStopped):  # it is consumed at the next turn
                self._poll()
        elif now_ns - self._idle_read_ns >= IDLE_NS:
            self._idle_read_ns = now_ns
            self._board_clock.observe(*self._link.read_time())
