"""What `analyze report --json` prints: the answer, what it hangs on, and of virtual recordings how far it is from the truth."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from schemas.document import SCHEMA_VERSION, Document, Matrix3, Vector3
from schemas.result import Result


class ReportRecording(Document):
    """A recording that went in."""

    number: int = Field(ge=1, description="by the time at which they began")
    files: list[str]
    recording_id: str
    content_id: str
    created: str
    software: str = Field(description="that recorded it")
    camera: str
    frame_rate_hz: float
    time_source: str


class InfluenceResult(Document):
    """How the centre of mass moves with what one strike says, all else as it is."""

    strike_id: str
    axis_id: str
    com_by_phi: Vector3 = Field(description="m/rad, in O")
    com_by_log_k: Vector3 = Field(description="m per relative change of k, in O")


class ErrorShare(Document):
    """The part of the centre of mass's covariance that one kind of error causes; all parts together are the whole."""

    source: str
    covariance: Matrix3 = Field(description="m^2, in O")
    half95_worst_m: float = Field(ge=0, description="half a 95 % interval along the worst known direction, from this alone")
    share_worst: float = Field(description="of the variance along that direction")


class SensitivityResult(Document):
    """What moves the centre of mass, and what its uncertainty is made of."""

    worst_direction: Vector3 = Field(description="unit, in O, along which the centre of mass is known worst")
    strikes: list[InfluenceResult]
    sources: list[ErrorShare]


class Report(Document):
    """All that the report shows, as numbers."""

    schema_version: str = SCHEMA_VERSION
    object: str
    verdict: str = Field(description="in words; sentences to trust and to doubt are in the result")
    recordings: list[ReportRecording]
    result: Result
    sensitivity: SensitivityResult
    score: dict[str, Any] | None = Field(default=None, description="as `analyze score --json`, of virtual recordings")
