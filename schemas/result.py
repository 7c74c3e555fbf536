"""What `analyze estimate --json` prints: every number with its uncertainty, and what it rests on."""

from __future__ import annotations

import enum
from typing import Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from schemas.document import SCHEMA_VERSION, Document, Vector3


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
    """of several numbers: that of the weakest; what a Result says beside it (`inertia_measured`) is entry by entry"""


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
    MARKERS_UNPLACED = "markers_unplaced"
    ROLLING_CONTACT = "rolling_contact"
    MARKERS_SUBTRACTED = "markers_subtracted"
    STRIKE_NOT_FORETOLD = "strike_not_foretold"
    MOMENT_IMPOSSIBLE = "moment_impossible"
    GRAVITY_DISAGREES = "gravity_disagrees"
    FILLING_TURNS_WITH_IT = "filling_turns_with_it"
    FILLING_UNEXPLAINED = "filling_unexplained"
    FRAME_RATE_WRONG = "frame_rate_wrong"
    FRAME_RATE_UNCHECKED = "frame_rate_unchecked"


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
    violated: list[str] = Field(default=[])
    """assumptions of the estimator that the motion did not keep"""


class ForetoldResult(Document):
    """What all other strikes foretell of one, and how it is off that."""

    phi: Quantity = Field(description="foretold; sd is of what foretells it")
    k: Quantity = Field(description="the same")
    sigmas: float = Field(ge=0, description="phi and k together, measured less foretold, as one standardised error")
    motion_sigmas: float = Field(ge=0, description="the same of theta(t): from its first free frames on, with phi and k as foretold")
    foretold: bool = Field(description="both are at most 3")
    frames: int = Field(
        description="of theta(t) that were compared: until the foretelling's own sd is above 3 deg, or the free motion ends"
    )
    start_frames: int = Field(description="before them, that only gave the start")
    worst_offset_rad: float = Field(description="measured less foretold, of the frame farthest off for its sd")
    worst_band_rad: float = Field(description="1.96 sd of that")
    outside_share: float = Field(ge=0, le=1, description="of the frames, off by more than 1.96 sd; 0.05 is usual")


class StrikeResult(Document):
    """One strike's outcome."""

    id: str
    plan_strike_id: str
    axis_id: str
    plane_id: str
    heading_rad: float = Field(default=0.0, description="as in the plan: of object and striker on the table; 0 is not written")
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
    alternatives: list[AlternativeFit] = Field(default=[])
    foretold: ForetoldResult | None = Field(default=None, description="of strikes used; older results have none, and none is written")

    @model_serializer(mode="wrap")
    def _as_read(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A result of strikes as usual keeps its bytes."""
        written: dict[str, Any] = write(self)
        if not self.heading_rad:
            del written["heading_rad"]
        if self.foretold is None:
            del written["foretold"]
        return written


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
    limits_kg: list[float] | None = Field(
        default=None,
        description="least and greatest, whatever fills the interior of an even shell; older results and the paper's have none",
    )

    @model_serializer(mode="wrap")
    def _as_before(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What has none is written as it always was."""
        written: dict[str, Any] = write(self)
        if self.limits_kg is None:
            del written["limits_kg"]
        return written


class Regions(Document):
    """Masses of the shell and the two interior parts, the border plane (n.x = offset, in O) and its rivals.

    Intervals hold for a body that is an even shell with two even parts inside; where the moments say that it is not (`explained` false),
    they are the limits, which hold for any filling, and the border is the body's middle, across its longest direction.
    """

    regions: list[RegionResult]
    border_normal: Vector3 | None
    border_offset_m: float | None
    border_offset_interval95_m: list[float] | None = None
    baselines: dict[str, list[float]] = Field(default={}, description="naive answers: name -> masses [kg]")
    explained: bool | None = Field(
        default=None, description="whether such a body can have the moments; older results and the paper's: null"
    )
    shell_thickness: Quantity | None = Field(default=None, description="of the wall [m], where the object's file gives none")

    @model_serializer(mode="wrap")
    def _as_before(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """What does not say is written as it always was."""
        written: dict[str, Any] = write(self)
        for name in ("explained", "shell_thickness"):
            if getattr(self, name) is None:
                del written[name]
        return written


class PartResult(Document):
    """One labelled part, taken as uniform. Not observed: the moments leave its mass open within the interval."""

    name: str
    mass: Quantity
    volume_m3: float
    density: Quantity


class Parts(Document):
    """Masses of the parts that the object file labels."""

    parts: list[PartResult]
    uniform: list[float] = Field(description="the naive answer: one density for all [kg]")
    misfit: float = Field(
        description="rms of what the parts leave of the moments, over its sd; far above 1: they are not all, or not uniform"
    )


class Filling(Document):
    """What fills the object's inside up to a level that was asked; its 95 % intervals need not be even."""

    name: str
    along: Vector3 = Field(description="what was up when it was filled, unit, in O")
    level: Quantity = Field(description="where it ends, in metres along `along` from O")
    filled_share: Quantity = Field(description="of the inside's volume")
    mass: Quantity
    density: Quantity
    wall: Quantity = Field(description="mass of the wall")
    shell_thickness: Quantity | None = Field(default=None, description="of the wall; null where the object file gives it")
    misfit: float = Field(description="rms of what the likeliest leaves of the moments, over its sd; far above 1: it is no such filling")


class TableTilt(Document):
    """How far the vertical leans from the table's normal, towards W's x (where objects tip) and y: the table rises that way by as much.

    Of each component `source` says whether the strikes measured it, the rig file's level reading gave it, or the prior stands.
    """

    recordings: list[int] = Field(description="numbers of those that were made on this levelling, the first is 1")
    towards_x: Quantity
    towards_y: Quantity


class FrameTimes(Document):
    """Where a recording's frames have their times from that no clock of a rig gave, and what its strikes say of the frame rate.

    Ratios are of the true rate to the stated one.
    """

    recording: int = Field(ge=1, description="its number, by the time at which they began")
    source: str = Field(description="as the manifest's `time_source`")
    sd_s: float = Field(ge=0, description="of a frame's time against the others'")
    frame_rate_hz: float = Field(description="as stated")
    frame_rate_sd_hz: float | None = Field(default=None, description="1 sigma, as a drop measured it; null: as stated")
    contact_sd_s: float | None = Field(description="of a strike's contact, which only the motion's onset shows; null: of no strike")
    rate_limits: list[float] | None = Field(description="least and greatest ratio that any filling of the shape allows; null: none found")
    rate_ratio: Quantity | None = Field(description="as axes at different distances from the centre of mass tell it; null: none do")
    possible: bool = Field(description="the stated rate can be the true one")
    likely_rate_hz: float | None = Field(description="where it cannot: the usual rate that can; null: several or none")


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
    inertia: Quantity = Field(description="about the centre of mass; its source is prior as soon as one entry is, see inertia_measured")
    inertia_measured: list[list[bool]] | None = Field(
        default=None, description="entry by entry: the strikes measured it, or else the shape's prior stands; older results have none"
    )
    regions: Regions | None
    regions_paper: Regions | None = None
    verdict: list[str] | None = Field(default=None, description="in words: what to trust, to doubt, to repeat; older results have none")
    parameters_covariance: list[list[float]] | None = Field(
        default=None, description="(10, 10) of mass, centre of mass, Ixx, Iyy, Izz, Ixy, Ixz, Iyz about it; SI; older results have none"
    )
    parts: Parts | None = Field(default=None, description="where the object file labels them; else not written")
    filling: Filling | None = Field(default=None, description="where the object file has a part that fills it; else not written")
    table_tilt: list[TableTilt] | None = Field(default=None, description="one per levelling; older results have none, and none is written")
    frame_times: list[FrameTimes] | None = Field(
        default=None, description="of recordings whose times come from a file's time stamps; else not written"
    )

    @model_serializer(mode="wrap")
    def _as_read(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A result that was printed before there was a tilt keeps its bytes."""
        written: dict[str, Any] = write(self)
        if self.table_tilt is None:
            del written["table_tilt"]
        for later in ("parts", "verdict", "parameters_covariance", "filling", "frame_times"):
            if getattr(self, later) is None:
                del written[later]
        return written
