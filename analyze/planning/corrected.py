"""Update of a plan's pivots to the radii and the surface error by which its strikes are analysed."""

from __future__ import annotations

import math

import numpy as np

from analyze.geometry.edge_radius import edge_radius, stated_radius
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.surface_error import surface_sd
from analyze.planning.pivots import wall_lean
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import Pivot, StrikePlan


def corrected_plan(
    plan: StrikePlan, before: ObjectSpec, corrected: ObjectSpec, model: ObjectModel
) -> StrikePlan:
    """Plan with the pivot (edge line) of every strike updated to the object file in use.

    Pivots change where the object file was corrected, and where the plan was made with another edge radius
    than the one expected now (older plans took edges of unknown radius as sharp). The plan is returned as it
    is if no pivot changes.

    Args:
        plan: Plan made with `before`; it is not changed.
        before: Object file that the plan was made with.
        corrected: Object file in use, of the same shape; may equal `before`.
        model: Shape of the object.
    """
    pivots = [
        corrected_pivot(
            strike.pivot, strike.axis_id, np.array(strike.R_world_object), before, corrected, model
        )
        for strike in plan.strikes
    ]
    if all(pivot == strike.pivot for pivot, strike in zip(pivots, plan.strikes, strict=True)):
        return plan
    strikes = [
        strike.model_copy(update={"pivot": pivot}) for strike, pivot in zip(plan.strikes, pivots, strict=True)
    ]
    return plan.model_copy(update={"strikes": strikes})


def corrected_pivot(
    pivot: Pivot,
    axis_id: str,
    R_world_object: Array,
    before: ObjectSpec,
    corrected: ObjectSpec,
    model: ObjectModel,
) -> Pivot:
    """Pivot (edge line) of one planned strike, updated to the edge radius and surface error in use.

    The line is the centre line of the edge's rounding; it lies one radius inside the resting face and the
    face that rises from the edge. If the pivot's radius is none that a plan made with `before` can have, the
    rounding is part of the shape (a moulded edge): line and radius are kept, and only the 1 sigma of the
    place is updated.

    Args:
        pivot: Pivot as planned, in the object frame.
        axis_id: Name of the edge in the plan.
        R_world_object: (3, 3) rotation from object to world frame at rest.
        before: Object file that the plan was made with.
        corrected: Object file in use.
        model: Shape of the object.
    """
    surface, now = surface_sd(before.shape, model.noise_sd), surface_sd(corrected.shape, model.noise_sd)
    # Older plans took a shape without a stated error as exact: their pivots hold the edge's own error alone.
    own_variance = pivot.sd_m**2 - (surface**2 if surface < pivot.sd_m else 0.0)
    sd = pivot.sd_m if surface == now < pivot.sd_m else math.sqrt(own_variance + now**2)
    inwards = inward_shift(pivot, R_world_object, model)
    corner, direction = np.array(pivot.point) - pivot.radius_m * inwards, np.array(pivot.direction)
    planned = [edge_radius(before, model, axis_id, corner, direction).mean, stated_radius(before).mean]
    # Older plans have sharp edges where the object file gave no radius.
    planned += [] if before.edge_radius_m else [0.0]
    if not any(math.isclose(pivot.radius_m, each, rel_tol=1e-6, abs_tol=1e-9) for each in planned):
        return pivot.model_copy(update={"sd_m": sd})
    radius = edge_radius(corrected, model, axis_id, corner, direction).mean
    if math.isclose(pivot.radius_m, radius, rel_tol=1e-6, abs_tol=1e-9):
        return pivot.model_copy(update={"sd_m": sd})
    point = np.array(pivot.point) + (radius - pivot.radius_m) * inwards
    return pivot.model_copy(update={"point": point.tolist(), "radius_m": radius, "sd_m": sd})


def inward_shift(pivot: Pivot, R_world_object: Array, model: ObjectModel) -> Array:
    """Displacement (3,) of the centre line of an edge's rounding per metre of its radius, in O.

    The rounding touches the resting face and the face that rises from the edge. Both meet in the sharp edge
    `pivot.point` - `pivot.radius_m` * shift.

    Args:
        pivot: Pivot as planned, in the object frame.
        R_world_object: (3, 3) rotation from object to world frame at rest.
        model: Shape of the object.
    """
    tip, up = R_world_object[0], R_world_object[2]
    lean = wall_lean(model, tip, up, [np.array(pivot.point)], pivot.radius_m) or 0.0
    return np.asarray(up - tip * (1 + math.sin(lean)) / math.cos(lean), dtype=np.float64)
