"""Actions of a session: ordered by the state machine in `machine.py`, executed by `runner.py`."""

from __future__ import annotations

from dataclasses import dataclass

from acquire.session.events import (
    Recorded,
    Struck,
)
from schemas.proto import percuss_pb2 as pb
from schemas.strike_plan import PlannedStrike, PlannedToss
from schemas.watch_lines import AdviceRequest, StrikeVerdict, TossJudgement


@dataclass(frozen=True)
class Announce:
    """Action: write the session's state into the recording, and send it to clients that listen to events."""

    state: pb.SessionState.State
    strike_id: str
    """id of the planned strike; "" before the first and after the last"""
    attempt: int
    """number of the attempt, from 1; 0 before the first strike and after the last"""
    text: str = ""
    """remark on the state"""
    toss_id: str = ""
    """id of the planned toss; "" during the strikes"""


@dataclass(frozen=True)
class AskToPlace:
    """Action: ask the operator to place the object for a planned strike."""

    strike: PlannedStrike
    hint: str = ""
    """reason why the object is to be placed again; "" the first time"""


@dataclass(frozen=True)
class CheckPose:
    """Action: compare the object's pose with the placement of a planned strike."""

    strike: PlannedStrike


@dataclass(frozen=True)
class Arm:
    """Action: arm the striker (permit one strike) and cock it (draw the arm back)."""


@dataclass(frozen=True)
class ClearFault:
    """Action: home the striker after a fault (clear it, raise the arm); if that fails, the session ends."""


@dataclass(frozen=True)
class Strike:
    """Action: open the recording window (time span whose images are kept) and strike."""

    strike: PlannedStrike
    strike_id: str
    """id of the attempt, unique in the recording"""
    tip_speed_m_s: float
    """tip speed to command [m/s]"""


@dataclass(frozen=True)
class RecordUntilRest:
    """Action: wait until the object is at rest or a time limit, then close the strike's recording window."""


@dataclass(frozen=True)
class Judge:
    """Action: ask `analyze watch` to judge a strike, given the time span recorded and the contact time."""

    strike: PlannedStrike
    strike_id: str
    """id of the attempt, unique in the recording"""
    recorded: Recorded
    struck: Struck


@dataclass(frozen=True)
class WriteRecord:
    """Action: write a message on one strike (time span, speeds, contact, verdict) into the recording."""

    strike: PlannedStrike
    strike_id: str
    """id of the attempt, unique in the recording"""
    attempt: int
    """number of the attempt, from 1"""
    tip_speed_command_m_s: float
    """commanded tip speed [m/s]"""
    struck: Struck
    recorded: Recorded
    verdict: StrikeVerdict | None
    """None if `analyze watch` did not answer in time"""
    choice_text: str = ""
    """reason why this strike was chosen; "" if the plan's order did"""


@dataclass(frozen=True)
class Advise:
    """Action: ask `analyze advise` for the answer so far, and for the strike that tells most."""

    request: AdviceRequest


@dataclass(frozen=True)
class ParkStriker:
    """Action: home the striker, which is then not armed and out of the way of a toss."""


@dataclass(frozen=True)
class AskToToss:
    """Action: ask the operator whether all is ready for a planned toss."""

    toss: PlannedToss
    hint: str = ""
    """reason why the toss is asked for again; "" the first time"""


@dataclass(frozen=True)
class RecordToss:
    """Action: record all frames until the object was tossed and lies still, or until a time limit."""

    toss: PlannedToss


@dataclass(frozen=True)
class JudgeToss:
    """Action: ask `analyze watch` for the verdict on a toss."""

    toss: PlannedToss
    attempt: int
    """number of the attempt, from 1"""
    recorded: Recorded


@dataclass(frozen=True)
class WriteToss:
    """Action: write a message on one toss (ids, time span and verdict) into the recording."""

    toss: PlannedToss
    attempt: int
    """number of the attempt, from 1"""
    recorded: Recorded
    verdict: TossJudgement | None = None
    """None if there was no answer in time"""


TossStep = ParkStriker | AskToToss | RecordToss | JudgeToss | WriteToss
"""an action of the tosses"""


@dataclass(frozen=True)
class CloseRecording:
    """Action: close the recording; the session ends."""

    aborted: bool = False
    """True if the session ends before its last planned strike"""
    text: str = ""
    """reason if the session was aborted, or stopped itself"""
    missed: bool = False
    """True if the session ends without its target"""


Step = (
    Announce
    | AskToPlace
    | CheckPose
    | Arm
    | ClearFault
    | Strike
    | RecordUntilRest
    | Judge
    | WriteRecord
    | Advise
    | TossStep
)
"""an action after which the session continues"""
Action = Step | CloseRecording
