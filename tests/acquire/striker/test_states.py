from __future__ import annotations

import itertools

import pytest

from acquire.errors import StrikerRefused
from acquire.striker.base import StrikerState as S
from acquire.striker.states import (
    GUARD_S,
    MOVING,
    TRANSITIONS,
    StrikerStatus,
    advance,
    arming_expired,
    is_overdue,
    unhomed_status,
)


def status_after(*states: S) -> StrikerStatus:
    status = StrikerStatus(S.DISARMED, 0)
    for state in states:
        status = advance(status, state, 0)
    return status


def test_complete_strike_is_one_path_and_can_be_repeated() -> None:
    cycle = (S.ARMED, S.COCKING, S.SETTLED, S.RELEASED, S.CONTACT, S.CATCH, S.VERIFY, S.DISARMED)
    status = status_after(S.HOMED, *cycle, *cycle)
    assert status.homed
    assert status.armed_ns is None


def test_release_requires_arming_and_settling() -> None:
    assert [s for s, to in TRANSITIONS.items() if S.RELEASED in to] == [S.SETTLED]
    assert [s for s, to in TRANSITIONS.items() if S.SETTLED in to] == [S.COCKING]
    assert [s for s, to in TRANSITIONS.items() if S.COCKING in to] == [S.ARMED]


@pytest.mark.parametrize("state", S)
def test_any_state_can_fault_and_only_homing_leaves_it(state: S) -> None:
    fault = advance(StrikerStatus(state, 0, homed=True, armed_ns=0), S.FAULT, 1)
    assert not fault.homed
    for to in set(S) - {S.HOMED, S.FAULT}:
        with pytest.raises(StrikerRefused, match="home"):
            advance(fault, to, 2)
    assert advance(fault, S.HOMED, 2).homed


def test_every_transition_is_listed_or_refused() -> None:
    for state, to in itertools.product(S, set(S) - {S.FAULT}):
        status = StrikerStatus(state, 0, homed=True)
        if to in TRANSITIONS[state]:
            assert advance(status, to, 1).state is to
        else:
            with pytest.raises(StrikerRefused):
                advance(status, to, 1)


def test_interrupted_motion_requires_homing() -> None:
    with pytest.raises(StrikerRefused, match="not homed"):
        advance(unhomed_status(0), S.ARMED, 1)


def test_arming_expires_before_the_release_but_not_after() -> None:
    armed = status_after(S.HOMED, S.ARMED)
    assert not arming_expired(armed, int(19e9), 20.0)
    assert arming_expired(armed, int(21e9), 20.0)
    assert arming_expired(
        advance(advance(armed, S.COCKING, int(15e9)), S.SETTLED, int(16e9)), int(21e9), 20.0
    )
    assert not arming_expired(
        status_after(S.HOMED, S.ARMED, S.COCKING, S.SETTLED, S.RELEASED), int(21e9), 20.0
    )


def test_every_moving_state_has_a_time_limit() -> None:
    assert {S.COCKING, S.RELEASED, S.CONTACT, S.MISS, S.CATCH, S.VERIFY} == MOVING
    for state in MOVING:
        assert is_overdue(StrikerStatus(state, 0), int(GUARD_S[state] * 1e9) + 1)
    assert not is_overdue(StrikerStatus(S.HOMED, 0), int(1e15))
