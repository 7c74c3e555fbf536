"""A plan's edges as an object file has them that was corrected afterwards: its rounding, measured since, and the error of its surface."""

from __future__ import annotations

import math

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.planning.pivots import STEEPEST_WALL
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import Pivot, StrikePlan

TOUCHES = 3e-4
"""of the longest edge: a face that is no farther off the rounding touches it"""


def corrected_plan(plan: StrikePlan, before: ObjectSpec, given: ObjectSpec, model: ObjectModel) -> StrikePlan:
    """The plan with every pivot as `given` has it.

    Args:
        plan: made with `before`.
        before: the object as it was described.
        given: as it is described now; its shape is the same.
        model: that shape.
    """
    if (before.edge_radius_m, before.shape.surface_sd_m) == (given.edge_radius_m, given.shape.surface_sd_m):
        return plan
    strikes = [
        strike.model_copy(update={"pivot": corrected_pivot(strike.pivot, np.array(strike.R_world_object), before, given, model)})
        for strike in plan.strikes
    ]
    return plan.model_copy(update={"strikes": strikes})


def corrected_pivot(pivot: Pivot, R_world_object: Array, before: ObjectSpec, given: ObjectSpec, model: ObjectModel) -> Pivot:
    """One pivot; the centre line lies the rounding's radius inside the table's face and the one that rises from the edge.

    A moulded edge, whose radius is the shape's, keeps it.
    """
    surface, now = before.shape.surface_sd_m, given.shape.surface_sd_m
    sd = math.sqrt(max(pivot.sd_m**2 - surface**2, 0.0) + now**2)
    if not math.isclose(pivot.radius_m, before.edge_radius_m, rel_tol=1e-6, abs_tol=1e-9):
        return pivot.model_copy(update={"sd_m": sd})
    tip, up = R_world_object[0], R_world_object[2]
    lean = wall_lean(pivot, R_world_object, model) or 0.0
    more = given.edge_radius_m - before.edge_radius_m
    point = np.array(pivot.point) + more * (up - tip * (1 + math.sin(lean)) / math.cos(lean))
    return pivot.model_copy(update={"point": point.tolist(), "radius_m": given.edge_radius_m, "sd_m": sd})


def wall_lean(pivot: Pivot, R_world_object: Array, model: ObjectModel) -> float | None:
    """Angle [rad] by which the normal of the face that rises from the edge, which the rounding touches too, points upwards.

    None where no face ends at the edge, or one so flat that it hardly rises.
    """
    tip, up, planes = R_world_object[0], R_world_object[2], model.hull_planes
    touches = np.abs(planes[:, :3] @ np.array(pivot.point) + planes[:, 3] + pivot.radius_m) < TOUCHES * float(model.extent.max())
    normals = planes[touches & (planes[:, :3] @ up > -0.999), :3]
    if not len(normals):
        return None
    forward, height, aside = normals @ tip, normals @ up, normals @ np.cross(up, tip)
    best = int(np.argmax(forward / np.maximum(np.hypot(forward, aside), 1e-12)))
    lean = math.atan2(height[best], forward[best])
    return lean if abs(lean) < STEEPEST_WALL else None
