"""Progress of a session, which it reports to the daemon and the daemon to every client that asks."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from schemas.document import Document

SessionPhase = Literal[
    "idle",
    "placing",
    "checking_pose",
    "arming",
    "striking",
    "recording",
    "judging",
    "tossing",
    "paused",
    "finished",
    "aborted",
]
"""state of a session as in the recording, in lower case; "paused" while it is held before the next arming"""


class StrikeStatus(Document):
    """Outcome of one attempt of a session."""

    id: str
    """id of the attempt in the recording"""
    edge: str
    """pivot edge in words"""
    verdict: str
    """verdict of `analyze watch`; "no_verdict" if there is none"""
    reason: str
    phi_rad: float | None = Field(default=None, description="balance angle; null if it is not known")
    phi_sd_rad: float | None = None
    """1 sigma of it"""
    energy_ratio: float | None = None
    """kinetic energy after the strike over that needed to reach balance; null if it is not known"""


class SessionStatus(Document):
    """Session that runs, or the last one: what it does now, and the attempts so far."""

    object: str
    """name of the object"""
    plan: str
    """name of the plan file"""
    file: str
    """path of the recording"""
    began_ns: int
    """Unix time at which the recording was opened [ns]"""
    state: SessionPhase = "idle"
    text: str = ""
    """remark on the state"""
    strike_id: str = ""
    """id of the planned strike; empty before the first and after the last"""
    edge: str = ""
    """its pivot edge in words"""
    toss_id: str = ""
    """id of the planned toss; empty during the strikes"""
    attempt: int = 0
    """number of the attempt, from 1; 0 before the first strike and after the last"""
    done: int = 0
    """number of planned strikes done or given up"""
    total: int
    """number of all planned strikes"""
    earlier: int = 0
    """number of strikes in the earlier recordings with which the session goes on"""
    max_strikes: int | None = None
    arms_at_ns: int | None = Field(
        default=None, description="Unix time at which the countdown ends and the striker is armed [ns]"
    )
    until: str = ""
    """target at which the session ends; empty: after all planned strikes"""
    strikes: list[StrikeStatus] = Field(default=[])
