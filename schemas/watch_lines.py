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
