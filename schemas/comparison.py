"""The Comparison document of repeated sessions: precision (ISO 5725) and agreement.

A session is one recording of an object being struck; sessions are compared after each has been evaluated.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from schemas.document import Document
from schemas.quantity import Quantity
from schemas.report import ReportRecording
from schemas.result import RESULT_VERSION, AxisMoment, RegionResult


class SessionsAgreement(Document):
    """Chi-squared test whether one centre of mass, common to all sessions, explains their measurements.

    The alternative is a centre of mass of its own for each session. An error that sessions share, such as
    that of the object's shape, is taken as the same error in all of them.
    """

    chi_squared: float = Field(ge=0)
    """decrease of chi squared if every session has its own centre of mass"""
    freedom: int = Field(description="degrees of freedom of chi_squared")
    chance: float = Field(
        ge=0,
        le=1,
        description="probability of such a chi squared or a larger one under one common centre of mass",
    )
    apart_m: float = Field(
        ge=0, description="largest distance [m] of a session's centre of mass from the first session's"
    )


class SessionAnswer(Document):
    """Centre of mass, moments of inertia and region masses that one session gives by itself.

    Regions are the shell and the interior on either side of a dividing plane.
    """

    recording: ReportRecording
    setup: int = Field(ge=1, description="number of the set-up: rig, level and camera calibration")
    strikes: int = Field(description="number of strikes recorded")
    strikes_used: int = Field(description="number of strikes that the answer uses")
    centre_of_mass: Quantity
    """centre of mass in O, the object's frame"""
    moments: list[AxisMoment]
    """moments of inertia about the pivot axes"""
    regions: list[RegionResult] = Field(description="regions named by the first session's dividing plane")
    against_others: SessionsAgreement = Field(description="this session against all others together")
    stands_out: bool = Field(description="true if this session differs from the others beyond chance")


class SessionValue(Document):
    """Value of one quantity in one session: the session's own estimate, or the mean of its strikes.

    Numbers are in the `unit` of the QuantityPrecision that contains them.
    """

    session: int = Field(description="number of the session by start time, from 1")
    value: float
    interval95: list[float] | None = None
    """lower and upper end of the 95 % interval; null if none is known"""
    results: list[float] = Field(description="values of which `value` is the mean")


class QuantityPrecision(Document):
    """Precision of one quantity over repeated sessions as ISO 5725-2 defines it.

    Precision is stated by standard deviations: within a group of results (repeatability), between groups, and
    of both together (reproducibility). All are in `unit`; one that cannot be determined is null.
    """

    name: str
    """name of the quantity"""
    kind: Literal["centre_of_mass", "moment", "region", "phi"]
    """kind of the quantity; phi is the balance angle about one pivot edge"""
    unit: str
    """unit of all values and standard deviations"""
    grouped_by: Literal["set-up", "session"] = Field(
        description="what results under repeatability conditions share"
    )
    sessions: list[SessionValue]
    together: Quantity | None = Field(
        default=None, description="joint estimate from all strikes, where answers of sessions are compared"
    )
    mean: float
    """mean over the sessions"""
    s_r: float | None = Field(description="repeatability standard deviation: within a group")
    freedom_r: int = Field(description="degrees of freedom of s_r")
    s_L: float | None = Field(description="standard deviation between groups")
    s_R: float | None = Field(description="reproducibility standard deviation: s_L and s_r together")
    freedom_R: int = Field(description="degrees of freedom of s_R")
    mandel_h: list[float] | None = Field(
        description="Mandel's h of each session in turn; null for fewer than three sessions"
    )


class Comparison(Document):
    """Comparison of repeated sessions of one object: answers, agreement and precision of results."""

    schema_version: str = RESULT_VERSION
    object: str
    """name of the object"""
    object_sha256: str
    """SHA-256 of the object's specification and shape file, which identifies it"""
    software: str
    """program and version that compared"""
    verdict: list[str] = Field(description="sentences that begin with trust, doubt or repeat")
    agreement: SessionsAgreement
    """test of one centre of mass for all sessions"""
    may_join: bool = Field(
        description="true if one centre of mass fits all sessions, so that their recordings may be merged"
    )
    sessions: list[SessionAnswer]
    joint: Quantity = Field(description="centre of mass by the joint estimate from all strikes")
    precision: list[QuantityPrecision]
    mandel_h_limit: float | None = Field(description="limit of |h| that one session in a hundred exceeds")
