"""Where stage two ends: the paper knows the exterior, and with it the angle at which the next face comes down."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.planning.corrected import wall_lean
from analyze.types import TipMotion

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from schemas.strike_plan import PlannedStrike

NEAR = math.radians(1.0)
"""of the landing: a face that lies down is seen that much off it"""


def landing_angle(planned: PlannedStrike, model: ObjectModel) -> float:
    """Angle [rad] by which the body has tipped when the face beside its edge lies on the table; of a lying bottle that is a chamfer.

    Where no face ends at the edge: that at which the table's face stands upright.

    Args:
        planned: how it lay, and its edge.
        model: its shape.
    """
    return math.pi / 2 + (wall_lean(planned.pivot, np.array(planned.R_world_object), model) or 0.0)


def stage_two(motion: TipMotion, planned: PlannedStrike, model: ObjectModel) -> tuple[int, int] | None:
    """Index range from the balance to where the next face lands, which need not stop the body; None where it did not get there."""
    if motion.angle is None or motion.phases is None or motion.phases.stage_two is None:
        return None
    start, stop = motion.phases.stage_two
    if motion.fit is not None and motion.fit.rolling is not None:  # a flank's faces do not land, it rolls over them
        return start, stop
    landed = np.flatnonzero(motion.angle.theta[start:stop] >= landing_angle(planned, model) - NEAR)
    return start, start + int(landed[0]) if len(landed) else stop
