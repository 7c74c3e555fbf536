"""What `analyze report --compare --json` prints: repeated sessions of one object, their precision (ISO 5725) and agreement."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from schemas.document import SCHEMA_VERSION, Document
from schemas.report import ReportRecording
from schemas.result import AxisMoment, Quantity, RegionResult


class SessionsAgreement(Document):
    """How much better the strikes fit if sessions may have a centre of mass each; what they share is shared."""

    chi_squared: float = Field(ge=0)
    freedom: int
    chance: float = Field(ge=0, le=1, description="of such a chi squared or a larger one, if all mean one centre of mass")
    apart_m: float = Field(ge=0, description="the largest distance of one's centre of mass from the first one's")


class SessionAnswer(Document):
    """One session by itself."""

    recording: ReportRecording
    setup: int = Field(ge=1, description="sessions of one number had the same rig, level and camera calibration")
    strikes: int
    strikes_used: int
    centre_of_mass: Quantity
    moments: list[AxisMoment]
    regions: list[RegionResult] = Field(description="named by the first session's border")
    against_others: SessionsAgreement
    stands_out: bool


class SessionValue(Document):
    """What one session says of a quantity: its answer, or the mean of its strikes."""

    session: int
    value: float
    interval95: list[float] | None = None
    results: list[float] = Field(description="that it is the mean of")


class QuantityPrecision(Document):
    """Of one quantity, as ISO 5725-2 defines it; null where it cannot be told."""

    name: str
    kind: Literal["centre_of_mass", "moment", "region", "phi"]
    unit: str
    grouped_by: Literal["set-up", "session"] = Field(description="what results under repeatability conditions have in common")
    sessions: list[SessionValue]
    together: Quantity | None = Field(default=None, description="as all strikes have it, where the sessions' answers are compared")
    mean: float
    s_r: float | None = Field(description="repeatability standard deviation: within a group")
    freedom_r: int
    s_L: float | None = Field(description="standard deviation between groups")
    s_R: float | None = Field(description="reproducibility standard deviation: s_L and s_r together")
    freedom_R: int
    mandel_h: list[float] | None = Field(description="of each session in turn; null for fewer than three")


class Comparison(Document):
    """Repeated sessions of one object."""

    schema_version: str = SCHEMA_VERSION
    object: str
    object_sha256: str
    software: str
    verdict: list[str] = Field(description="in words; each begins with trust, doubt or repeat")
    agreement: SessionsAgreement
    may_join: bool
    sessions: list[SessionAnswer]
    joint: Quantity = Field(description="centre of mass of all strikes as one")
    precision: list[QuantityPrecision]
    mandel_h_limit: float | None = Field(description="of |h|, passed by one session in a hundred")
