"""Plan of an object on a bench with the nominal camera, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from analyze.geometry.object_model import ObjectModel
from analyze.planning.earlier_results import EarlierResult
from analyze.planning.examine import Bench
from analyze.planning.fillings import Pieces
from analyze.planning.hypothesis import Region
from analyze.planning.impact import StrikerModel
from analyze.planning.information import SharedErrors
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import FRICTION, prepare_object
from analyze.planning.stable_planes import RestingPlane
from analyze.planning.view import default_camera
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import StrikePlan


def stable_planes(planes: Sequence[RestingPlane], region: Region) -> tuple[RestingPlane, ...]:
    """Planes whose support polygon holds the projection of all of `region`."""
    return tuple(plane for plane in planes if plane.margin_of(region) > 0)


def make_plan(
    model: ObjectModel,
    spec: ObjectSpec,
    object_sha256: str,
    striker: StrikerModel,
    *,
    friction: float = FRICTION,
    errors: SharedErrors | None = None,
    given: EarlierResult | None = None,
    cells: Pieces | None = None,
    **request: Any,
) -> StrikePlan:
    """Plan of one object; `request` has the fields of `PlanRequest`."""
    prepared = prepare_object(model, spec, Bench(striker, default_camera(), friction), errors, given)
    return plan_strikes(prepared, object_sha256, PlanRequest(**request), cells)
