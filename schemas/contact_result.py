"""Entry of the Result document on the contact between the object and its table."""

from __future__ import annotations

from pydantic import Field

from schemas.document import Document
from schemas.quantity import Quantity


class StrikeFrictionResult(Document):
    """What one strike shows of friction."""

    strike_id: str
    """id of the strike"""
    slid_m: float = Field(description="range of the edge's sliding in the frames used [m]")
    held_ratio: float | None = Field(
        description="largest ratio of horizontal to vertical force at the edge that lasted while it held;"
        " null where it slid, or where too few frames show it"
    )


class FrictionResult(Document):
    """Coefficient of friction between the object's edges and the table."""

    coefficient: Quantity = Field(
        description="not observed, without a value, where no edge slid enough: then only `at_least` is known"
    )
    at_least: float = Field(description="lower bound of the coefficient that holds with 95 %")
    scatter: float | None = Field(
        description="relative scatter from strike to strike beyond the errors; null with fewer than two"
        " values"
    )
    strikes: list[StrikeFrictionResult]
    """what each strike shows"""


class LandingResult(Document):
    """Restitution of one landing."""

    strike_id: str
    """id of the strike"""
    restitution: Quantity = Field(
        description="speed of the line that lands, after over before; not observed where the frames resolve"
        " no rebound: then its interval runs from 0 to the largest that they could miss"
    )
    speed_m_s: float = Field(description="speed of that line as it meets the table [m/s]")
    angular_speed_before_rad_s: float = Field(description="angular speed before the landing [rad/s]")
    angular_speed_after_rad_s: float = Field(description="angular speed after it [rad/s]")


class RestitutionResult(Document):
    """Distribution of the coefficient of restitution over landings."""

    mean: Quantity
    """mean over landings"""
    scatter: float | None = Field(
        description="1 sigma from landing to landing beyond the errors; null for one landing"
    )
    speed_m_s: float = Field(description="mean speed at which the lines met the table [m/s]")
    landings: list[LandingResult]
    """each landing"""


class ContactPropertiesResult(Document):
    """Friction, restitution and rolling resistance of the object on one table; they hold for this pair."""

    object: str
    """name of the object"""
    table: str
    """name of the table as the rig file states it, or "the table of this recording" """
    friction: FrictionResult | None
    """friction; null if no strike shows any"""
    restitution: RestitutionResult | None
    """restitution; null if no landing was seen"""
    rolling_arm: Quantity | None = Field(
        description="distance by which the load acts ahead of the contact while the object rolls [m]; null if"
        " no strike rocked back far enough"
    )
