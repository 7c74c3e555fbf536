"""Update of a plan's pivots after the object file's edge radius or surface error was corrected."""

from __future__ import annotations

import math

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.planning.pivots import STEEPEST_WALL
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import Pivot, StrikePlan

TOUCHING_FRACTION = 3e-4
"""Distance of a face from the rounding, over the object's longest extent, up to which the two touch."""


def corrected_plan(
    plan: StrikePlan, before: ObjectSpec, corrected: ObjectSpec, model: ObjectModel
) -> StrikePlan:
    """Plan with the pivot of every strike updated to the corrected object file.

    The plan is returned as it is if edge radius and surface error are unchanged.

    Args:
        plan: Plan made with `before`.
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
    """Pivot of one strike updated to the corrected edge radius and surface error.

    The centre line of the edge's rounding lies one radius inside the resting face and the face that rises
    from the edge. A moulded edge, whose radius is part of the shape, keeps it; only the sd of its place is
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
    lean = wall_lean(pivot, R_world_object, model) or 0.0
    more = corrected.edge_radius_m - before.edge_radius_m
    point = np.array(pivot.point) + more * (up - tip * (1 + math.sin(lean)) / math.cos(lean))
    return pivot.model_copy(update={"point": point.tolist(), "radius_m": corrected.edge_radius_m, "sd_m": sd})


def wall_lean(pivot: Pivot, R_world_object: Array, model: ObjectModel) -> float | None:
    """Lean [rad] of the face that rises from the edge: angle by which its normal points upwards.

    Args:
        pivot: Pivot of the edge, in the object frame.
        R_world_object: (3, 3) rotation from object to world frame at rest.
        model: Shape of the object.

    Returns:
        None if no face touches the edge's rounding, or if it leans by `STEEPEST_WALL` or more.
    """
    tip, up, planes = R_world_object[0], R_world_object[2], model.hull_planes
    touches = np.abs(
        planes[:, :3] @ np.array(pivot.point) + planes[:, 3] + pivot.radius_m
    ) < TOUCHING_FRACTION * float(model.extent.max())
    normals = planes[touches & (planes[:, :3] @ up > -0.999), :3]
    if not len(normals):
        return None
    forward, height, aside = normals @ tip, normals @ up, normals @ np.cross(up, tip)
    best = int(np.argmax(forward / np.maximum(np.hypot(forward, aside), 1e-12)))
    lean = math.atan2(height[best], forward[best])
    return lean if abs(lean) < STEEPEST_WALL else None
