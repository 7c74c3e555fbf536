"""Outcome of one strike in a result: verdict, fits, prediction from the other strikes.

theta is the tipping angle since rest, phi the balance angle (theta at which the centre of mass stands above
the contact), k [1/s^2] the rate in theta'' = -k sin(phi - theta).
"""

from __future__ import annotations

import enum
from typing import ClassVar

from pydantic import Field

from schemas.document import Document, SparseDocument
from schemas.quantity import Quantity, RenamedDocument


class Verdict(enum.Enum):
    """Outcome of a strike: good, or the reason why its motion is used with care or not at all."""

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
    WRONG_EDGE = "wrong_edge"
    EXCLUDED = "excluded"
    UNREADABLE = "unreadable"


class FollowedBy(enum.StrEnum):
    """What an object was followed by in the images of a strike."""

    TAGS = "tags"
    PRINT = "print"


USABLE_VERDICTS = (Verdict.GOOD, Verdict.ROCKED_BACK)
"""verdicts of usable strikes: one that rocked back still gives balance angle phi and rate constant k"""


class AlternativeFit(Document):
    """Balance angle phi and rate k of a strike by another estimator than the one used.

    The one used gives the values in the result. k is the rate [1/s^2] of the pendulum equation theta'' = -k
    sin(phi - theta), theta the tipping angle; phi is theta where the centre of mass stands above the contact.
    """

    estimator: str
    """name of the estimator"""
    phi: Quantity
    """balance angle [rad]"""
    k: Quantity | None = None
    """rate k = m g R / I_edge [1/s^2], R the distance of the centre of mass from the pivot edge, I_edge the
    moment of inertia about it; null if the estimator gives none"""
    note: str = ""
    """remark on the fit"""
    violated: list[str] = Field(default=[])
    """assumptions of the estimator that the motion violates"""


class PredictionResult(RenamedDocument):
    """Prediction of one strike from all other strikes (leave-one-out), compared with its measurement.

    Predicted are the balance angle phi [rad], the tipping angle theta(t) [rad] and the rate k [1/s^2] of the
    pendulum equation theta'' = -k sin(phi - theta).
    """

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


class StrikeResult(RenamedDocument, SparseDocument):
    """Outcome of one strike in a result: verdict, fitted time span, balance angle phi, rate k, residuals.

    k is the rate [1/s^2] of the pendulum equation theta'' = -k sin(phi - theta), theta the tipping angle; phi
    is theta where the centre of mass stands above the contact. The values are null if the strike could not be
    fitted.
    """

    left_out: ClassVar[tuple[str, ...]] = ("heading_rad", "prediction", "edge_name", "choice", "followed_by")

    id: str = Field(description="id of the strike in the recording: plan strike and attempt, as `s3.1`")
    plan_strike_id: str = Field(description="id of the planned strike")
    axis_id: str = Field(description="name of the pivot edge")
    edge_name: str | None = Field(
        default=None,
        description="the edge in words, as `bottom edge, +x side`; not written in older results",
    )
    choice: str | None = Field(
        default=None,
        description="reason for choosing this strike in a session that stops itself; not written otherwise",
    )
    plane_id: str = Field(description="name of the face on which the object rested")
    heading_rad: float = Field(
        default=0.0, description="heading of object and striker on the table, as planned; 0 is not written"
    )
    verdict: Verdict
    """outcome of the strike"""
    reason: str = Field(default="", description="reason for the verdict")
    used: bool = Field(description="true if the result uses this strike")
    information_share: float = Field(
        ge=0, description="share of the information about the centre of mass; 0 if not used"
    )
    followed_by: FollowedBy = Field(
        default=FollowedBy.TAGS, description="what the object was followed by: its tags, or its own print"
    )
    estimator: str | None = None
    """name of the estimator that fitted the motion"""
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
