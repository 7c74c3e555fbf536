"""The document that `analyze predict --json` prints: strikes and tosses left out, simulated, compared."""

from __future__ import annotations

from pydantic import Field

from schemas.document import Document
from schemas.result import RESULT_VERSION


class AngleErrorResult(Document):
    """Error of a simulated tipping angle or attitude over the frames compared."""

    rms_rad: float = Field(ge=0, description="root mean square [rad]")
    largest_rad: float = Field(ge=0, description="largest size [rad]")


class AssetErrors(Document):
    """Errors of the three bodies that were simulated."""

    estimated: AngleErrorResult
    """body as the other strikes and tosses estimate it"""
    uniform: AngleErrorResult
    """body of uniform density"""
    shell: AngleErrorResult
    """thin shell"""


class PredictedStrikeResult(Document):
    """One strike, simulated by bodies that do not know it."""

    strike_id: str
    """id of the strike"""
    frames: int = Field(ge=0, description="number of frames compared")
    seconds: float = Field(description="time from the first free frame to the last one compared [s]")
    friction: float | None = Field(description="coefficient of friction used; null for MuJoCo's default")
    friction_is_bound: bool
    """true if only a lower bound of friction is known, which was used"""
    errors: AssetErrors
    """errors by body"""


class SkippedStrikeResult(Document):
    """Strike that could not be predicted."""

    strike_id: str
    """id of the strike"""
    reason: str
    """reason in words"""


class PredictedTossResult(Document):
    """One toss, thrown by bodies that do not know it."""

    toss_id: str
    """id of the toss"""
    frames: int = Field(ge=0, description="number of frames compared")
    seconds: float = Field(description="time from the flight's first frame to the last one compared [s]")
    measured_sd_rad: float = Field(
        ge=0, description="standard deviation of the attitude in the video, median over the frames [rad]"
    )
    errors: AssetErrors
    """errors of the attitude by body: angle between simulated and tracked one"""


class SkippedTossResult(Document):
    """Toss that could not be predicted."""

    toss_id: str
    """id of the toss"""
    reason: str
    """reason in words"""


class PredictionsResult(Document):
    """Strikes and tosses of one object, each left out of the estimate and simulated in MuJoCo."""

    schema_version: str = RESULT_VERSION
    object: str
    """name of the object"""
    strikes: list[PredictedStrikeResult]
    """predicted strikes, in recording order"""
    skipped: list[SkippedStrikeResult]
    """strikes that could not be predicted"""
    median: AssetErrors | None
    """medians over the strikes; null without a strike"""
    tosses: list[PredictedTossResult] = Field(default_factory=list[PredictedTossResult])
    """predicted tosses, in recording order"""
    skipped_tosses: list[SkippedTossResult] = Field(default_factory=list[SkippedTossResult])
    """tosses that could not be predicted"""
    toss_median: AssetErrors | None = None
    """medians over the tosses; null without a toss"""
