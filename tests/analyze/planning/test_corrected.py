"""Pivots updated to a corrected object file equal those of a plan made with that file."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.geometry.edge_radius import ASSUMED
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning.corrected import corrected_pivot
from analyze.planning.hypothesis import hypothesis
from analyze.planning.pivots import PivotAxis, pivot_axes
from analyze.planning.stable_planes import resting_planes
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import Pivot
from tests.analyze.geometry.shapes import spec_of, stl
from tests.analyze.planning.test_planes_and_pivots import frustum, hexagon

SHAPES = {"box": None, "leaning walls": frustum(30, 22, 90), "hexagon": hexagon(35, 80)}
MICROMETRE = 1e-6


def described(name: str, radius: float | None, surface_sd: float | None) -> tuple[ObjectSpec, ObjectModel]:
    triangles = SHAPES[name]
    shape = {"box": {"size_m": [0.06, 0.05, 0.2]}} if triangles is None else {"file": "b.stl", "unit": "mm"}
    spec = spec_of({**shape, "surface_sd_m": surface_sd}, edge_radius_m=radius)
    return spec, load_object_model(spec, None if triangles is None else stl(triangles), "b.stl")


def axes_of(spec: ObjectSpec, model: ObjectModel) -> dict[str, PivotAxis]:
    return {axis.id: axis for axis in pivot_axes(model, spec, resting_planes(model), hypothesis(model))}


def pivot_of(axis: PivotAxis) -> Pivot:
    return Pivot(
        point=axis.point.tolist(), direction=axis.direction.tolist(), radius_m=axis.radius, sd_m=axis.sd
    )


@pytest.mark.parametrize("name", list(SHAPES))
@pytest.mark.parametrize(
    ("planned", "measured"),
    [((0.001, 0.0), (0.003, 2e-4)), ((0.0, 3e-4), (0.002, 0.0)), ((0.002, 0.0), (0.0, 0.0))],
)
def test_corrected_pivot_equals_that_of_a_new_plan(name, planned, measured):
    before, _ = described(name, *planned)
    corrected, model = described(name, *measured)
    wanted = axes_of(corrected, model)
    for axis_id, axis in axes_of(*described(name, *planned)).items():
        found = corrected_pivot(pivot_of(axis), axis_id, axis.R_world_object, before, corrected, model)
        off = np.array(found.point) - wanted[axis_id].point
        assert np.linalg.norm(off - axis.direction * (off @ axis.direction)) < MICROMETRE
        assert found.radius_m == pytest.approx(wanted[axis_id].radius, abs=1e-12)
        assert found.sd_m == pytest.approx(wanted[axis_id].sd, abs=1e-9)


def test_moulded_radius_is_kept():
    before, model = described("box", 0.001, 0.0)
    corrected, _ = described("box", 0.003, 0.0)
    axis = next(iter(axes_of(before, model).values()))
    moulded = pivot_of(axis).model_copy(update={"radius_m": 0.008})
    assert corrected_pivot(moulded, axis.id, axis.R_world_object, before, corrected, model) == moulded


@pytest.mark.parametrize("name", list(SHAPES))
def test_sharp_edges_of_older_plans_take_the_radius_that_is_assumed(name):
    not_given, model = described(name, None, 0.0)
    sharp = not_given.model_copy(update={"edge_radius_m": 0.0, "edge_radius_sd_m": 1e-4})
    wanted = axes_of(not_given, model)
    for axis_id, axis in axes_of(sharp, model).items():
        assert axis.radius == 0.0
        found = corrected_pivot(pivot_of(axis), axis_id, axis.R_world_object, not_given, not_given, model)
        off = np.array(found.point) - wanted[axis_id].point
        assert np.linalg.norm(off - axis.direction * (off @ axis.direction)) < MICROMETRE
        assert found.radius_m == pytest.approx(ASSUMED.mean)


@pytest.mark.parametrize("name", list(SHAPES))
def test_edges_of_older_plans_take_the_surface_error_that_is_assumed(name):
    """Older plans took a shape without a stated error as exact."""
    exact, model = described(name, 0.001, 0.0)
    not_stated, _ = described(name, 0.001, None)
    wanted = axes_of(*described(name, 0.001, None))
    for axis_id, axis in axes_of(exact, model).items():
        for planned in (axis, wanted[axis_id]):
            found = corrected_pivot(
                pivot_of(planned), axis_id, axis.R_world_object, not_stated, not_stated, model
            )
            assert found.sd_m == pytest.approx(wanted[axis_id].sd, rel=1e-9)
