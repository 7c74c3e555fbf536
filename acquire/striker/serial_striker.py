"""Striker that a microcontroller fires (solenoid, pendulum on a magnet, spring), over a line protocol.

The board keeps the interlocks that must hold without this host: it permits one strike per arming, disarms
itself when the host's requests stop or the arming expires, and limits the time for which it drives. The
protocol is in docs/reference/striker-protocol.md.
"""

from __future__ import annotations

import contextlib
import math
import time
from typing import TYPE_CHECKING, Any

from acquire.errors import StrikerError, StrikerFault, StrikerLost, StrikerRefused, StrikerStopped
from acquire.striker.base import ClockSink, EventSink, SampleSink, StrikeOutcome, StrikerState
from acquire.striker.board_clock import BoardClock
from acquire.striker.board_lines import BoardIdentity, BoardState
from acquire.striker.board_link import BoardLink
from acquire.striker.board_outcome import board_outcome, wait_for_contacts
from acquire.striker.board_problem import refuse_fault, refuse_other_speeds, refuse_unarmed
from acquire.striker.sequence import DeviceStriker
from acquire.striker.states import GUARD_S, unhomed_status
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


class SerialStriker(DeviceStriker):
    """Striker that a microcontroller on a serial port fires.

    While no call runs, the idle thread sends the board the signs of life without which it disarms itself. A
    stop is sent at once, also during a strike. Where the board does not measure contacts, the outcome has no
    contact time; the impulse is always None.

    Args:
        config: section `striker` of the rig file.
        sample_sink: never called, because the board has no encoder.
        event_sink: called with the events of a strike: homed, armed, released, contact and so on.
        clock_sink: called with readings of the board's clock. Neither it nor `event_sink` may block for long.
        clock: host monotonic time.
    """

    idle_s = BEAT_S
    speed_remedy = "speed_range_m_s"

    def __init__(
        self,
        config: StrikerConfig,
        sample_sink: SampleSink,  # noqa: ARG002 - the constructor is the same for every striker
        event_sink: EventSink,
        clock_sink: ClockSink,
        clock: MonotonicClock,
    ) -> None:
        super().__init__(config, event_sink, clock)
        self._link = BoardLink(config.port, config.baud_rate, clock)
        self._board_clock = BoardClock(clock_sink)
        self._identity: BoardIdentity | None = None
        self._idle_read_ns = 0

    def _open_device(self) -> None:
        self._connect()

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

    def _close_device(self) -> None:
        if self._link.is_open:
            with contextlib.suppress(StrikerError):
                self._link.status("stop")
            self._link.close()

    def _interrupt(self) -> None:
        self._link.send_stop()

    # --- strike sequence

    def _home(self) -> None:
        if self._status.state is StrikerState.FAULT:
            self._link.close()
        if not self._link.is_open:
            self._connect()
        refuse_fault(self._config.port, self._link.status("stop"))

    def _arm(self) -> None:
        status = self._link.status("arm", round(1000 * self._config.arming_expires_s))
        refuse_unarmed(self._config.port, status)

    def _cock(self) -> None:
        end_ns = self._clock.monotonic_ns() + round(GUARD_S[StrikerState.COCKING] * 1e9)
        while self._poll() is not BoardState.ARMED:
            if self._clock.monotonic_ns() > end_ns:
                raise StrikerFault(
                    f"{self._config.port}: the striker is not drawn back; draw it back before you "
                    "confirm that the object is in place"
                )
            time.sleep(LOADING_POLL_S)

    def _strike(self, tip_speed_m_s: float) -> StrikeOutcome:
        readings = self._read_clock()
        if self._stop_requested:
            raise StrikerStopped
        self._enter(StrikerState.RELEASED)
        before_ns = self._clock.monotonic_ns()
        status = self._link.fire(round(1000 * tip_speed_m_s))
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

    def _secure(self, error: StrikerError) -> None:  # noqa: ARG002 - whatever it is, a stop makes it safe
        self._link.send_stop()

    def _end_permission(self) -> None:
        self._link.status("stop")

    def _attend(self) -> None:
        """Send the sign of life that an armed board needs; otherwise read its clock twice a second."""
        if self._status.state is StrikerState.FAULT or not self._link.is_open:
            return
        now_ns = self._clock.monotonic_ns()
        if self._status.armed_ns is not None:
            with contextlib.suppress(StrikerStopped):  # it is consumed at the next turn
                self._poll()
        elif now_ns - self._idle_read_ns >= IDLE_NS:
            self._idle_read_ns = now_ns
            self._board_clock.observe(*self._link.read_time())
