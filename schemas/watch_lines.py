"""JSON lines between a session and `analyze watch`, which follows a recording that is being written.

`analyze watch` writes observations of the newest image and verdicts on strikes (good, or a reason why not);
the session writes requests.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from schemas.document import Document
from schemas.strike_result import Verdict
from schemas.tags import MarkerName
from schemas.toss_result import TossVerdict


class SeenMarker(Document):
    """Marker in the newest image: its name and its corners (4, 2) [px] in order around it."""

    id: MarkerName
    corners_px: list[list[float]]


class WatchEvent(Document):
    """Observation of the newest image: markers, rest or motion, saturated pixels, error of the placement.

    The error of the placement is the angle [rad] between the object's pose at rest and the planned one.

    `analyze watch` sends it up to twelve times a second.
    """

    kind: Literal["watch"] = "watch"
    time_ns: int = Field(description="log time of the image [ns]")
    markers: list[SeenMarker]
    """markers seen in the image"""
    at_rest: bool = Field(description="true if nothing moved in the last quarter of a second")
    saturated_fraction: float = Field(description="fraction of saturated pixels in the image")
    placement_error_rad: float | None = Field(
        default=None, description="angle between resting and planned pose, if a planned strike is set"
    )
    text: str = ""
    """remark for the operator"""
    offset_m: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="(x, y) in W of the object from its planned place [m], if it is determined"
    )
    yaw_error_rad: float | None = Field(
        default=None, description="turn about W's z from the planned orientation, anticlockwise from above"
    )
    outline_px: list[list[float]] | None = Field(
        default=None,
        description="outline of the object as planned, in image pixels; null if no strike is expected",
    )
    axes_px: list[list[float]] | None = Field(
        default=None,
        description="object frame in image pixels: origin and ends of x, y and z, where the object stands, "
        "or as planned while its offset is not determined; null if no strike is expected",
    )
    moving_fraction: float | None = Field(
        default=None,
        description="fraction of the pixels in and around the outline that changed since the image before",
    )


_LogTime = Annotated[int, Field(ge=0, lt=1 << 63)]


class JudgeRequest(Document):
    """Request that a session writes to the standard input of `analyze watch`; `kind` is one of two.

    "judge" asks for a verdict on the strike that was recorded from window start to window end; "expect" names
    the planned strike with which the object's placement is compared. Times are log times [ns since 1970];
    "expect" needs none.
    """

    kind: Literal["judge", "expect"] = "judge"
    plan_strike_id: str
    """id of the strike in the plan"""
    strike_id: str = ""
    """id of the attempt in the recording"""
    window_start_ns: _LogTime = 0
    window_end_ns: _LogTime = 0
    contact_time_ns: _LogTime = 0
    """log time of the contact [ns]; 0 if the striker measured none"""


class TossRequest(Document):
    """Request that a session writes to the standard input of `analyze watch`: judge a toss by its images.

    The answer is a TossJudgement with the same toss_id. Times are log times [ns since 1970].
    """

    kind: Literal["judge_toss"] = "judge_toss"
    plan_toss_id: str
    """id of the toss in the plan"""
    toss_id: str
    """id of the attempt in the recording"""
    window_start_ns: _LogTime
    window_end_ns: _LogTime


class TossJudgement(Document):
    """Verdict on a toss (good, or a reason why not) with its figures; the answer of `analyze watch`."""

    kind: Literal["toss_verdict"] = "toss_verdict"
    toss_id: str
    code: TossVerdict
    reason: str
    flight_s: float | None = Field(default=None, description="time in free flight and in view [s]")
    turns_per_s: float | None = Field(default=None, description="mean spin in turns a second")


MAX_CURVE_POINTS = 200
"""largest number of points of a strike's curve"""

_Points = Annotated[list[float], Field(max_length=MAX_CURVE_POINTS)]


class StrikeCurve(Document):
    """Tipping angle over time of a strike, measured and fitted, thinned out for a drawing.

    Times are seconds after the first contact or, if that is not known, after the first point.
    """

    time_s: _Points
    theta_rad: _Points
    """measured tipping angle since rest [rad]"""
    fit_time_s: _Points = Field(default=[])
    fit_rad: _Points = Field(default=[])
    """tipping angle of the fitted motion [rad]; empty if none was fitted"""


class StrikeVerdict(Document):
    """Verdict on a strike (good, or a reason why not) with numbers; the answer of `analyze watch`.

    The energy ratio E is the kinetic energy after the strike over the energy needed to reach balance. Numbers
    that could not be determined are null.
    """

    kind: Literal["verdict"] = "verdict"
    strike_id: str
    code: Verdict
    reason: str
    phi: float | None = Field(default=None, description="balance angle [rad]")
    phi_sd: float | None = Field(default=None, description="1 sigma of phi [rad]")
    energy_ratio: float | None = Field(default=None, description="energy ratio E of the strike")
    theta_max_rad: float | None = Field(
        default=None, description="largest angle of an object that rocked back"
    )
    contact_time_ns: int | None = Field(
        default=None, description="log time of the contact, estimated from the images [ns]"
    )
    contact_time_sd_ns: float | None = None
    """1 sigma of contact_time_ns [ns]; null if that is"""
    curve: StrikeCurve | None = None
    """tipping angle over time; null if the object was not followed"""


class AdviceRequest(Document):
    """Request that a session writes to the standard input of `analyze advise`: the answer so far, what next.

    A target of null does not matter. The answer is a SessionEstimate with the same number.
    """

    kind: Literal["advise"] = "advise"
    number: int = Field(ge=1, description="number of the request in the session")
    strike_id: str = ""
    """id of the newest attempt, whose record the answer must include; "" before the first"""
    target_com_m: float | None = Field(default=None, gt=0)
    """half width of the 95 % interval of the centre of mass in its least certain direction to reach"""
    target_inertia: float | None = Field(default=None, gt=0)
    """relative half width of the 95 % intervals of the diagonal moments to reach"""
    left: int = Field(default=0, ge=0, description="number of strikes that may still be made")
    last_plan_strike_id: str = ""
    """id of the planned strike made last; "" before the first"""
    stands: bool = False
    """true if the object still stands as it was placed for the last strike"""
    excluded: list[str] = Field(default_factory=list[str])
    """ids of planned strikes that cannot be made"""
    failures: dict[str, int] = Field(default_factory=dict[str, int])
    """number of attempts without a usable verdict, by id of the planned strike"""
    earlier: list[str] = Field(default_factory=list[str])
    """paths of earlier recordings of this object whose strikes count as well"""


class SessionCheck(Document):
    """Check that must pass before a session stops itself."""

    name: str
    passed: bool
    text: str
    """finding in words"""


class SessionTarget(Document):
    """Precision at which a session stops itself, and whether the answer so far has it."""

    com_m: float | None = None
    """half width of the 95 % interval of the centre of mass to reach; null if it does not matter"""
    inertia: float | None = None
    """relative half width of the 95 % intervals of the diagonal moments to reach; null likewise"""
    met: bool
    """true if the half widths are reached and all checks pass"""
    reachable: bool | None = None
    """false if no number of strikes is expected to reach it; null if that is not known"""
    reason: str = ""
    """reason why it is out of reach, with a remedy"""


class NextStrike(Document):
    """Planned strike that is expected to tell most, with the reason for the choice."""

    strike_id: str
    """id of the strike in the plan"""
    reason: str


class StrikeForecastRange(Document):
    """Expected number of further strikes until the target is met."""

    least: int
    most: int


class MarkerSide(Document):
    """Marker on the object: its name, its centre (3,) [m] and the direction (3,) that it faces, in O."""

    id: MarkerName
    place_m: list[float]
    faces: list[float]


class SessionEstimate(Document):
    """Answer so far of a session, and the next strike: the answer of `analyze advise` to an AdviceRequest.

    All is in the object frame O. What the strikes do not determine yet is null.
    """

    kind: Literal["estimate"] = "estimate"
    number: int
    """number of the request"""
    strike_id: str = ""
    """id of the newest attempt that is included"""
    strikes: int = 0
    """number of strikes used"""
    com_m: list[float] | None = None
    """(3,) centre of mass"""
    com_covariance_m2: list[list[float]] | None = None
    """(3, 3) covariance of the centre of mass"""
    com_open: list[list[float]] = Field(default_factory=list[list[float]])
    """unit directions (3,) along which the centre of mass is not determined"""
    com_half_width_m: float | None = None
    """half width of the 95 % interval of the centre of mass in its least certain direction"""
    inertia_kg_m2: list[float] | None = None
    """(6,) Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass"""
    inertia_sd_kg_m2: list[float] | None = None
    """(6,) 1 sigma of these"""
    inertia_half_width: float | None = None
    """largest relative half width of the 95 % intervals of Ixx, Iyy and Izz"""
    checks: list[SessionCheck] = Field(default_factory=list[SessionCheck])
    target: SessionTarget
    forecast: StrikeForecastRange | None = None
    """null if the strikes that are left are not expected to reach the target"""
    next: NextStrike | None = None
    """null if the session is to end"""
    bounds_m: list[list[float]] = Field(default_factory=list[list[float]])
    """(2, 3) lower and upper corner of the object's bounding box"""
    markers: list[MarkerSide] = Field(default_factory=list["MarkerSide"])
    """the object's markers whose place is known"""
    hull: list[list[list[float]]] = Field(default_factory=list[list[list[float]]])
    """outlines of the object's hull seen along x, y and z: points (n, 2) [m] in (y, z), (x, z) and (x, y)"""
