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

    from acquire.config import StrikerConfig
    from acquire.striker.bus import MonotonicClock

HAND_S = 5.0
"""time that `strike` waits for the person to strike [s]"""
_Event = pb.StrikerEvent


class ManualStriker(Striker):
    """Striker whose `strike` waits for a person to strike and does not measure the contact.

    Args:
        config: the rig file's section; only `arming_expires_s` is used.
        sample_sink, clock_sink: never called; a hand has no encoder.
        event_sink: called at state transitions.
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
        """Current state of the strike sequence."""
        return self._status.state

    def open(self) -> None:
        """Do nothing; there is no port."""

    def home(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Go to state HOMED without any motion."""
        self._stop_requested = False
        if stopped():
            raise StrikerStopped
        self._enter(StrikerState.HOMED, _Event.HOMED)

    def arm(self) -> None:
        """Allow one strike; see Striker."""
        self._stop_requested = False
        self._enter(StrikerState.ARMED, _Event.ARMED)

    def cock(self) -> None:
        """Go to state SETTLED at once."""
        self._enter(StrikerState.COCKING)
        self._enter(StrikerState.SETTLED, _Event.COCKED)

    def strike(self, strike_id: str, tip_speed_m_s: float) -> StrikeOutcome:
        """Wait while the person strikes; the contact is unknown.

        The tip speed in the outcome is the requested one, with itself as standard deviation.

        Raises:
            StrikerRefused: not armed in time.
            StrikerStopped: stopped while waiting.
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
        return StrikeOutcome(None, 0.0, tip_speed_m_s, tip_speed_m_s, None, 0.0, 0, now_ns)

    def stop(self) -> None:
        """Disarm, and end a wait for the person's strike."""
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
