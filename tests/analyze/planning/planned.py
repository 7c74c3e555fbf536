"""Plan of an object on a bench with the nominal camera, in one call."""

from __future__ import annotations

from typing import Any

from analyze.geometry.object_model import ObjectModel
from analyze.planning.earlier_results import EarlierResult
from analyze.planning.examine import Bench
from analyze.planning.fillings import Pieces
from analyze.planning.impact import StrikerModel
from analyze.planning.information import Errors
from analyze.planning.plan import Request, finish
from analyze.planning.prepared import FRICTION, prepare
from analyze.planning.view import default_camera
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import StrikePlan


def make_plan(
    model: ObjectModel,
    spec: ObjectSpec,
    object_sha256: str,
    striker: StrikerModel,
    *,
    friction: float = FRICTION,
    errors: Errors | None = None,
    given: EarlierResult | None = None,
    cells: Pieces | None = None,
    **request: Any,
) -> StrikePlan:
    """Plan of one object; `request` has the fields of `Request`."""
    prepared = prepare(model, spec, Bench(striker, default_camera(), friction), errors, given)
    return finish(prepared, object_sha256, Request(**request), cells)
