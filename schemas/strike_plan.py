"""The plan: how to place and strike the object, and how well the answer will then be known. JSON, made by `analyze plan`."""

from __future__ import annotations

import enum
import json
from typing import TYPE_CHECKING

from pydantic import Field, model_validator

from schemas.document import SCHEMA_VERSION, Document, DocumentError, Matrix3, Matrix4, Vector3, read_text, refuse_other_major, validate
from schemas.tags import MarkerName

if TYPE_CHECKING:
    from pathlib import Path


class Pivot(Document):
    """Pivot axis in O: `point` lies on the rounding's centre line; +theta about `direction` (unit) tips."""

    point: Vector3
    direction: Vector3
    radius_m: float = Field(ge=0)
    sd_m: float = Field(ge=0, description="1 sigma of the line's position across itself")


class Impact(Document):
    """Where the striker meets the object, in O; `direction` is the striker's motion, a unit vector."""

    point: Vector3
    direction: Vector3


class Range(Document):
    """Feasible interval with the value to aim at."""

    min: float
    target: float
    max: float


class PlannedStrike(Document):
    """One strike, and how the object lies for it.

    Placed by `x_world = R_world_object x_object + p_world_object`: the pivot's centre line then lies along W's y through
    (0, 0, radius), the object tips towards +x and is struck in +x at y = 0.

    A strike with a heading is made with object and striker turned by it on the table, about W's z through the mark; the camera stays. It is
    written down in the station turned with them: everything here, `camera_pose` too, is in W turned by `heading_rad`.
    """

    id: str
    plane_id: str
    axis_id: str
    R_world_object: Matrix3
    p_world_object: Vector3
    heading_rad: float = Field(default=0.0, description="+ anticlockwise seen from above; pi: the object tips towards the station's -x")
    pivot: Pivot
    impact: Impact
    impact_height_m: float = Field(gt=0)
    impulse_n_s: Range
    tip_speed_m_s: Range
    energy_ratio: float = Field(gt=0)
    phi_predicted_rad: float
    phi_predicted_sd_rad: float = Field(ge=0)
    phi_measured_sd_rad: float | None = Field(default=None, ge=0, description="1 sigma expected of this strike's measurement")
    i_edge_predicted_kg_m2: float = Field(gt=0)
    i_edge_measured_sd_kg_m2: float | None = Field(default=None, ge=0, description="the same, of I_edge")
    visible_markers: list[MarkerName]
    camera_pose: Matrix4 = Field(description="T_world_camera that looks along the pivot axis")
    friction_needed: float = Field(ge=0)
    rolls: bool = Field(default=False, description="the edge is a rim or a curved flank: the contact can roll")
    stands_surely: bool = Field(default=True, description="false: the face holds c where it is expected, not wherever it may be")
    card: str = Field(default="", description="how to put the object down, in words")


class Rejection(Document):
    """An axis that was considered and left out, with the number behind the reason."""

    axis_id: str
    code: str
    number: float | None = None
    text: str = ""


class PredictedMoment(Document):
    """Expected of the moment about the axis through c that is parallel to a pivot."""

    axis_id: str
    i_com_sd_kg_m2: float = Field(ge=0)
    determined: bool = Field(description="known clearly better than the shape alone says")


class PredictedRegion(Document):
    """Expected of one region's mass; the median over fillings that are as likely."""

    name: str
    mass_sd_kg: float = Field(ge=0)
    determined: bool


class PredictionStep(Document):
    """How well c would be known with so many strikes."""

    strikes: int = Field(ge=1)
    com_rms_m: float = Field(ge=0)


class Prediction(Document):
    """How well every result will be known, what limits it, and whether more strikes pay. 1 sigma each, in O."""

    com_sd_m: Vector3
    com_rms_m: float = Field(ge=0, description="root mean square distance from the truth")
    target_com_m: float | None = Field(default=None, gt=0)
    target_reached: bool | None = None
    moments: list[PredictedMoment] = Field(default=[])
    inertia_sd_kg_m2: Matrix3
    inertia_determined: list[list[bool]]
    regions: list[PredictedRegion] = Field(default=[])
    error_sources_m: dict[str, float] = Field(default={}, description="part of com_rms_m by its cause; the squares add up")
    curve: list[PredictionStep] = Field(default=[])
    floor_m: float = Field(ge=0, description="com_rms_m with any number of strikes on these axes")
    stop: bool = Field(description="more strikes no longer pay: each doubling, on whatever axes, would gain less than a tenth")
    advice: str


class StrikerPrior(Document):
    """The striker as felt at its tip, as the plan reckoned with it; 1 sigma each."""

    effective_mass_kg: float = Field(gt=0)
    effective_mass_sd_kg: float = Field(gt=0)
    restitution: float = Field(ge=0, le=1)
    restitution_sd: float = Field(gt=0)


class PlanHypothesis(Document):
    """What the plan's speeds were reckoned from, for who learns from the strikes on the way."""

    com_m: Vector3 = Field(description="in O")
    com_covariance_m2: Matrix3 = Field(description="the region's half edges are two standard deviations")
    mass_kg: float = Field(gt=0)
    g_m_s2: float = Field(gt=9.7, lt=9.9)
    striker: StrikerPrior


class PlanMethod(enum.Enum):
    """How strikes were chosen."""

    OURS = "ours"
    PAPER = "paper"


class StrikePlan(Document):
    """How to place and strike the object, and how well the answer will be known (JSON)."""

    schema_version: str = SCHEMA_VERSION
    method: PlanMethod = PlanMethod.OURS
    object_name: str
    object_sha256: str
    strikes: list[PlannedStrike] = Field(min_length=1)
    predicted_com_covariance_m2: Matrix3 | None = None
    predicted_com_sd_m: float | None = Field(default=None, description="root mean square distance of c from the truth")
    prediction: Prediction | None = None
    hypothesis: PlanHypothesis | None = None
    rejected: list[Rejection] = Field(default=[])
    warnings: list[str] = Field(default=[])

    @model_validator(mode="after")
    def _unique(self) -> StrikePlan:
        ids = [strike.id for strike in self.strikes]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ValueError(f"strike id {twice[0]!r} is used twice")
        return self


def read_strike_plan(path: Path) -> StrikePlan:
    """Read and validate a StrikePlan.

    Raises:
        DocumentError: the file is missing, is not JSON, or holds an entry that cannot be used.
    """
    return parse_strike_plan(read_text(path), str(path))


def parse_strike_plan(text: str, name: str) -> StrikePlan:
    """Validate a StrikePlan given as JSON text; `name` is used in messages."""
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise DocumentError(f"{name}: not valid JSON: {error}: plans are made by `analyze plan`") from None
    except (ValueError, RecursionError):
        raise DocumentError(f"{name}: not a plan: make one with `analyze plan`") from None
    refuse_other_major(data, name)
    return validate(StrikePlan, data, name, "make it anew with `analyze plan`")
