"""Waits of a session, and how they are reported while they last: every one has a longest time."""

from __future__ import annotations

from acquire.session.machine import State
from acquire.striker.base import StrikerState
from acquire.striker.states import GUARD_S
from schemas.proto import percuss_pb2 as pb

POSE_TIMEOUT_S = 8.0
"""time for the object to come to rest and be seen after it was placed [s]"""
WATCHER_RESTART_S = 1.5
"""time the daemon needs to restart `analyze watch` after it died [s]"""
SERVO_TIMEOUT_S = 120.0
"""time for a person to mend the servo's cable or supply during a session [s]"""
JUDGE_TIMEOUT_S = 10.0
"""longest wait for the verdict of `analyze watch` on a strike [s]"""
ADVICE_TIMEOUT_S = 20.0
"""longest wait for the answer so far of `analyze advise` [s]: the first one includes its start, one after a
crash all strikes so far"""
CLOSE_TIMEOUT_S = 90.0
"""longest time for a recording to be finished [s]: that of the capture process"""
SERVO_RETRY_S = 0.5
"""interval between attempts to reach a servo that does not answer [s]"""
REST_TIMEOUT_S = 3.0
"""recorded time after the strike [s] after which the window is closed although the object moves: it has long
landed and only rolls"""
LATE_TIMEOUT_S = 9.0
"""time on the host's clock [s] after which the window is closed in any case; longer than REST_TIMEOUT_S,
because images may arrive late"""
REST_MINIMUM_S = 0.9
"""shortest recorded time after the strike [s]: an object that hesitates at the balance point looks at rest"""
TOSS_TIMEOUT_S = 6.0
"""longest recorded time from the operator's answer to the end of a toss's window [s]; a rig file's
`max_window_s` of less ends it sooner"""
TOSS_LATE_S = 16.0
"""time on the host's clock [s] after which a toss's window is closed in any case; longer than
TOSS_TIMEOUT_S, because images may arrive late"""
TOSS_JUDGE_TIMEOUT_S = 30.0
"""longest wait for the verdict of `analyze watch` on a toss [s], several seconds of images"""
PRINT_JUDGE_TIMEOUT_S = 90.0
"""the same for an object without tags, of which a frame takes up to 0.1 s"""
TOSS_REST_S = 0.5
"""time for which the object lies still after a toss before its window is closed [s]"""
HOME_TIMEOUT_S = 20.0
"""longest time for homing the striker [s]: a slow turn from the farthest angle"""
_EXCHANGES_S = 3.0
"""time for the servo's answers before and after a motion [s], six at half a second"""
_LONGEST_S = {
    State.CHECKING_POSE: POSE_TIMEOUT_S,
    State.ARMING: GUARD_S[StrikerState.COCKING] + _EXCHANGES_S,
    State.STRIKING: sum(GUARD_S.values()) - GUARD_S[StrikerState.COCKING] + _EXCHANGES_S,
    State.RECORDING: LATE_TIMEOUT_S,
    State.JUDGING: JUDGE_TIMEOUT_S,
    State.TOSSING: TOSS_LATE_S,
}
"""longest wait in a state of the session [s]; in PLACING a person has all the time"""


def at_most(longest_s: float) -> str:
    """Text that follows the name of a wait of at most `longest_s` [s]: " (at most 8 s)"."""
    return f" (at most {longest_s:g} s)"


def longest_in(state: pb.SessionState.State) -> str:
    """Text that follows the name of a state of the session, with its longest wait; empty if none is fixed."""
    return at_most(_LONGEST_S[state]) if state in _LONGEST_S else ""
