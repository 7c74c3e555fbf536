"""The Report document: result, sensitivity, and errors against ground truth where it is known."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from schemas.document import Document, Matrix3, Vector3
from schemas.result import RESULT_VERSION, Result


class ReportRecording(Document):
    """A recording that the result uses: its files, identity, time of creation, camera and frame times."""

    number: int = Field(ge=1, description="number by start time")
    files: list[str]
    """names of the recording's files"""
    recording_id: str
    """id of the recording, from its manifest"""
    content_id: str
    """hash of the recording's messages"""
    created: str
    """time of creation, ISO 8601"""
    software: str = Field(description="program that recorded it")
    camera: str
    """description of the camera"""
    frame_rate_hz: float
    """nominal frame rate [Hz]"""
    time_source: str
    """source of the frame times, as in the manifest"""


class InfluenceResult(Document):
    """Change of the estimated centre of mass with phi and k of one strike, all else fixed.

    phi is the measured balance angle [rad]. k = m g R / I_edge [1/s^2] is the rate in the equation of the
    tipping object, theta'' = -k sin(phi - theta): theta the tipping angle, m the mass, g gravity, R the
    distance of the centre of mass from the pivot edge, I_edge the moment of inertia about the edge.
    """

    strike_id: str
    """id of the strike in the result"""
    axis_id: str
    """name of the pivot edge"""
    com_by_phi: Vector3 = Field(description="m/rad, in O")
    com_by_log_k: Vector3 = Field(description="m per relative change of k, in O")


class ErrorShare(Document):
    """Part of the covariance of the centre of mass that one kind of error causes; all parts add up to it.

    It is in m^2, in the object frame O.
    """

    source: str
    """kind of error"""
    covariance: Matrix3 = Field(description="m^2, in O")
    half95_worst_m: float = Field(
        ge=0,
        description="half-width of the 95 % interval along the worst-known direction, from this error alone",
    )
    share_worst: float = Field(description="share of the variance along that direction")


class SensitivityResult(Document):
    """Sensitivity of the centre of mass to the strikes' measurements, and its covariance by kind of error.

    Of each strike it holds the derivatives (3,) of the centre of mass by the balance angle phi [m/rad] and by
    ln k [m], with k the rate [1/s^2] of the tip, theta'' = -k sin(phi - theta), theta the tipping angle; of
    each kind of error its part of the covariance (3, 3) [m^2]. All are in the object frame O.
    """

    worst_direction: Vector3 = Field(
        description="unit direction, in O, along which the centre of mass is known worst"
    )
    strikes: list[InfluenceResult]
    """sensitivity to each strike"""
    sources: list[ErrorShare]
    """share of each kind of error"""


class Report(Document):
    """All numbers that the report shows: the result, its recordings, sensitivities and errors."""

    schema_version: str = RESULT_VERSION
    object: str
    """name of the object"""
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
