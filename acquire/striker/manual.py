"""Striker for rigs without a servo: a person strikes by hand, and the images give the time of contact."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from acquire.errors import StrikerStopped
from acquire.striker.base import ClockSink, EventSink, SampleSink, StrikeOutcome, Striker, StrikerState
from acquire.striker.states import StrikerStatus, advance, arming_expired, unhomed_status
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Callable

    from acquire.striker.bus import MonotonicClock
    from schemas.rig import StrikerConfig

HAND_S = 5.0
"""time that `strike` waits for the person to strike [s]"""
_Event = pb.StrikerEvent


class ManualStriker(Striker):
    """Striker whose `strike` waits for a person to strike and does not measure the contact.

    Args:
        config: section `striker` of the rig file; only `arming_expires_s` is used.
        sample_sink: never called, because a hand has no encoder.
        event_sink: called with an event (homed, armed, cocked, released, disarmed, stopped) at transitions.
        clock_sink: never called, because a hand has no clock.
        clock: host monotonic time.
    """

    def __init__(
        self,
        config: StrikerConfig,
        sample_sink: SampleSink,  # noqa: ARG002 - the constructor is the same for every striker
        event_sink: EventSink,
        clock_sink: ClockSink,  # noqa: ARG002 - likewise
        clock: MonotonicClock,
    ) -> None:
        self._config, self._event_sink, self._clock = config, event_sink, clock
        self._status = StrikerStatus(StrikerState.DISARMED, clock.monotonic_ns())
        self._stop_requested = False

    @property
    def state(self) -> StrikerState:
        """Current state of the striker, e.g. DISARMED, HOMED, ARMED or SETTLED."""
        return self._status.state

    def open(self) -> None:
        """Do nothing, because a person who strikes by hand has no port."""

    def home(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Go to state HOMED without any motion.

        Args:
            stopped: function that returns True if a stop was requested after this homing was ordered.

        Raises:
            StrikerStopped: `stopped` returned True.
            StrikerRefused: a strike is allowed or running.
        """
        self._stop_requested = False
        if stopped():
            raise StrikerStopped
        self._enter(StrikerState.HOMED, _Event.HOMED)

    def arm(self) -> None:
        """Allow one strike, for the time `arming_expires_s` of the rig file. The state is ARMED afterwards.

        Raises:
            StrikerRefused: not homed, or a strike is allowed or running already.
        """
        self._stop_requested = False
        self._enter(StrikerState.ARMED, _Event.ARMED)

    def cock(self) -> None:
        """Go from state ARMED to SETTLED at once, without any motion.

        Raises:
            StrikerRefused: not armed.
        """
        self._enter(StrikerState.COCKING)
        self._enter(StrikerState.SETTLED, _Event.COCKED)

    def strike(self, strike_id: str, tip_speed_m_s: float) -> StrikeOutcome:  # noqa: ARG002 - see below
        """Wait 5 s while the person strikes, then disarm; return the outcome, in which nothing is measured.

        Contact time, tip speed and impulse in the outcome are None, the number of contacts is 0.

        Args:
            strike_id: id of the strike in the events.
            tip_speed_m_s: requested tip speed [m/s]; not used, because a hand cannot be ordered one.

        Raises:
            StrikerRefused: not armed, not cocked, or the arming expired.
            StrikerStopped: stopped or closed while waiting; the striker is no longer homed then.
        """
        now_ns = self._clock.monotonic_ns()
        if arming_expired(self._status, now_ns, self._config.arming_expires_s):
            self._enter(StrikerState.DISARMED, _Event.DISARMED)
        self._enter(StrikerState.RELEASED, _Event.RELEASED, strike_id)
        while self._clock.monotonic_ns() - now_ns < HAND_S * 1e9:
            if self._stop_requested:
                self._status = unhomed_status(self._clock.monotonic_ns())
                self._event_sink(
                    _Event(kind=_Event.STOPPED, strike_id=strike_id, host_time_ns=self._clock.monotonic_ns())
                )
                raise StrikerStopped
            time.sleep(0.02)
        self._enter(StrikerState.DISARMED, _Event.DISARMED, strike_id)
        return StrikeOutcome(None, 0.0, None, 0.0, None, 0.0, 0, now_ns)

    def stop(self) -> None:
        """End a wait for the person's strike, or disarm if a strike is allowed and has not begun."""
        self._stop_requested = True
        if self._status.armed_ns is not None and self._status.state is not StrikerState.RELEASED:
            self._enter(StrikerState.DISARMED, _Event.STOPPED)

    def close(self) -> None:
        """End a wait for the person's strike."""
        self._stop_requested = True

    def _enter(self, state: StrikerState, kind: _Event.Kind | None = None, strike_id: str = "") -> None:
        now_ns = self._clock.monotonic_ns()
        self._status = advance(self._status, state, now_ns)
        if kind is not None:
            self._event_sink(_Event(kind=kind, strike_id=strike_id, host_time_ns=now_ns))
