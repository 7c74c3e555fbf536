"""Events of a session, to which the state machine in `machine.py` reacts."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from schemas.watch_lines import SessionEstimate, StrikeVerdict, TossJudgement


class Event:
    """Base of the events that a session reacts to."""


@dataclass(frozen=True)
class Started(Event):
    """Event: the recording is open."""


@dataclass(frozen=True)
class Placed(Event):
    """Event: the operator has placed the object."""


class Order(enum.Enum):
    """Order of the operator in place of a placed object."""

    SKIP = "skip"
    """leave the planned strike out"""
    AGAIN = "again"
    """repeat the strike that was judged last"""
    HARDER = "harder"
    """strike harder at the next attempt of this planned strike"""


@dataclass(frozen=True)
class Ordered(Event):
    """Event: asked to place the object, the operator gave another order."""

    order: Order


@dataclass(frozen=True)
class PoseChecked(Event):
    """Event: the object's pose has been compared with the planned placement."""

    good: bool
    """True if the object lies as planned, or could not be checked"""
    text: str = ""
    """reason if the pose is not good, or was not checked"""


@dataclass(frozen=True)
class Ready(Event):
    """Event: the striker is armed (may strike once) and cocked, and its arm has come to rest."""


@dataclass(frozen=True)
class Struck(Event):
    """Event: the striker has completed the strike. Times are host monotonic [ns]."""

    contact_time_ns: int | None
    """time of first contact as the striker measured it [ns]; None if it measured none"""
    contact_time_sd_ns: float
    """standard deviation of the contact time [ns]"""
    tip_speed_m_s: float | None
    """tip speed just before contact [m/s]; 0 if the striker met nothing; None if it was not measured"""
    contacts: int
    """number of contacts that may have occurred"""


@dataclass(frozen=True)
class Recorded(Event):
    """Event: the recording window of a strike (time span whose images are kept) is closed.

    Usually the object is at rest again; at a time limit the window is closed although the object moves. Times
    are log times [ns].
    """

    window_start_ns: int
    """log time of the window's first image [ns]"""
    window_end_ns: int
    """log time of the window's last image [ns]"""
    frames: int
    """number of frames recorded in the window"""
    lost: int
    """number of frames lost in the window, or dropped by a slow disk"""


@dataclass(frozen=True)
class Tossed(Event):
    """Event: the recording window of a toss is closed."""

    recorded: Recorded


@dataclass(frozen=True)
class TossJudged(Event):
    """Event: `analyze watch` has judged the toss from its images, or did not answer in time."""

    verdict: TossJudgement | None
    """None if there was no answer in time"""


@dataclass(frozen=True)
class Judged(Event):
    """Event: `analyze watch` has judged the strike from its images, or did not answer in time."""

    verdict: StrikeVerdict | None
    """None if there was no answer in time"""


@dataclass(frozen=True)
class Advised(Event):
    """Event: `analyze advise` has stated the answer so far, or did not answer in time."""

    estimate: SessionEstimate | None
    """None if there was no answer in time"""


@dataclass(frozen=True)
class StopRequested(Event):
    """Event: the operator, or an error that cannot be cleared, ends the session."""

    text: str = "stopped by the operator"
    """reason for the end"""


@dataclass(frozen=True)
class StrikerFailed(Event):
    """Event: the striker reported a fault, or stopped answering, while arming, cocking or swinging."""

    text: str
    """description of the fault"""


@dataclass(frozen=True)
class FileCutShort(Event):
    """Event: the file with this strike's images was cut short; the recording continues in the next file."""

    text: str
    """description of the loss"""
