"""Bodies of the orders that browsers and scripts send, validated before anything is done."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from schemas.document import Document

Id = Annotated[str, Field(pattern=r"^[a-z0-9]{1,32}$")]
"""opaque id from a list that the console gave; never a path"""
Order = Literal["placed", "skip", "again", "harder"]


class NoBody(Document):
    """Empty JSON object."""


class ClearStop(Document):
    """Order to home the striker after a stop; a person confirms that the arm is free."""

    confirm: Literal[True]


class StartSession(Document):
    """Order to start a session."""

    object_id: Id
    plan_id: Id
    name: str = Field(default="", max_length=80, pattern=r"^[A-Za-z0-9 ._-]*$")
    """name of the recording; empty: made from the object's name and the time"""
    until: str = Field(default="", max_length=80, pattern=r"^[a-z0-9=.,% ]*$")
    """target that ends the session, as `com=0.5mm,inertia=2%`; empty: all strikes of the plan"""
    max_strikes: int | None = Field(default=None, ge=1, le=200)
    resume: list[Id] = Field(default_factory=list[Id], max_length=8)
    """recordings of the same plan, from the archive, with which the session goes on"""
    countdown_s: float = Field(default=3.0, ge=0, le=60)
    """wait before every arming [s]"""
    override: str = Field(default="", max_length=300)
    """reason to start although the preflight check failed; it is written into the recording"""

    def options(self) -> dict[str, str | float | None]:
        """Options of `acquire session` by name, without those that name files."""
        return {
            "--until": self.until,
            "--max-strikes": self.max_strikes,
            "--countdown": self.countdown_s,
        }


class PauseSession(Document):
    """Order to pause before the next arming; "after_strike" first completes the strike that is prompted."""

    when: Literal["now", "after_strike"]


class Answer(Document):
    """Answer to a prompt."""

    id: int = Field(ge=0)
    ok: bool
    """false ends the session"""
    order: Order = "placed"


class Done(Document):
    """Answer to an order that was carried out."""

    ok: Literal[True] = True


class StopDone(Document):
    """Answer to a stop: the striker's state afterwards and before, and the time the daemon took [ms]."""

    state: str
    was: str
    latency_ms: float


class Invitation(Document):
    """Address, with a token valid once, with which a further browser can connect."""

    url: str


class Curve(Document):
    """Tipping angle over time of one strike, measured and fitted; times from the contact on [s]."""

    time_s: list[float]
    theta_deg: list[float]
    fit_time_s: list[float]
    fit_deg: list[float]
    phi_deg: float | None
    window_s: list[float]


class ArchiveEntry(Document):
    """Recording in the folder of recordings; null where no result was computed yet."""

    id: Id
    file: str
    object: str
    date: str
    strikes: int | None
    earlier_strikes: int
    """strikes in the recordings with which its session went on"""
    com_mm: list[float] | None
    com_sd_mm: list[float] | None
    flags: list[str]
    size_bytes: int
    complete: bool


class Problem(Document):
    """Error of a request: kind, message and remedy."""

    kind: str
    message: str
    remedy: str = ""


class ErrorAnswer(Document):
    """Body of an answer with an error status."""

    error: Problem
