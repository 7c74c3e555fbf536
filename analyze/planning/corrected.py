"""Update of a plan's pivots after the object file's edge radius or surface error was corrected."""

from __future__ import annotations

import math

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.planning.pivots import wall_lean
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import Pivot, StrikePlan


def corrected_plan(
    plan: StrikePlan, before: ObjectSpec, corrected: ObjectSpec, model: ObjectModel
) -> StrikePlan:
    """Plan with the pivot (edge line) of every strike updated to the corrected object file.

    The plan is returned as it is if edge radius and surface error are unchanged.

    Args:
        plan: Plan made with `before`; it is not changed.
        before: Object file that the plan was made with.
        corrected: Corrected object file of the same shape.
        model: Shape of the object.
    """
    if (before.edge_radius_m, before.shape.surface_sd_m) == (
        corrected.edge_radius_m,
        corrected.shape.surface_sd_m,
    ):
        return plan
    strikes = [
        strike.model_copy(
            update={
                "pivot": corrected_pivot(
                    strike.pivot, np.array(strike.R_world_object), before, corrected, model
                )
            }
        )
        for strike in plan.strikes
    ]
    return plan.model_copy(update={"strikes": strikes})


def corrected_pivot(
    pivot: Pivot, R_world_object: Array, before: ObjectSpec, corrected: ObjectSpec, model: ObjectModel
) -> Pivot:
    """Pivot (edge line) of one planned strike, updated to a corrected edge radius and surface error.

    The line is the centre line of the edge's rounding; it lies one radius inside the resting face and the
    face that rises from the edge. If the pivot's radius is not the one stated in `before`, the rounding is
    part of the shape (a moulded edge): line and radius are kept, and only the 1 sigma of the place is
    updated.

    Args:
        pivot: Pivot as planned, in the object frame.
        R_world_object: (3, 3) rotation from object to world frame at rest.
        before: Object file that the plan was made with.
        corrected: Corrected object file.
        model: Shape of the object.
    """
    surface, now = before.shape.surface_sd_m, corrected.shape.surface_sd_m
    sd = math.sqrt(max(pivot.sd_m**2 - surface**2, 0.0) + now**2)
    if not math.isclose(pivot.radius_m, before.edge_radius_m, rel_tol=1e-6, abs_tol=1e-9):
        return pivot.model_copy(update={"sd_m": sd})
    tip, up = R_world_object[0], R_world_object[2]
    lean = wall_lean(model, tip, up, [np.array(pivot.point)], pivot.radius_m) or 0.0
    more = corrected.edge_radius_m - before.edge_radius_m
    point = np.array(pivot.point) + more * (up - tip * (1 + math.sin(lean)) / math.cos(lean))
    return pivot.model_copy(update={"point": point.tolist(), "radius_m": corrected.edge_radius_m, "sd_m": sd})
