"""Documents that pass between the two packages, as files or as JSON lines: validated at the boundary, SI units.

Frames: W world (z up, table z = 0), O object (the shape file's frame), C camera (OpenCV), M marker. See schemas/README.md.
"""

from __future__ import annotations

import enum
import hashlib
import json
import tomllib
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar, cast

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from schemas.document_problems import problems_in_one_line
from schemas.tags import USUAL_FAMILY, MarkerName, TagFamily, marker_name

SCHEMA_VERSION = "1.0"
POSE_TOLERANCE = 1e-3
"""of a rotation's columns: numbers written by hand have four digits"""
FARTHEST_M = 10.0
"""no marker or camera of a table-top rig is farther away"""
THICKEST_M = 0.1
FISHEYE_COEFFICIENTS = 4

T = TypeVar("T", bound=BaseModel)

Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix3 = Annotated[list[Vector3], Field(min_length=3, max_length=3)]
Row4 = Annotated[list[float], Field(min_length=4, max_length=4)]
Matrix4 = Annotated[list[Row4], Field(min_length=4, max_length=4)]


class DocumentError(ValueError):
    """A document that cannot be used: one line that names the file, the entry and the remedy."""


class Document(BaseModel):
    """Base of all documents: unknown keys and non-finite numbers are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    by_hand: ClassVar[bool] = False
    """people write it: what is missing is said with how to add it"""


# --- the object ---------------------------------------------------------------------------------------------------


class LengthUnit(enum.Enum):
    """Unit of a shape file's coordinates; there is no default, because a guess would be wrong by 1000."""

    METRE = "m"
    CENTIMETRE = "cm"
    MILLIMETRE = "mm"
    INCH = "in"

    @property
    def metres(self) -> float:
        """Length of one unit [m]."""
        return {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}[self.value]


class Box(Document):
    """Cuboid centred on O, edges along O's axes."""

    size_m: Vector3 = Field(description="its edges along x, y, z, in metres")

    @field_validator("size_m")
    @classmethod
    def _positive(cls, value: list[float]) -> list[float]:
        if min(value) <= 0:
            raise ValueError("every edge must be longer than 0")
        return value


class Cylinder(Document):
    """Cylinder centred on O, axis along O's z."""

    radius_m: float = Field(gt=0, description="in metres")
    height_m: float = Field(gt=0, description="in metres")


class Shape(Document):
    """Exterior of the object: a file with its unit, or one primitive."""

    file: str | None = None
    unit: LengthUnit | None = None
    scale_sd: float = Field(default=0.0, ge=0, description="relative 1 sigma of the shape's scale")
    surface_sd_m: float = Field(
        default=0.0,
        ge=0,
        description="1 sigma of how far all of the surface may lie off together (a scanner's bias), which more points do not lessen",
    )
    box: Box | None = None
    cylinder: Cylinder | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Shape:
        given = [name for name in ("file", "box", "cylinder") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give exactly one of file, box, cylinder (found {', '.join(given) or 'none'})")
        if self.file is not None and self.unit is None:
            raise ValueError('a shape file needs its unit: unit = "mm" (or "m", "cm", "in")')
        if self.surface_sd_m > THICKEST_M:
            raise ValueError(f"surface_sd_m = {self.surface_sd_m:g} m is no scanner's error: it is in metres")
        if self.file is None and self.unit is not None:
            raise ValueError("unit belongs to a shape file; box and cylinder are in metres")
        return self


def _check_pose(T: list[list[float]]) -> None:
    """Raise ValueError unless T is a rotation and a translation in metres."""
    columns = list(zip(*T[:3], strict=True))[:3]
    dots = [sum(a * b for a, b in zip(columns[i], columns[j], strict=True)) for i in range(3) for j in range(i, 3)]
    (a, b, c), (d, e, f), (g, h, i) = (row[:3] for row in T[:3])
    right_handed = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
    if max(abs(dot - one) for dot, one in zip(dots, (1, 0, 0, 1, 0, 1), strict=True)) > POSE_TOLERANCE or not right_handed:
        raise ValueError("its upper left 3 x 3 is no rotation: columns of length 1, square to each other, right-handed")
    if T[3] != [0, 0, 0, 1]:
        raise ValueError("its last row must be 0, 0, 0, 1")
    far = max(abs(row[3]) for row in T[:3])
    if far > FARTHEST_M:
        raise ValueError(f"its translation is {far:g} m: translations are in metres ({far:g} mm would be {far / 1000:g})")


class MarkerSpec(Document):
    """One square marker glued to the object. `T_object_marker` maps M to O: M's x right, y up, z out of the marker's face."""

    family: TagFamily = USUAL_FAMILY
    id: int = Field(ge=0, description="number of the tag in its family, from 0")
    size_m: float = Field(gt=0.002, lt=0.5, description="edge of the black square, in metres")
    mass_kg: float = Field(default=0.0, ge=0)
    thickness_m: float = Field(default=0.0, ge=0)
    T_object_marker: Matrix4 | None = None

    @property
    def name(self) -> int | str:
        """What it is called wherever a marker is meant: see `marker_name`."""
        return marker_name(self.family, self.id)

    @field_validator("family", mode="before")
    @classmethod
    def _family(cls, value: object) -> object:
        if isinstance(value, str) and value not in set(TagFamily):
            raise ValueError(f"{value!r} is no tag family: choose {', '.join(TagFamily)}")
        return value

    @field_validator("id")
    @classmethod
    def _in_family(cls, value: int, info: ValidationInfo) -> int:
        family = info.data.get("family")
        if isinstance(family, TagFamily) and value >= family.size:
            raise ValueError(f"{family} has no tag {value}: its ids are 0 to {family.size - 1}")
        return value

    @field_validator("T_object_marker")
    @classmethod
    def _pose(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is not None:
            _check_pose(value)
        return value


class ObjectSpec(Document):
    """What the user knows of the object (TOML). Inner masses have no place here: they are what is asked."""

    by_hand: ClassVar[bool] = True

    name: str = Field(min_length=1, description="what to call the object")
    mass_kg: float = Field(gt=0, description="what it weighs, in kilograms")
    mass_sd_kg: float = Field(gt=0, description="1 sigma of the scale, in kilograms")
    mass_includes_markers: bool = True
    shape: Shape = Field(description="file and unit, or [shape.box] with size_m, or [shape.cylinder] with radius_m and height_m")
    edge_radius_m: float = Field(default=0.0, ge=0)
    edge_radius_sd_m: float = Field(default=0.0, ge=0)
    shell_thickness_m: float | None = Field(default=None, gt=0)
    labels: str | None = None
    marker: list[MarkerSpec] = Field(min_length=1, description="for each tag: id, size_m, T_object_marker")

    @field_validator("shell_thickness_m", "edge_radius_m")
    @classmethod
    def _metres(cls, value: float | None) -> float | None:
        if value is not None and value > THICKEST_M:
            raise ValueError(f"{value:g} m is no wall or edge: it is in metres ({value:g} mm would be {value / 1000:g})")
        return value

    @field_validator("mass_kg")
    @classmethod
    def _grams(cls, value: float) -> float:
        if value > 20.0:
            raise ValueError(f"{value:g} kg is too heavy for a striker: mass_kg is in kilograms ({value:g} g would be {value / 1000:g})")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> ObjectSpec:
        names = [marker.name for marker in self.marker]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ValueError(f"marker id {twice[0]} is listed twice: every marker on an object needs its own id")
        alike = {marker.family.codes: marker.family for marker in self.marker}
        for marker in self.marker:
            if marker.family is not alike[marker.family.codes]:
                raise ValueError(
                    f"marker families {marker.family} and {alike[marker.family.codes]} share their codes: name all such tags by one of them"
                )
        if self.mass_sd_kg >= self.mass_kg:
            raise ValueError("mass_sd_kg is not below mass_kg: it is the scale's 1 sigma, in kilograms")
        return self


# --- the plan -----------------------------------------------------------------------------------------------------


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
    """

    id: str
    plane_id: str
    axis_id: str
    R_world_object: Matrix3
    p_world_object: Vector3
    heading_rad: float = 0.0
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
    moments: list[PredictedMoment] = []
    inertia_sd_kg_m2: Matrix3
    inertia_determined: list[list[bool]]
    regions: list[PredictedRegion] = []
    error_sources_m: dict[str, float] = Field(default={}, description="part of com_rms_m by its cause; the squares add up")
    curve: list[PredictionStep] = []
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
    rejected: list[Rejection] = []
    warnings: list[str] = []

    @model_validator(mode="after")
    def _unique(self) -> StrikePlan:
        ids = [strike.id for strike in self.strikes]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ValueError(f"strike id {twice[0]!r} is used twice")
        return self


# --- the recording ------------------------------------------------------------------------------------------------


class TimeSource(enum.Enum):
    """Where the frames' log times come from."""

    DEVICE_MAPPED = "device_mapped"
    HOST_ARRIVAL = "host_arrival"
    CONTAINER_PTS = "container_pts"


class LensModel(enum.Enum):
    """How a lens draws, in OpenCV's terms."""

    PINHOLE = "pinhole"
    FISHEYE = "fisheye"


class CameraCalibrationSpec(Document):
    """Pinhole with OpenCV distortion (k1, k2, p1, p2, k3), or OpenCV's fisheye (k1, k2, k3, k4), and the camera's place in W."""

    model: LensModel = LensModel.PINHOLE
    width: int = Field(gt=0, description="of the image, in pixels")
    height: int = Field(gt=0, description="of the image, in pixels")
    K: Matrix3 = Field(description="focal lengths and middle of the image in pixels, 3 x 3")
    distortion: list[float] = Field(default=[0.0] * 5, min_length=4, max_length=8)
    T_world_camera: Matrix4 = Field(description="the camera's pose, 4 x 4, in metres")
    rms_px: float | None = None

    @field_validator("T_world_camera")
    @classmethod
    def _pose(cls, value: list[list[float]]) -> list[list[float]]:
        _check_pose(value)
        return value

    @model_validator(mode="after")
    def _coefficients(self) -> CameraCalibrationSpec:
        if self.model is LensModel.FISHEYE and len(self.distortion) != FISHEYE_COEFFICIENTS and any(self.distortion):
            raise ValueError(
                f"a fisheye has {FISHEYE_COEFFICIENTS} coefficients k1, k2, k3, k4, not {len(self.distortion)}: calibrate with "
                "--model fisheye, or leave `model` out"
            )
        return self


class ManifestCamera(Document):
    """One camera of the recording; its topics are /camera/<name>/..."""

    name: str
    vendor: str = ""
    model: str = ""
    serial: str = ""
    frame_rate_hz: float = Field(gt=0)
    exposure_us: float = Field(gt=0)
    calibration: CameraCalibrationSpec


class SessionManifest(Document):
    """First thing in every recording (MCAP metadata `percuss.manifest`): what is needed to read the rest years later."""

    schema_version: str = SCHEMA_VERSION
    recording_id: str
    created: str = Field(description="ISO 8601, UTC")
    software: str = Field(description="percuss version and git commit")
    wall_anchor_ns: int = Field(description="wall clock minus host monotonic clock, read once at the start")
    time_source: TimeSource
    time_source_sd_ns: int = Field(ge=0)
    g_m_s2: float = Field(gt=9.7, lt=9.9)
    g_sd_m_s2: float = Field(ge=0)
    gravity_tilt_sd_rad: float = Field(ge=0, description="1 sigma of the table's normal against the vertical")
    cameras: list[ManifestCamera] = Field(min_length=1)
    striker: dict[str, Any] = {}
    rig: dict[str, Any] = {}
    object: ObjectSpec
    object_sha256: str
    plan_sha256: str
    hashes: dict[str, str] = Field(default={}, description="attachment name -> sha256")
    random_seed: int | None = None
    part: int = Field(default=1, ge=1, description="number of this file in a continuous recording's row of files")


MANIFEST_NAME = "percuss.manifest"
SEAL_NAME = "percuss.seal"
PLAN_ATTACHMENT = "plan.json"
OBJECT_ATTACHMENT = "object.toml"
RIG_ATTACHMENT = "rig.toml"
SHAPE_ATTACHMENT_PREFIX = "shape/"


# --- results ------------------------------------------------------------------------------------------------------


class Quantity(Document):
    """A result. Not observed: value and sd are null, or the unobserved directions are named beside the rest."""

    value: float | list[float] | list[list[float]] | None
    unit: str
    sd: float | list[float] | None = None
    covariance: list[list[float]] | None = None
    interval95: list[float] | list[list[float]] | None = None
    frame: str | None = None
    observed: bool = True
    unobserved_direction: list[float] | None = None
    source: Literal["measured", "prior", "given"] = "measured"


class Verdict(enum.Enum):
    """How a strike ended."""

    GOOD = "good"
    ROCKED_BACK = "rocked_back"
    SLID = "slid"
    ROLLED = "rolled"
    TWISTED = "twisted"
    AIRBORNE = "airborne"
    STRUCK_TWICE = "struck_twice"
    MARKER_LOST = "marker_lost"
    NOT_MOVED = "not_moved"
    WRONG_PLACEMENT = "wrong_placement"
    EXCLUDED = "excluded"
    UNREADABLE = "unreadable"


class WarningCode(enum.Enum):
    """What a reader of the result must know."""

    RECORDING_INCOMPLETE = "recording_incomplete"
    RECORDINGS_DISAGREE = "recordings_disagree"
    FEW_STRIKES = "few_strikes"
    DIRECTION_UNOBSERVED = "direction_unobserved"
    OBJECT_OVERRIDDEN = "object_overridden"
    STRIKES_EXCLUDED = "strikes_excluded"
    FRAMES_LOST = "frames_lost"
    MARKERS_INCLUDED = "markers_included"
    ESTIMATORS_DISAGREE = "estimators_disagree"
    CENTRE_OUTSIDE_SHAPE = "centre_outside_shape"
    POOR_FIT = "poor_fit"
    GRAVITY_ASSUMED = "gravity_assumed"
    INERTIA_FROM_PRIOR = "inertia_from_prior"
    REGIONS_UNCERTAIN = "regions_uncertain"
    UNKNOWN_MARKER = "unknown_marker"
    ROLLING_CONTACT = "rolling_contact"


class ResultWarning(Document):
    """One warning."""

    code: WarningCode
    text: str


class AlternativeFit(Document):
    """A second estimator's answer for the same strike, printed beside the one used."""

    estimator: str
    phi: Quantity
    k: Quantity | None = None
    note: str = ""
    violated: list[str] = []
    """assumptions of the estimator that the motion did not keep"""


class StrikeResult(Document):
    """One strike's outcome."""

    id: str
    plan_strike_id: str
    axis_id: str
    plane_id: str
    verdict: Verdict
    reason: str = ""
    used: bool
    weight: float = Field(ge=0)
    estimator: str | None = None
    estimator_note: str = ""
    """why this one, and why this window"""
    window_ns: list[int] | None = None
    phi: Quantity | None = None
    k: Quantity | None = None
    cov_phi_k: list[list[float]] | None = None
    i_edge: Quantity | None = None
    energy_ratio: float | None = None
    residual_rms_rad: float | None = None
    equiplane_residual_m: float | None = None
    alternatives: list[AlternativeFit] = []


class AxisMoment(Document):
    """Moments about one pivot axis: at the contact line, and about the parallel axis through c."""

    axis_id: str
    direction: Vector3
    i_edge: Quantity
    i_com: Quantity


class RegionResult(Document):
    """One region's mass with its name (surface, upper, lower, or a label)."""

    name: str
    mass: Quantity


class Regions(Document):
    """Masses of the shell and the two interior parts, the border plane (n.x = offset, in O) and its rivals."""

    regions: list[RegionResult]
    border_normal: Vector3 | None
    border_offset_m: float | None
    border_offset_interval95_m: list[float] | None = None
    baselines: dict[str, list[float]] = Field(default={}, description="naive answers: name -> masses [kg]")


class JoinedRecording(Document):
    """One of several recordings that a result is of."""

    number: int = Field(ge=1, description="by the time at which they began; its strikes are `<number>:<strike>`")
    recording_id: str
    content_id: str
    created: str
    plan_sha256: str


class ResultInputs(Document):
    """What went in. Of several recordings `content_id` is the SHA-256 of theirs, sorted, a line each, and `plan_sha256` of their plans'."""

    recording_id: str
    content_id: str
    object_sha256: str
    plan_sha256: str
    configuration_sha256: str
    software: str
    recordings: list[JoinedRecording] | None = Field(default=None, description="not written where there is one")

    @model_serializer(mode="wrap")
    def _as_before(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A result of one recording has the bytes that it always had."""
        written: dict[str, Any] = write(self)
        if self.recordings is None:
            del written["recordings"]
        return written


class Result(Document):
    """What `analyze estimate --json` prints."""

    schema_version: str = SCHEMA_VERSION
    inputs: ResultInputs
    warnings: list[ResultWarning]
    strikes: list[StrikeResult]
    mass: Quantity
    centre_of_mass: Quantity
    centre_of_mass_paper: Quantity | None = None
    moments: list[AxisMoment]
    inertia: Quantity
    inertia_measured: list[list[bool]] | None = None
    regions: Regions | None
    regions_paper: Regions | None = None


# --- run time: `analyze watch` ------------------------------------------------------------------------------------


class SeenMarker(Document):
    """A marker in the newest image."""

    id: MarkerName
    corners_px: list[list[float]]


class WatchEvent(Document):
    """Before a strike, a few times a second, as one JSON line."""

    kind: Literal["watch"] = "watch"
    time_ns: int = Field(description="log_time of the image")
    markers: list[SeenMarker]
    at_rest: bool
    saturated_fraction: float
    placement_error_rad: float | None = Field(default=None, description="resting pose against the plan's, if a plan strike is set")
    text: str = ""


_LogTime = Annotated[int, Field(ge=0, lt=1 << 63)]


class JudgeRequest(Document):
    """Line on `analyze watch`'s standard input: judge this window. With `expect` only: check the placement for that plan strike."""

    kind: Literal["judge", "expect"] = "judge"
    plan_strike_id: str
    strike_id: str = ""
    window_start_ns: _LogTime = 0
    window_end_ns: _LogTime = 0
    contact_time_ns: _LogTime = 0


class StrikeVerdict(Document):
    """Answer to a JudgeRequest."""

    kind: Literal["verdict"] = "verdict"
    strike_id: str
    code: Verdict
    reason: str
    phi: float | None = None
    phi_sd: float | None = None
    energy_ratio: float | None = None
    theta_max_rad: float | None = Field(default=None, description="how far an object that rocked back had turned")
    contact_time_ns: int | None = Field(default=None, description="log time of the contact as the images tell it")
    contact_time_sd_ns: float | None = None


# --- reading and hashing ------------------------------------------------------------------------------------------


def read_object_spec(path: Path) -> ObjectSpec:
    """Read and validate an ObjectSpec.

    Raises:
        DocumentError: the file is missing, is not TOML, or holds an entry that cannot be used.
    """
    return parse_object_spec(_read_text(path), str(path))


def parse_object_spec(text: str, name: str) -> ObjectSpec:
    """Validate an ObjectSpec given as TOML text; `name` is used in messages."""
    try:
        data = tomllib.loads(text)
    except ValueError as error:  # tomllib.TOMLDecodeError, and int's refusal of thousands of digits
        raise DocumentError(f"{name}: not valid TOML: {error}") from None
    except RecursionError:
        raise DocumentError(f"{name}: not an object file: its brackets are nested too deep") from None
    return validate(ObjectSpec, data, name)


def read_strike_plan(path: Path) -> StrikePlan:
    """Read and validate a StrikePlan.

    Raises:
        DocumentError: the file is missing, is not JSON, or holds an entry that cannot be used.
    """
    return parse_strike_plan(_read_text(path), str(path))


def parse_strike_plan(text: str, name: str) -> StrikePlan:
    """Validate a StrikePlan given as JSON text; `name` is used in messages."""
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise DocumentError(f"{name}: not valid JSON: {error}: plans are made by `analyze plan`") from None
    except (ValueError, RecursionError):
        raise DocumentError(f"{name}: not a plan: make one with `analyze plan`") from None
    _refuse_other_major(data, name)
    return validate(StrikePlan, data, name, "make it anew with `analyze plan`")


def validate(model: type[T], data: object, name: str, remedy: str = "") -> T:
    """Validate `data` as `model`; its problems become one line that starts with `name` and ends with the remedy."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        by_hand = issubclass(model, Document) and model.by_hand
        raise DocumentError(
            f"{name}: {problems_in_one_line(error, model, data, by_hand=by_hand)}{f': {remedy}' if remedy else ''}"
        ) from None


def _refuse_other_major(data: object, name: str) -> None:
    found = cast("dict[str, object]", data).get("schema_version") if isinstance(data, dict) else None
    ours = SCHEMA_VERSION.split(".", maxsplit=1)[0]
    if isinstance(found, str) and found.split(".", maxsplit=1)[0] != ours:
        raise DocumentError(f"{name}: has schema version {found}, this program reads {ours}.x: make it anew with `analyze plan`")


def sha256_text(text: str) -> str:
    """SHA-256 of UTF-8 text, as hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def object_sha256(spec: ObjectSpec, shape_bytes: bytes | None) -> str:
    """Identity of an object: its specification and its shape file's bytes. What a plan is bound to.

    Entries that came after 1.0 count only where they are given, so that older recordings keep their identity.
    """
    known = spec.model_dump(mode="json")
    if not spec.shape.surface_sd_m:
        del known["shape"]["surface_sd_m"]
    digest = hashlib.sha256(json.dumps(known, sort_keys=True, separators=(",", ":"), allow_nan=False).encode())
    if shape_bytes is not None:
        digest.update(hashlib.sha256(shape_bytes).digest())
    return digest.hexdigest()


def canonical_json(document: Document) -> str:
    """One line of JSON with sorted keys: the same document gives the same bytes."""
    return json.dumps(document.model_dump(mode="json"), sort_keys=True, separators=(",", ":"), allow_nan=False)


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise DocumentError(f"{path}: no such file: check the path") from None
    except UnicodeDecodeError:
        raise DocumentError(f"{path}: is not a text file") from None
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read: {error.strerror}") from None
