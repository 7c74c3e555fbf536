"""The strike plan (JSON, from `analyze plan`): placements, strikes and predicted uncertainty."""

from __future__ import annotations

import enum
import json
from typing import TYPE_CHECKING

from pydantic import Field, model_validator

from schemas.document import (
    SCHEMA_VERSION,
    Document,
    DocumentError,
    Matrix3,
    Matrix4,
    Vector3,
    read_text,
    refuse_other_major,
    validate,
)
from schemas.tags import MarkerName

if TYPE_CHECKING:
    from pathlib import Path


class Pivot(Document):
    """Pivot axis in O. Rotating by +theta about the unit vector `direction` tips the object."""

    point: Vector3 = Field(description="point on the centre line of the edge's rounding, in metres")
    direction: Vector3 = Field(description="unit vector along the axis")
    radius_m: float = Field(ge=0, description="radius of the edge's rounding")
    sd_m: float = Field(ge=0, description="1 sigma of the axis' position, perpendicular to it")


class Impact(Document):
    """Impact of the striker on the object, in O."""

    point: Vector3 = Field(description="point of contact, in metres")
    direction: Vector3 = Field(description="unit vector along the striker's motion")


class Range(Document):
    """Feasible interval and the target value in it."""

    min: float
    target: float
    max: float


class PlannedStrike(Document):
    """One strike and the placement of the object for it.

    Placement: `x_world = R_world_object x_object + p_world_object`. The pivot's centre line then lies along
    W's y through (0, 0, radius); the object tips towards +x and is struck in +x at y = 0.

    For a strike with a heading, object and striker are turned by `heading_rad` about W's z on the table, and
    the camera stays. All entries, `camera_pose` too, are then expressed in W turned by `heading_rad`.
    """

    id: str
    plane_id: str = Field(description="name of the face on which the object rests")
    axis_id: str = Field(description="name of the pivot edge")
    R_world_object: Matrix3
    p_world_object: Vector3
    heading_rad: float = Field(
        default=0.0,
        description="turn about W's z, anticlockwise seen from above; with pi the object tips towards W's -x",
    )
    pivot: Pivot
    impact: Impact
    impact_height_m: float = Field(gt=0, description="height of the impact point above the table")
    impulse_n_s: Range
    tip_speed_m_s: Range
    energy_ratio: float = Field(
        gt=0, description="E: kinetic energy after the strike over the energy needed to reach balance"
    )
    phi_predicted_rad: float = Field(description="predicted balance angle phi")
    phi_predicted_sd_rad: float = Field(ge=0)
    phi_measured_sd_rad: float | None = Field(
        default=None, ge=0, description="expected 1 sigma of phi as this strike measures it"
    )
    i_edge_predicted_kg_m2: float = Field(gt=0)
    i_edge_measured_sd_kg_m2: float | None = Field(
        default=None, ge=0, description="expected 1 sigma of I_edge as this strike measures it"
    )
    visible_markers: list[MarkerName]
    camera_pose: Matrix4 = Field(description="T_world_camera of a camera that looks along the pivot axis")
    friction_needed: float = Field(ge=0, description="friction coefficient that the edge needs not to slip")
    rolls: bool = Field(
        default=False,
        description="true if the edge is a rim or a curved flank, on which the contact can roll",
    )
    stands_surely: bool = Field(
        default=True,
        description="false if the object stands on this face only for the expected centre of mass, not for "
        "every possible one",
    )
    card: str = Field(default="", description="instruction in words how to place the object")


class Rejection(Document):
    """Axis that was considered and left out, with the reason and the number that decided."""

    axis_id: str
    code: str
    number: float | None = None
    text: str = ""


class PredictedMoment(Document):
    """Predicted uncertainty of the moment about the axis through c that is parallel to a pivot."""

    axis_id: str
    i_com_sd_kg_m2: float = Field(ge=0)
    determined: bool = Field(
        description="true if the strikes determine it clearly better than the shape alone"
    )


class PredictedRegion(Document):
    """Predicted uncertainty of one region's mass: median over equally likely fillings."""

    name: str
    mass_sd_kg: float = Field(ge=0)
    determined: bool


class PredictionStep(Document):
    """Predicted error of the centre of mass c with a number of strikes."""

    strikes: int = Field(ge=1)
    com_rms_m: float = Field(ge=0)


class Prediction(Document):
    """Predicted uncertainty of every result (1 sigma, in O), its causes, and the gain of more strikes."""

    com_sd_m: Vector3
    com_rms_m: float = Field(ge=0, description="root mean square error of c")
    target_com_m: float | None = Field(default=None, gt=0)
    target_reached: bool | None = None
    moments: list[PredictedMoment] = Field(default=[])
    inertia_sd_kg_m2: Matrix3
    inertia_determined: list[list[bool]]
    regions: list[PredictedRegion] = Field(default=[])
    error_sources_m: dict[str, float] = Field(
        default={}, description="contribution to com_rms_m by cause; their squares add up to its square"
    )
    curve: list[PredictionStep] = Field(default=[])
    floor_m: float = Field(ge=0, description="limit of com_rms_m for any number of strikes on these axes")
    stop: bool = Field(
        description="true if more strikes gain little: each doubling, on any axes, reduces com_rms_m by "
        "less than a tenth"
    )
    advice: str


class StrikerPrior(Document):
    """Effective mass and restitution of the striker that the plan assumed, with 1 sigma each."""

    effective_mass_kg: float = Field(gt=0)
    effective_mass_sd_kg: float = Field(gt=0)
    restitution: float = Field(ge=0, le=1)
    restitution_sd: float = Field(gt=0)


class PlanHypothesis(Document):
    """Assumptions from which the tip speeds were computed; a session updates them with each strike."""

    com_m: Vector3 = Field(description="centre of mass in O")
    com_covariance_m2: Matrix3 = Field(
        description="its standard deviations are half the half-edges of the box of possible centres of mass"
    )
    mass_kg: float = Field(gt=0)
    g_m_s2: float = Field(gt=9.7, lt=9.9)
    striker: StrikerPrior


class PlanMethod(enum.Enum):
    """Method by which strikes were chosen."""

    OURS = "ours"
    PAPER = "paper"


class StrikePlan(Document):
    """Strikes to carry out, with placements and predicted uncertainty (JSON)."""

    schema_version: str = SCHEMA_VERSION
    method: PlanMethod = PlanMethod.OURS
    object_name: str
    object_sha256: str
    strikes: list[PlannedStrike] = Field(min_length=1)
    predicted_com_covariance_m2: Matrix3 | None = None
    predicted_com_sd_m: float | None = Field(default=None, description="root mean square error of c")
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
        raise DocumentError(f"{name}: not valid JSON: {error}: plans are created by `analyze plan`") from None
    except (ValueError, RecursionError):
        raise DocumentError(f"{name}: not a plan: create one with `analyze plan`") from None
    refuse_other_major(data, name)
    return validate(StrikePlan, data, name, "create it again with `analyze plan`")
