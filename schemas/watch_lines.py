"""JSON lines between a session and `analyze watch`: what the newest image shows, windows to judge, verdicts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from schemas.document import Document
from schemas.result import Verdict
from schemas.tags import MarkerName


class SeenMarker(Document):
    """A marker in the newest image."""

    id: MarkerName
    corners_px: list[list[float]]


class WatchEvent(Document):
    """Before a strike, a few times a second, as one JSON line."""

    kind: Literal["watch"] = "watch"
    time_ns: int = Field(description="log_time of the image")
    markers: list[SeenMarker]
    at_rest: bool
    saturated_fraction: float
    placement_error_rad: float | None = Field(default=None, description="resting pose against the plan's, if a plan strike is set")
    text: str = ""


_LogTime = Annotated[int, Field(ge=0, lt=1 << 63)]


class JudgeRequest(Document):
    """Line on `analyze watch`'s standard input: judge this window. With `expect` only: check the placement for that plan strike."""

    kind: Literal["judge", "expect"] = "judge"
    plan_strike_id: str
    strike_id: str = ""
    window_start_ns: _LogTime = 0
    window_end_ns: _LogTime = 0
    contact_time_ns: _LogTime = 0


class StrikeVerdict(Document):
    """Answer to a JudgeRequest."""

    kind: Literal["verdict"] = "verdict"
    strike_id: str
    code: Verdict
    reason: str
    phi: float | None = None
    phi_sd: float | None = None
    energy_ratio: float | None = None
    theta_max_rad: float | None = Field(default=None, description="how far an object that rocked back had turned")
    contact_time_ns: int | None = Field(default=None, description="log time of the contact as the images tell it")
    contact_time_sd_ns: float | None = None
