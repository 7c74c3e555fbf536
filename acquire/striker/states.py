"""State transitions of the striker during a strike and their time limits, without I/O."""

from __future__ import annotations

from dataclasses import dataclass, replace

from acquire.errors import StrikerRefused
from acquire.striker.base import StrikerState

_S = StrikerState

TRANSITIONS: dict[StrikerState, frozenset[StrikerState]] = {
    _S.DISARMED: frozenset({_S.HOMED, _S.ARMED}),
    _S.HOMED: frozenset({_S.HOMED, _S.ARMED, _S.DISARMED}),
    _S.ARMED: frozenset({_S.COCKING, _S.DISARMED}),
    _S.COCKING: frozenset({_S.SETTLED, _S.DISARMED}),
    _S.SETTLED: frozenset({_S.RELEASED, _S.DISARMED}),
    _S.RELEASED: frozenset({_S.CONTACT, _S.MISS, _S.DISARMED}),
    _S.CONTACT: frozenset({_S.CATCH, _S.DISARMED}),
    _S.MISS: frozenset({_S.CATCH, _S.DISARMED}),
    _S.CATCH: frozenset({_S.VERIFY, _S.DISARMED}),
    _S.VERIFY: frozenset({_S.DISARMED}),
    _S.FAULT: frozenset({_S.HOMED}),
}
"""states that may follow each state; FAULT may follow any and is not listed"""

GUARD_S: dict[StrikerState, float] = {
    _S.COCKING: 5.0,
    _S.RELEASED: 1.5,
    _S.CONTACT: 0.25,
    _S.MISS: 0.25,
    _S.CATCH: 3.0,
    _S.VERIFY: 2.0,
}
"""longest duration [s] of the states in which the arm moves or is checked after it; DISARMED, HOMED and FAULT
are unlimited, ARMED and SETTLED end when the arming expires"""

MOVING = frozenset(GUARD_S)
"""states with a longest duration: the arm moves, or is checked after it"""


@dataclass(frozen=True)
class StrikerStatus:
    """State of a striker (e.g. ARMED), whether it is homed, and the times that limit state and arming.

    The times are host monotonic [ns]: when the state began, and when the strike was allowed.
    """

    state: StrikerState
    """current state of the strike sequence"""
    since_ns: int
    """host monotonic time at which the state began [ns]"""
    homed: bool = False
    """True if the arm is at a known place with torque on"""
    armed_ns: int | None = None
    """host monotonic time [ns] at which one strike was allowed (armed); None if no strike is allowed"""


def advance(status: StrikerStatus, to: StrikerState, now_ns: int) -> StrikerStatus:
    """Status of the striker after a transition to another state.

    FAULT may follow any state. After HOMED the striker counts as homed, after FAULT it does not; DISARMED
    only ends the permission to strike.

    Args:
        status: status before; it is not changed.
        to: the new state.
        now_ns: host monotonic time of the transition [ns].

    Raises:
        StrikerRefused: `to` may not follow the current state, or is ARMED and the striker is not homed.
    """
    if to is _S.FAULT:
        return StrikerStatus(to, now_ns, homed=False)
    if to not in TRANSITIONS[status.state]:
        change = f"the striker is {status.state.value}: it cannot become {to.value}"
        raise StrikerRefused(f"{change}; {_remedy(status, to)}")
    if to is _S.ARMED:
        if not status.homed:
            raise StrikerRefused("the striker is not homed; home it before arming")
        return StrikerStatus(to, now_ns, homed=True, armed_ns=now_ns)
    if to is _S.HOMED:
        return StrikerStatus(to, now_ns, homed=True)
    if to is _S.DISARMED:
        return StrikerStatus(to, now_ns, homed=status.homed)
    return replace(status, state=to, since_ns=now_ns)


def _remedy(status: StrikerStatus, to: StrikerState) -> str:
    if status.state is _S.FAULT:
        return "home it to clear the fault"
    if to is _S.RELEASED:
        return "arm and cock it first"
    if to is _S.COCKING:
        return "arm it first (each arming allows one strike)"
    return "finish or stop the strike first"


def unhomed_status(now_ns: int) -> StrikerStatus:
    """Status DISARMED and not homed, from `now_ns` (host monotonic) on.

    It follows an interrupted motion: the arm's position is unknown.
    """
    return StrikerStatus(_S.DISARMED, now_ns, homed=False)


def arming_expired(status: StrikerStatus, now_ns: int, expires_s: float) -> bool:
    """True if a strike was allowed more than `expires_s` [s] before `now_ns` and has not begun since.

    The state in `status` is then ARMED, COCKING or SETTLED. `now_ns` is host monotonic time [ns].
    """
    waiting = status.state in {_S.ARMED, _S.COCKING, _S.SETTLED}
    return waiting and status.armed_ns is not None and now_ns - status.armed_ns > expires_s * 1e9


def is_overdue(status: StrikerStatus, now_ns: int) -> bool:
    """True if the state in `status` has lasted longer, at `now_ns`, than its limit in GUARD_S [s].

    False if that table has no limit for it. `now_ns` is host monotonic time [ns].
    """
    guard_s = GUARD_S.get(status.state)
    return guard_s is not None and now_ns - status.since_ns > guard_s * 1e9
