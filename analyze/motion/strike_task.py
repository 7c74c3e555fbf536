"""Data that the analysis of one strike needs, and the verdict that it returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.types import IntArray, SupportLine
    from schemas.strike_plan import PlannedStrike
    from schemas.strike_result import Verdict


@dataclass(frozen=True)
class StrikeTask:
    """Data of one strike besides its marker tracks: plan, contact time, and the object's shape.

    A strike is one impact that tips the object about an edge.
    """

    strike_id: str
    """id of the strike"""
    planned: PlannedStrike
    """the strike as planned"""
    contact_time_ns: int = 0
    """log_time [ns] of the contact as the striker measured it; 0 if unknown"""
    images_end_ns: int | None = None
    """log_time [ns] of the last image; 0 if there is no image, None if unknown"""
    section: SupportFunction | None = None
    """the object's cross-section at the pivot axis; None if only the plan's rounding is known"""
    landing_angle_rad: float | None = None
    """theta [rad] from which the shape's next face may touch the table; None if unknown, or if none does"""
    unmarked_ns: IntArray | None = None
    """(n,) log times [ns] of the images without a marker; None if unknown: then every missing frame counts as
    an image without a marker"""
    supports: tuple[SupportLine, ...] | None = None
    """lines over which the object turns in succession, by the shape, ordered by the angle at which each takes
    over, the line at rest first; None if unknown, or if the contact rolls on a curve"""
    plan_strikes: tuple[PlannedStrike, ...] = ()
    """all strikes of the plan, one of which an object that was not placed as planned may fit"""
    edge_sd: float = 0.0
    """1 sigma [m] by which the pivot edge may lie ahead of the planned one, at balance, as it was scanned; 0
    for a mesh that is no scan"""


@dataclass(frozen=True)
class Judgement:
    """Verdict on a strike (good, or the fault of its motion) with the reason in words."""

    code: Verdict
    """the verdict"""
    reason: str
    """one sentence with the numbers, and the remedy if the strike is not good"""
