"""Input and outcome of the analysis of one strike: the task, and the judgement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analyze.motion.support_function import SupportFunction
    from analyze.types import IntArray
    from schemas.result import Verdict
    from schemas.strike_plan import PlannedStrike


@dataclass(frozen=True)
class StrikeTask:
    """Prior information on one strike: the plan, the striker's report and the object's shape."""

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
    """theta [rad] from which the shape's next face may touch; None if unknown, or if a curved surface
    touches"""
    unmarked_ns: IntArray | None = None
    """log times [ns] of the images without a marker; None if unknown: every missing frame then counts as
    one"""


@dataclass(frozen=True)
class Judgement:
    """Verdict on a strike with its reason."""

    code: Verdict
    """the verdict"""
    reason: str
    """one sentence with the numbers and the remedy"""
