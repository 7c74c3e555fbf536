"""The strike plan (JSON, from `analyze plan`): placements, strikes, tosses, predicted uncertainty.

Frames: O is the object's frame, W the world (z up, table z = 0). c is the centre of mass.
"""

from __future__ import annotations

import enum
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from pydantic import Field, model_validator

from schemas.document import (
    SCHEMA_VERSION,
    Document,
    DocumentError,
    Matrix3,
    Matrix4,
    Rotation3,
    SparseDocument,
    Vector3,
    read_text,
    refuse_other_major,
    validate,
)
from schemas.planned_toss import PlannedToss
from schemas.range import Range
from schemas.tags import MarkerName

if TYPE_CHECKING:
    from pathlib import Path


FOUND_PLAN_VERSION = "1.1"
"""schema version of plans whose strikes were found in images"""
TOSS_PLAN_VERSION = "1.2"
"""schema version of plans with tosses"""
AIM_ENTRIES = (
    "impact",
    "impact_height_m",
    "impulse_n_s",
    "tip_speed_m_s",
    "energy_ratio",
    "friction_needed",
)
"""entries of a planned strike that one found in images lacks"""


class Pivot(Document):
    """Pivot axis of a strike in O, the object's frame; the object tips by turning about `direction`.

    A positive tipping angle is a rotation by the right-hand rule about `direction`. The edge is taken as
    rounded by a circular arc, whose centre line is the axis.
    """

    point: Vector3 = Field(description="point on the centre line of the edge's rounding, in metres")
    direction: Vector3 = Field(description="unit vector along the axis")
    radius_m: float = Field(ge=0, description="radius of the edge's rounding")
    sd_m: float = Field(ge=0, description="1 sigma of the axis' position, perpendicular to it")


class Impact(Document):
    """Point [m] and unit direction of the striker's impact on the object, in O, the object's frame."""

    point: Vector3 = Field(description="point of contact, in metres")
    direction: Vector3 = Field(description="unit vector along the striker's motion")


@dataclass(frozen=True)
class Aim:
    """Aim of a planned strike: the place to strike, how hard, and the friction that the edge needs."""

    impact: Impact
    """point and direction of the striker's impact"""
    impact_height_m: float
    """height of the impact point above the table [m]"""
    impulse_n_s: Range
    """impulse of the strike [N s]"""
    tip_speed_m_s: Range
    """tip speed of the striker [m/s]"""
    energy_ratio: float
    """E: kinetic energy after the strike over the energy needed to reach balance"""
    friction_needed: float
    """friction coefficient that the edge needs not to slip"""


class PlannedStrike(Document):
    """One strike, and the placement of the object for it.

    Placement: `x_world = R_world_object x_object + p_world_object` [m]. The pivot's centre line (that of the
    edge's rounding) then lies along W's y through (0, 0, radius). The object tips towards +x and is struck in
    +x at y = 0. W is the world frame, z up.

    For a strike with a heading, object and striker are turned by `heading_rad` about W's z on the table, and
    the camera stays. All entries, `camera_pose` too, are then expressed in W turned by `heading_rad`.

    A strike that nobody planned (PlanMethod.IMAGES) has no aim: the place to strike, impulse, speed, energy
    ratio and friction needed are null.
    """

    id: str
    """id of the strike in the plan"""
    plane_id: str = Field(description="name of the face on which the object rests")
    axis_id: str = Field(description="name of the pivot edge")
    R_world_object: Rotation3
    p_world_object: Vector3
    heading_rad: float = Field(
        default=0.0,
        description="turn about W's z, anticlockwise seen from above; with pi the object tips towards W's -x",
    )
    pivot: Pivot
    impact: Impact | None = None
    impact_height_m: float | None = Field(
        default=None, gt=0, description="height of the impact point above the table"
    )
    impulse_n_s: Range | None = None
    """impulse of the strike [N s]"""
    tip_speed_m_s: Range | None = None
    """tip speed of the striker [m/s]"""
    energy_ratio: float | None = Field(
        default=None,
        gt=0,
        description="E: kinetic energy after the strike over the energy needed to reach balance",
    )
    phi_predicted_rad: float = Field(description="predicted balance angle phi")
    phi_predicted_sd_rad: float = Field(ge=0)
    """1 sigma of the predicted phi [rad]"""
    phi_measured_sd_rad: float | None = Field(
        default=None, ge=0, description="expected 1 sigma of phi as this strike measures it"
    )
    i_edge_predicted_kg_m2: float = Field(gt=0)
    """predicted moment of inertia about the pivot edge"""
    i_edge_measured_sd_kg_m2: float | None = Field(
        default=None, ge=0, description="expected 1 sigma of I_edge as this strike measures it"
    )
    visible_markers: list[MarkerName]
    """names of the markers that the camera sees during the tip"""
    camera_pose: Matrix4 = Field(description="T_world_camera of a camera that looks along the pivot axis")
    friction_needed: float | None = Field(
        default=None, ge=0, description="friction coefficient that the edge needs not to slip"
    )
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

    @property
    def aim(self) -> Aim:
        """Where and how hard to strike.

        Raises:
            DocumentError: the strike was found in images; nobody planned it.
        """
        impact, height, impulse, speed = (
            self.impact,
            self.impact_height_m,
            self.impulse_n_s,
            self.tip_speed_m_s,
        )
        energy, friction = self.energy_ratio, self.friction_needed
        if (
            impact is None
            or height is None
            or impulse is None
            or speed is None
            or energy is None
            or friction is None
        ):
            raise DocumentError(
                f"strike {self.id}: was found in images and not planned, so that it is not known where and "
                "how hard to strike: plan strikes with `analyze plan`"
            )
        return Aim(impact, height, impulse, speed, energy, friction)


class Rejection(Document):
    """Pivot axis or resting face that the planner left out, with the reason and the number that decided.

    A plan by the paper's method (PlanMethod.PAPER) also lists axes that it keeps although a check rejects
    them; their text begins with "kept, though".
    """

    axis_id: str
    """name of the pivot edge; for a resting face the name of the face, or "first..last" of several faces"""
    code: str
    """reason in short"""
    number: float | None = None
    """number that decided, for several faces their count; null if there is none"""
    text: str = ""
    """reason in words"""


class PredictedMoment(Document):
    """Predicted standard deviation [kg m^2] of the moment of inertia about one axis through c.

    c is the centre of mass; the axis is parallel to the pivot edge `axis_id`.
    """

    axis_id: str
    i_com_sd_kg_m2: float = Field(ge=0)
    """1 sigma of the moment of inertia about the parallel to the edge through c [kg m^2]"""
    determined: bool = Field(
        description="true if the strikes determine it clearly better than the shape alone"
    )


class PredictedRegion(Document):
    """Predicted standard deviation of the mass of one region of the object [kg].

    It is the median over fillings that are taken as equally likely. Regions are the shell (outer wall) and
    the interior on either side of a dividing plane.
    """

    name: str
    mass_sd_kg: float = Field(ge=0)
    """1 sigma of the mass [kg]"""
    determined: bool
    """true if the strikes determine the mass"""


class PredictionStep(Document):
    """Predicted root mean square error of the centre of mass with a given number of strikes."""

    strikes: int = Field(ge=1)
    com_rms_m: float = Field(ge=0)


class Prediction(Document):
    """Predicted standard deviations of all results of a plan, shares by cause, and gain of more strikes.

    Vectors and matrices are in O, the object's frame; c is the centre of mass. Shares by cause are
    contributions [m] to the root mean square error of c.
    """

    com_sd_m: Vector3
    """standard deviation of c along O's axes [m]"""
    com_rms_m: float = Field(ge=0, description="root mean square error of c")
    target_com_m: float | None = Field(default=None, gt=0)
    """largest com_rms_m that the user requested [m]; null if none"""
    target_reached: bool | None = None
    """true if com_rms_m is at most the target; null without one"""
    moments: list[PredictedMoment] = Field(default=[])
    inertia_sd_kg_m2: Matrix3
    """1 sigma of each entry of the inertia tensor about c"""
    inertia_determined: list[list[bool]]
    """(3, 3) true for each entry that the strikes determine"""
    regions: list[PredictedRegion] = Field(default=[])
    error_sources_m: dict[str, float] = Field(
        default={}, description="contribution to com_rms_m by cause; their squares add up to its square"
    )
    curve: list[PredictionStep] = Field(default=[])
    """com_rms_m by number of strikes"""
    floor_m: float = Field(ge=0, description="limit of com_rms_m for any number of strikes on these axes")
    stop: bool = Field(
        description="true if more strikes gain little: each doubling, on any axes, reduces com_rms_m by "
        "less than a tenth"
    )
    advice: str
    """advice on more strikes, in words"""


class StrikerPrior(Document):
    """Effective mass [kg] and restitution (0 to 1) of the striker that the plan assumed, with 1 sigma."""

    effective_mass_kg: float = Field(gt=0)
    effective_mass_sd_kg: float = Field(gt=0)
    restitution: float = Field(ge=0, le=1)
    restitution_sd: float = Field(gt=0)


class PlanHypothesis(Document):
    """Assumed centre of mass, mass, gravity and striker, from which the plan's tip speeds were computed.

    A session updates centre of mass and striker with each strike. O is the object's frame.
    """

    com_m: Vector3 = Field(description="centre of mass in O")
    com_covariance_m2: Matrix3 = Field(
        description="its standard deviations are half the half-edges of the box of possible centres of mass"
    )
    mass_kg: float = Field(gt=0)
    g_m_s2: float = Field(gt=9.7, lt=9.9)
    striker: StrikerPrior


class PlanMethod(enum.Enum):
    """Method by which strikes were chosen: this project's (ours), or that of the VISAPP 2013 paper.

    The paper is the one on which the project is based (docs/explanation/method.md). Strikes of the method
    `images` were not chosen: `analyze import` found them in images of strikes that nobody planned.
    """

    OURS = "ours"
    PAPER = "paper"
    IMAGES = "images"


class StrikePlan(SparseDocument):
    """Strikes and tosses to carry out, with placements and predicted uncertainty (JSON).

    Ids of strikes and tosses are unique in the plan.
    """

    left_out: ClassVar[tuple[str, ...]] = ("tosses",)

    schema_version: str = SCHEMA_VERSION
    method: PlanMethod = PlanMethod.OURS
    object_name: str
    object_sha256: str
    """identity of the object that the plan was made for"""
    strikes: list[PlannedStrike]
    """strikes; empty only where the object is to be tossed alone"""
    tosses: list[PlannedToss] = Field(default=[])
    """tosses by hand, after the strikes; not written if there are none"""
    predicted_com_covariance_m2: Matrix3 | None = None
    """predicted covariance of c, in O; null if not predicted"""
    predicted_com_sd_m: float | None = Field(default=None, description="root mean square error of c")
    prediction: Prediction | None = None
    hypothesis: PlanHypothesis | None = None
    """assumptions of the tip speeds; null in older plans"""
    rejected: list[Rejection] = Field(default=[])
    """axes and resting faces that were left out, and axes kept although a check rejects them"""
    warnings: list[str] = Field(default=[])

    @model_validator(mode="after")
    def _unique(self) -> StrikePlan:
        if not self.strikes and not self.tosses:
            raise ValueError("holds neither strikes nor tosses")
        ids = [strike.id for strike in self.strikes]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ValueError(f"strike id {twice[0]!r} is used twice")
        ids += [toss.id for toss in self.tosses]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ValueError(f"toss id {twice[0]!r} is used twice")
        return self

    @model_validator(mode="after")
    def _aims(self) -> StrikePlan:
        if self.method is not PlanMethod.IMAGES:
            for strike in self.strikes:
                missing = [name for name in AIM_ENTRIES if getattr(strike, name) is None]
                if missing:
                    raise ValueError(f"strike {strike.id!r}: {missing[0]} is missing")
        return self


def read_strike_plan(path: Path) -> StrikePlan:
    """Read and validate a strike plan (JSON) that is to be carried out.

    Returns:
        The plan: strikes with placements, and predicted uncertainty.

    Raises:
        DocumentError: the file is missing, is not JSON, holds an entry that cannot be used, or strikes that
            nobody planned.
    """
    plan = parse_strike_plan(read_text(path), str(path))
    if plan.method is PlanMethod.IMAGES:
        raise DocumentError(
            f"{path}: holds strikes that were found in images, without a place and speed to strike at: plan "
            "strikes with `analyze plan`"
        )
    return plan


def parse_strike_plan(text: str, name: str) -> StrikePlan:
    """Validate a strike plan given as JSON text.

    Args:
        text: content of a plan file.
        name: name of the file, with which error messages begin.

    Returns:
        The plan: strikes with placements, and predicted uncertainty.

    Raises:
        DocumentError: the text is not JSON, has another major schema version, or holds an entry that cannot
            be used.
    """
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise DocumentError(f"{name}: not valid JSON: {error}: plans are created by `analyze plan`") from None
    except (ValueError, RecursionError):
        raise DocumentError(f"{name}: not a plan: create one with `analyze plan`") from None
    refuse_other_major(data, name)
    return validate(StrikePlan, data, name, "create it again with `analyze plan`")
