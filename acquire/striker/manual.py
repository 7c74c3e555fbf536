"""A striker without a motor: a hand strikes, and the frames tell when. For rigs that have no servo yet."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from acquire.errors import StrikerStopped
from acquire.striker.base import ClockSink, EventSink, SampleSink, StrikeOutcome, Striker, StrikerState
from acquire.striker.states import StrikerStatus, advance, arming_expired, unhomed
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Callable

    from acquire.config import StrikerConfig
    from acquire.striker.bus import MonotonicClock

HAND_S = 5.0
"""how long a hand has to strike after the call"""
_Event = pb.StrikerEvent


class ManualStriker(Striker):
    """The same order of calls as a motor's; `strike` gives the hand its time and knows nothing of the contact.

    Args:
        config: only `arming_expires_s` matters.
        sample_sink, clock_sink: never called; a hand has no encoder.
        event_sink: told the transitions.
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
        """Where it stands."""
        return self._status.state

    def open(self) -> None:
        """Nothing to open."""

    def home(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Nothing to move."""
        self._stop_requested = False
        if stopped():
            raise StrikerStopped
        self._set(StrikerState.HOMED, _Event.HOMED)

    def arm(self) -> None:
        """See Striker."""
        self._stop_requested = False
        self._set(StrikerState.ARMED, _Event.ARMED)

    def cock(self) -> None:
        """The hand is ready."""
        self._set(StrikerState.COCKING)
        self._set(StrikerState.SETTLED, _Event.COCKED)

    def strike(self, strike_id: str, tip_speed_m_s: float) -> StrikeOutcome:
        """Wait for the hand; the outcome's contact is unknown, its speed the one asked for, with that as its uncertainty.

        Raises:
            StrikerRefused: not armed in time.
            StrikerStopped: stopped while waiting.
        """
        now_ns = self._clock.monotonic_ns()
        if arming_expired(self._status, now_ns, self._config.arming_expires_s):
            self._set(StrikerState.DISARMED, _Event.DISARMED)
        self._set(StrikerState.RELEASED, _Event.RELEASED, strike_id)
        while self._clock.monotonic_ns() - now_ns < HAND_S * 1e9:
            if self._stop_requested:
                self._status = unhomed(self._clock.monotonic_ns())
                self._event_sink(_Event(kind=_Event.STOPPED, strike_id=strike_id, host_time_ns=self._clock.monotonic_ns()))
                raise StrikerStopped
            time.sleep(0.02)
        self._set(StrikerState.DISARMED, _Event.DISARMED, strike_id)
        return StrikeOutcome(None, 0.0, tip_speed_m_s, tip_speed_m_s, None, 0.0, 0, now_ns)

    def stop(self) -> None:
        """Void the arming, and end a wait."""
        self._stop_requested = True
        if self._status.armed_ns is not None and self._status.state is not StrikerState.RELEASED:
            self._set(StrikerState.DISARMED, _Event.STOPPED)

    def close(self) -> None:
        """Nothing to release."""
        self._stop_requested = True

    def _set(self, state: StrikerState, kind: _Event.Kind | None = None, strike_id: str = "") -> None:
        now_ns = self._clock.monotonic_ns()
        self._status = advance(self._status, state, now_ns)
        if kind is not None:
            self._event_sink(_Event(kind=kind, strike_id=strike_id, host_time_ns=now_ns))
