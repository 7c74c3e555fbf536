"""Outcome of one toss in a result: verdict, and the figures behind it."""

from __future__ import annotations

import enum
from typing import ClassVar

from pydantic import Field

from schemas.document import Document, SparseDocument
from schemas.quantity import Quantity
from schemas.strike_result import FollowedBy


class TossVerdict(enum.Enum):
    """Outcome of a toss: good, or the reason why it is not used."""

    GOOD = "good"
    SLOW = "slow"
    """spins too slowly"""
    SHORT = "short"
    """too short in the air, or in view"""
    PRINCIPAL_AXIS = "principal_axis"
    """spins about a principal axis of inertia, which tells nothing about the others"""
    NOT_FREE = "not_free"
    """no free flight in the images"""
    MARKER_LOST = "marker_lost"
    """markers, or known print, in view in too few frames of the flight"""
    MISFIT = "misfit"
    """does not move like one rigid body"""
    EXCLUDED = "excluded"
    """left out by the user"""
    UNREADABLE = "unreadable"
    """images cannot be used"""


class TossResult(SparseDocument):
    """One toss: verdict and reason, and how it flew."""

    left_out: ClassVar[tuple[str, ...]] = ("followed_by",)

    id: str
    """id of the toss in the recording"""
    plan_toss_id: str
    """id of the planned toss"""
    verdict: TossVerdict
    """outcome of the toss"""
    reason: str
    """explanation of the verdict, with the figures behind it"""
    used: bool
    """true if the estimate uses the toss"""
    flight_s: float | None = Field(default=None, ge=0, description="time in free flight and in view")
    turns_per_s: float | None = Field(default=None, ge=0, description="mean spin in turns a second")
    principal_axis_angle_rad: float | None = Field(
        default=None, ge=0, description="angle between the spin and the nearest principal axis of inertia"
    )
    residual_px: float | None = Field(
        default=None,
        ge=0,
        description="rms difference between corners (of markers or views of the print) and fitted flight",
    )
    followed_by: FollowedBy = Field(
        default=FollowedBy.TAGS, description="what the object was followed by: its tags, or its own print"
    )


class FlightResult(Document):
    """What tosses determine: centre of mass, and the inertia tensor up to its size."""

    tosses: list[TossResult]
    """all tosses in the recordings' order"""
    used: bool
    """true if the result rests on the tosses: at least one is good, and the strikes, if any, agree"""
    centre_of_mass: Quantity | None = Field(
        default=None,
        description="centre of mass by the tosses alone [m, in O]; null without a good toss",
    )
    inertia_ratios: list[Quantity] | None = Field(
        default=None,
        description="entries xx, yy, zz, xy, xz, yz of the tensor over its mean moment, by the tosses"
        " alone; null without a good toss",
    )
    disagreement: float | None = Field(
        default=None,
        ge=0,
        description="chi squared, of eight numbers, of the tosses against the strikes; null if not compared",
    )
    inertia_from: list[list[str]] | None = Field(
        default=None,
        description="per entry of the tensor what determines it: strikes, strikes and tosses, tosses with the"
        " size by strikes or by the shape, or shape",
    )
