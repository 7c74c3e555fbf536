"""The Report document: result, sensitivity, and errors against ground truth where it is known."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from schemas.document import Document, Matrix3, Vector3
from schemas.result import RESULT_VERSION, Result


class ReportRecording(Document):
    """A recording that the result uses."""

    number: int = Field(ge=1, description="number by start time")
    files: list[str]
    recording_id: str
    content_id: str
    created: str
    software: str = Field(description="program that recorded it")
    camera: str
    frame_rate_hz: float
    time_source: str


class InfluenceResult(Document):
    """Sensitivity of the centre of mass to one strike's phi and k, all else fixed."""

    strike_id: str
    axis_id: str
    com_by_phi: Vector3 = Field(description="m/rad, in O")
    com_by_log_k: Vector3 = Field(description="m per relative change of k, in O")


class ErrorShare(Document):
    """Share of one kind of error in the covariance of the centre of mass; the shares add up to the whole."""

    source: str
    covariance: Matrix3 = Field(description="m^2, in O")
    half95_worst_m: float = Field(
        ge=0,
        description="half-width of the 95 % interval along the worst-known direction, from this error alone",
    )
    share_worst: float = Field(description="share of the variance along that direction")


class SensitivityResult(Document):
    """Sensitivity of the centre of mass to each strike, and its uncertainty by kind of error."""

    worst_direction: Vector3 = Field(
        description="unit direction, in O, along which the centre of mass is known worst"
    )
    strikes: list[InfluenceResult]
    sources: list[ErrorShare]


class Report(Document):
    """All numbers that the report shows."""

    schema_version: str = RESULT_VERSION
    object: str
    verdict: str = Field(description="summary in words; sentences to trust and to doubt are in the result")
    recordings: list[ReportRecording]
    result: Result
    sensitivity: SensitivityResult
    score: dict[str, Any] | None = Field(
        default=None,
        description=(
            "errors against ground truth, as `analyze score --json` prints them; virtual recordings only"
        ),
    )
