"""One planned toss: a person throws the object, spinning, in view of the camera.

Frames: O is the object's frame, W the world (z up, table z = 0). c is the centre of mass.
"""

from __future__ import annotations

import math

from pydantic import Field, field_validator, model_validator

from schemas.document import Document, Rotation3, Vector3
from schemas.range import Range

UNIT_TOLERANCE = 1e-3
"""largest error of a unit vector's length: numbers typed by people have four digits"""


class PlannedToss(Document):
    """One toss by hand: axis and speed of the spin, time in the air, and place of the flight.

    The object leaves the hand below `p_world_apex`, rises by g T^2/8, where T is the time in the air, and
    falls on a cushion. In the air it turns about its centre of mass c. The camera is that of the strikes and
    does not move.

    The object is held as `R_world_object` turns it into W when it leaves the hand; only the direction of the
    spin axis in O matters for what is measured.
    """

    id: str
    """id of the toss in the plan, such as "t1"; different from the ids of all strikes"""
    spin_axis_object: Vector3 = Field(
        description="unit vector in O about which the object is to spin, by the right-hand rule"
    )
    turns_per_s: Range
    """spin [turns/s]"""
    flight_s: Range
    """time in the air, from leaving the hand to touching the cushion [s]"""
    R_world_object: Rotation3
    """how the object is held when it leaves the hand"""
    p_world_apex: Vector3 = Field(
        description="place of c in W at the top of the flight, in metres; the whole flight is in view there"
    )
    principal_axis_angle_rad: float | None = Field(
        default=None,
        ge=0,
        le=math.pi / 2,
        description="angle between the spin axis and the nearest principal axis of inertia as predicted from "
        "the shape; null if not predicted",
    )
    smallest_tag_px: float | None = Field(
        default=None,
        gt=0,
        description="predicted side in the image of the object's smallest tag at the top of the flight; null "
        "if not predicted, or without tags",
    )
    card: str = Field(default="", description="instruction in words how to toss the object")

    @field_validator("spin_axis_object")
    @classmethod
    def _unit(cls, axis: list[float]) -> list[float]:
        if abs(math.hypot(*axis) - 1.0) > UNIT_TOLERANCE:
            raise ValueError(f"is not a unit vector: its length is {math.hypot(*axis):.4g}")
        return axis

    @model_validator(mode="after")
    def _ranges(self) -> PlannedToss:
        for name in ("turns_per_s", "flight_s"):
            given: Range = getattr(self, name)
            if not 0 < given.min <= given.target <= given.max:
                raise ValueError(f"{name} must have 0 < min <= target <= max")
        return self
