"""The Result document, printed by `analyze estimate --json`.

Schema 2.0 renamed keys of 1.x (docs/reference/renamed-keys.md); documents of 1.x are read and take the new
names.
"""

from __future__ import annotations

import enum
from typing import Any, ClassVar, Literal, cast

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from schemas.document import Document, Vector3

RESULT_VERSION = "2.0"
"""Schema version of results, reports and comparisons; recordings and plans have their own."""
RENAMED_CODES = {
    "strike_not_foretold": "strike_not_predicted",
    "filling_turns_with_it": "filling_assumed_rigid",
}
"""Warning codes of version 2.0, by their codes in 1.x."""


def _entries(data: object) -> dict[str, Any] | None:
    """Entries of a JSON object; None if it is something else."""
    return cast("dict[str, Any]", data) if isinstance(data, dict) else None


class RenamedDocument(Document):
    """Base of result documents whose keys were renamed: reads the old key, writes the new one."""

    renamed: ClassVar[dict[str, str]] = {}
    """New key by old key."""

    @model_validator(mode="before")
    @classmethod
    def _take_new_names(cls, data: Any) -> Any:
        entries = _entries(data)
        return (
            data if entries is None else {cls.renamed.get(key, key): value for key, value in entries.items()}
        )


class SparseDocument(Document):
    """Base of result documents that leave out optional entries without a value."""

    left_out_if_none: ClassVar[tuple[str, ...]] = ()
    """Names of entries that are not written if they are None."""

    @model_serializer(mode="wrap")
    def _without_empty_entries(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = write(self)
        for name in self.left_out_if_none:
            if written[name] is None:
                del written[name]
        return written


class Quantity(Document):
    """A quantity with unit, sd and 95 % interval; value and sd may be null if not observed."""

    value: float | list[float] | list[list[float]] | None
    """number, vector (3,) or matrix (3, 3), in `unit`; null if not observed"""
    unit: str
    sd: float | list[float] | None = None
    """1 sigma of each component, in `unit`; nine numbers row by row for a matrix"""
    covariance: list[list[float]] | None = None
    """(3, 3) covariance of a vector, in `unit` squared"""
    interval95: list[float] | list[list[float]] | None = None
    """lower and upper end of the 95 % interval; one such pair per component of a vector"""
    frame: str | None = None
    """frame of a vector or matrix, such as O; null for a scalar"""
    observed: bool = True
    """false if no strike determines the quantity, or one of its directions"""
    unobserved_direction: list[float] | None = None
    """unit direction (3,) in which a vector is not observed"""
    source: Literal["measured", "prior", "given"] = "measured"
    """origin of the number; for several numbers that of the weakest (`inertia_measured` has it entry by
    entry)"""

    def as_scalar(self) -> float:
        """Value of a scalar quantity.

        Raises:
            TypeError: the quantity is a vector or matrix, or has no value.
        """
        if not isinstance(self.value, float):
            raise TypeError(f"no scalar value: {self.value!r}")
        return self.value

    def interval_ends(self) -> tuple[float, float]:
        """Ends of a scalar quantity's 95 % interval.

        Raises:
            TypeError: the quantity is a vector or matrix, or has no interval.
        """
        match self.interval95:
            case [float(low), float(high)]:
                return low, high
            case _:
                raise TypeError(f"no interval of a scalar: {self.interval95!r}")


class Verdict(enum.Enum):
    """Outcome of a strike."""

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
    """Codes of warnings about a result."""

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
    MARKERS_UNPLACED = "markers_unplaced"
    ROLLING_CONTACT = "rolling_contact"
    MARKERS_SUBTRACTED = "markers_subtracted"
    STRIKE_NOT_PREDICTED = "strike_not_predicted"
    MOMENT_IMPOSSIBLE = "moment_impossible"
    GRAVITY_DISAGREES = "gravity_disagrees"
    FILLING_ASSUMED_RIGID = "filling_assumed_rigid"
    FILLING_UNEXPLAINED = "filling_unexplained"
    FRAME_RATE_WRONG = "frame_rate_wrong"
    FRAME_RATE_UNCHECKED = "frame_rate_unchecked"


class ResultWarning(Document):
    """One warning: its code and a sentence."""

    code: WarningCode
    text: str


class AlternativeFit(Document):
    """Phi and k of the same strike by another estimator than the one used."""

    estimator: str
    phi: Quantity
    k: Quantity | None = None
    note: str = ""
    violated: list[str] = Field(default=[])
    """assumptions of the estimator that the motion violates"""


class PredictionResult(RenamedDocument):
    """Leave-one-out prediction of one strike from all others, compared with its measurement."""

    renamed: ClassVar[dict[str, str]] = {"foretold": "consistent"}

    phi: Quantity = Field(description="predicted balance angle; sd of the prediction")
    k: Quantity = Field(description="predicted k; sd of the prediction")
    sigmas: float = Field(
        ge=0, description="standardised difference of phi and k together, measured less predicted"
    )
    motion_sigmas: float = Field(
        ge=0,
        description=(
            "standardised difference of theta(t), started from the first free frames with the predicted phi"
            " and k"
        ),
    )
    consistent: bool = Field(description="true if both standardised differences are at most 3")
    frames: int = Field(
        description=(
            "frames of theta(t) compared: until the prediction's sd exceeds 3 deg, or the free motion ends"
        )
    )
    start_frames: int = Field(description="frames before them, which only give the start")
    worst_offset_rad: float = Field(
        description="measured less predicted theta at the frame with the largest standardised difference"
    )
    worst_band_rad: float = Field(description="1.96 sd of the difference at that frame")
    outside_share: float = Field(
        ge=0, le=1, description="share of frames that differ by more than 1.96 sd; 0.05 is expected"
    )


class StrikeResult(RenamedDocument):
    """Outcome of one strike."""

    renamed: ClassVar[dict[str, str]] = {"weight": "information_share", "foretold": "prediction"}

    id: str = Field(description="id of the strike in the recording: plan strike and attempt, as `s3.1`")
    plan_strike_id: str = Field(description="id of the planned strike")
    axis_id: str = Field(description="name of the pivot edge")
    plane_id: str = Field(description="name of the face on which the object rested")
    heading_rad: float = Field(
        default=0.0, description="heading of object and striker on the table, as planned; 0 is not written"
    )
    verdict: Verdict
    reason: str = Field(default="", description="reason for the verdict")
    used: bool = Field(description="true if the result uses this strike")
    information_share: float = Field(
        ge=0, description="share of the information about the centre of mass; 0 if not used"
    )
    estimator: str | None = None
    estimator_note: str = ""
    """reason for this estimator and this window"""
    window_ns: list[int] | None = Field(
        default=None, description="log times [ns] of the first and last frame that the fit uses"
    )
    phi: Quantity | None = Field(default=None, description="balance angle phi about the pivot edge")
    k: Quantity | None = Field(
        default=None, description="k = m g R / I_edge for a sharp edge, R the distance of c from it"
    )
    cov_phi_k: list[list[float]] | None = Field(default=None, description="(2, 2) covariance of phi and k")
    i_edge: Quantity | None = Field(default=None, description="moment of inertia about the pivot edge")
    energy_ratio: float | None = Field(
        default=None,
        description="E: kinetic energy after the strike over the energy needed to reach balance; 1 just does",
    )
    residual_rms_rad: float | None = Field(default=None, description="rms residual of the fit of theta(t)")
    equiplane_residual_m: float | None = Field(
        default=None, description="signed distance of the centre of mass from this strike's equi-plane"
    )
    alternatives: list[AlternativeFit] = Field(default=[], description="fits by other estimators")
    prediction: PredictionResult | None = Field(
        default=None, description="leave-one-out prediction of a strike used; not written where there is none"
    )

    @model_serializer(mode="wrap")
    def _without_defaults(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = write(self)
        if not self.heading_rad:
            del written["heading_rad"]
        if self.prediction is None:
            del written["prediction"]
        return written


class AxisMoment(Document):
    """Moments of inertia about one pivot axis and about its parallel through the centre of mass c."""

    axis_id: str
    direction: Vector3 = Field(description="unit direction of the axis, in O")
    i_edge: Quantity = Field(description="moment about the pivot edge")
    i_com: Quantity = Field(description="moment about the parallel through c")


class RegionResult(SparseDocument):
    """Mass of one region: shell, upper, lower, or a label's name."""

    left_out_if_none: ClassVar[tuple[str, ...]] = ("limits_kg",)

    name: str
    mass: Quantity
    limits_kg: list[float] | None = Field(
        default=None,
        description=(
            "least and greatest mass under any filling of a uniform shell; null in older results and the"
            " paper's"
        ),
    )

    @model_validator(mode="before")
    @classmethod
    def _take_new_name(cls, data: Any) -> Any:
        entries = _entries(data)
        return (
            {**entries, "name": "shell"} if entries is not None and entries.get("name") == "surface" else data
        )


class Regions(RenamedDocument, SparseDocument):
    """Masses of the shell and of the interior on either side of the dividing plane, n.x = offset in O.

    Intervals hold for a uniform shell with two uniform parts inside. Where no such body has the moments
    (`explained` is false), they are the limits under any filling, and the plane divides the body in the
    middle of its longest direction.
    """

    renamed: ClassVar[dict[str, str]] = {
        "border_normal": "dividing_plane_normal",
        "border_offset_m": "dividing_plane_offset_m",
        "border_offset_interval95_m": "dividing_plane_offset_interval95_m",
    }
    left_out_if_none: ClassVar[tuple[str, ...]] = ("explained", "shell_thickness")

    @model_validator(mode="before")
    @classmethod
    def _take_new_baseline_names(cls, data: Any) -> Any:
        entries = _entries(data)
        baselines = None if entries is None else _entries(entries.get("baselines"))
        if entries is None or baselines is None:
            return data
        renamed = {"surface": "shell", "surface_and_uniform": "shell_and_uniform"}
        return {
            **entries,
            "baselines": {renamed.get(name, name): masses for name, masses in baselines.items()},
        }

    regions: list[RegionResult]
    dividing_plane_normal: Vector3 | None = Field(description="unit normal n, towards the upper region")
    dividing_plane_offset_m: float | None = Field(description="offset n.x [m]")
    dividing_plane_offset_interval95_m: list[float] | None = None
    baselines: dict[str, list[float]] = Field(
        default={}, description="naive answers: masses [kg] of the regions by name of the answer"
    )
    explained: bool | None = Field(
        default=None,
        description="true if such a body can have the moments; null in older results and the paper's",
    )
    shell_thickness: Quantity | None = Field(
        default=None, description="estimated shell thickness [m] where the object file gives none"
    )


class PartResult(Document):
    """One labelled part, taken as uniform; not observed where the moments leave its mass open."""

    name: str
    mass: Quantity
    volume_m3: float = Field(description="volume [m^3]")
    density: Quantity


class Parts(Document):
    """Masses of the parts that the object file labels."""

    parts: list[PartResult]
    uniform: list[float] = Field(description="naive answer: masses [kg] with one density for all parts")
    misfit: float = Field(
        description=(
            "rms of the moments' residuals over their sd; far above 1 if a part is missing or not uniform"
        )
    )


class Filling(RenamedDocument):
    """Filling of the object's interior up to an unknown level; 95 % intervals may be asymmetric."""

    renamed: ClassVar[dict[str, str]] = {"wall": "shell"}

    name: str
    along: Vector3 = Field(description="unit direction that was up when the object was filled, in O")
    level: Quantity = Field(description="height of the filling's surface along `along` from O [m]")
    filled_share: Quantity = Field(description="filled share of the interior's volume")
    mass: Quantity
    density: Quantity
    shell: Quantity = Field(description="mass of the shell")
    shell_thickness: Quantity | None = Field(
        default=None, description="shell thickness; null where the object file gives it"
    )
    misfit: float = Field(
        description="rms of the moments' residuals over their sd; far above 1 if there is no such filling"
    )


class TableTilt(Document):
    """Tilt of the vertical from the table's normal towards W's x and y, where the table rises.

    `source` of each component: measured by the strikes, given by the rig file's level reading, or prior.
    """

    recordings: list[int] = Field(description="numbers of the recordings made on this levelling, from 1")
    towards_x: Quantity
    towards_y: Quantity


class FrameTimes(Document):
    """Origin of the frame times of an imported recording, and the check of its frame rate.

    A rate ratio is the true frame rate over the stated one.
    """

    recording: int = Field(ge=1, description="number of the recording by start time")
    source: str = Field(description="the manifest's `time_source`")
    sd_s: float = Field(ge=0, description="1 sigma of a frame's time against the others'")
    frame_rate_hz: float = Field(description="stated frame rate")
    frame_rate_sd_hz: float | None = Field(
        default=None, description="1 sigma as a drop measured it; null if only stated"
    )
    contact_sd_s: float | None = Field(
        description=(
            "1 sigma of a strike's contact time, from the onset of motion; null where no strike has one"
        )
    )
    rate_limits: list[float] | None = Field(
        description="least and greatest ratio that any filling of the shape allows; null if none was found"
    )
    rate_ratio: Quantity | None = Field(
        description=(
            "ratio from axes at different distances from the centre of mass; null where there are none"
        )
    )
    possible: bool = Field(description="true if the stated rate can be the true one")
    likely_rate_hz: float | None = Field(
        description="the one usual rate that is possible where the stated one is not; null otherwise"
    )


class JoinedRecording(Document):
    """One of several recordings that a result merges."""

    number: int = Field(ge=1, description="number by start time; strike ids are `<number>:<strike>`")
    recording_id: str
    content_id: str
    created: str
    plan_sha256: str


class ResultInputs(SparseDocument):
    """Inputs of a result.

    For several recordings `content_id` is the SHA-256 of their content ids, sorted, one per line, and
    `plan_sha256` of their plans'.
    """

    left_out_if_none: ClassVar[tuple[str, ...]] = ("recordings",)

    recording_id: str
    content_id: str
    object_sha256: str
    plan_sha256: str
    configuration_sha256: str
    software: str
    recordings: list[JoinedRecording] | None = Field(
        default=None, description="merged recordings; not written where there is one"
    )


class Result(SparseDocument):
    """The document that `analyze estimate --json` prints."""

    left_out_if_none: ClassVar[tuple[str, ...]] = (
        "table_tilt",
        "parts",
        "verdict",
        "parameters_covariance",
        "filling",
        "frame_times",
    )

    schema_version: str = RESULT_VERSION
    inputs: ResultInputs
    warnings: list[ResultWarning]
    strikes: list[StrikeResult]
    mass: Quantity
    centre_of_mass: Quantity
    centre_of_mass_paper: Quantity | None = None
    moments: list[AxisMoment]
    inertia: Quantity = Field(
        description="tensor about the centre of mass; `source` is prior as soon as one entry is"
    )
    inertia_measured: list[list[bool]] | None = Field(
        default=None,
        description=(
            "per entry: true if strikes measured it, false if the shape's prior stands; null in older results"
        ),
    )
    regions: Regions | None
    regions_paper: Regions | None = None
    verdict: list[str] | None = Field(
        default=None, description="sentences on what to trust, doubt and repeat; not written in older results"
    )
    parameters_covariance: list[list[float]] | None = Field(
        default=None,
        description=(
            "(10, 10) covariance of mass, centre of mass, Ixx, Iyy, Izz, Ixy, Ixz, Iyz about it, SI; not"
            " written in older results"
        ),
    )
    parts: Parts | None = Field(
        default=None, description="labelled parts; not written where the object file labels none"
    )
    filling: Filling | None = Field(
        default=None, description="filling; not written where the object file names none"
    )
    table_tilt: list[TableTilt] | None = Field(
        default=None, description="one per levelling; not written in older results"
    )
    frame_times: list[FrameTimes] | None = Field(
        default=None, description="recordings whose times come from a file's time stamps; else not written"
    )

    @model_validator(mode="before")
    @classmethod
    def _take_new_version(cls, data: Any) -> Any:
        """Rewrite warning codes and the version of a document of 1.x; keys are rewritten by `renamed`."""
        entries = _entries(data)
        if entries is None or not str(entries.get("schema_version", RESULT_VERSION)).startswith("1."):
            return data
        warnings = [_with_new_code(each) for each in entries.get("warnings", [])]
        return {**entries, "schema_version": RESULT_VERSION, "warnings": warnings}


def _with_new_code(warning: Any) -> Any:
    entries = _entries(warning)
    if entries is None or entries.get("code") not in RENAMED_CODES:
        return warning
    return {**entries, "code": RENAMED_CODES[entries["code"]]}
