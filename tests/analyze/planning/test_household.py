"""Household objects that were refused although they tip: planned, and tipped as planned in MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.next_edge import CARRYING_SHARE, over_close_lines, with_next_edge
from analyze.planning.pivots import PivotAxis, pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.reading.object_file import read_object_files
from schemas.object_spec import ObjectSpec
from tests.analyze.planning.planned import make_plan
from tests.analyze.planning.whole_tip import TrueBody, whole_tip
from tests.world.catalogue import make
from tests.world.object_files import write_object


def loaded(name: str, folder) -> tuple[ObjectModel, ObjectSpec]:
    files = read_object_files(write_object(make(name, 1), "cad", folder))
    return load_object_model(files.spec, files.shape_bytes, files.shape_name), files.spec


def base_axes(model: ObjectModel, spec: ObjectSpec) -> list[PivotAxis]:
    """Axes of the largest resting face, with the edge that lands next."""
    believed = hypothesis(model)
    axes = pivot_axes(model, spec, resting_planes(model)[:1], believed)
    return [with_next_edge(model, axis, believed.region) for axis in axes]


@pytest.mark.parametrize(
    ("name", "friction"),
    [
        ("mug", 0.5),
        ("funnel", 0.4),
        *(pytest.param(name, 0.5, marks=pytest.mark.slow) for name in ("soup_can", "dish_soap")),
    ],
)
def test_refused_objects_are_planned_and_tip_as_planned(name, friction, tmp_path):
    model, spec = loaded(name, tmp_path)
    plan = make_plan(model, spec, "", StrikerModel(fastest_m_s=5.0), friction=friction)
    assert plan.predicted_com_sd_m is not None
    assert plan.predicted_com_sd_m < 0.01 * float(model.extent.max())
    body = TrueBody(spec.mass_kg, model.centroid, model.unit_inertia * spec.mass_kg)
    strikes = list({strike.axis_id: strike for strike in plan.strikes}.values())
    assert len(strikes) >= 3
    for strike in strikes:
        tip = whole_tip(model, strike, body)
        assert tip.is_over
        assert tip.until_balance(tip.aside) < np.radians(5)


def test_a_mug_tips_towards_its_handle_until_that_lands(tmp_path):
    """Its foot rolls up to 45 deg, and balances at 36 deg: the handle lands after."""
    model, spec = loaded("mug", tmp_path)
    lands = [
        np.degrees(axis.next_edge.takes_over)
        for axis in base_axes(model, spec)
        if axis.next_edge is not None and axis.carries_for(CARRYING_SHARE)
    ]
    assert lands == [pytest.approx(45, abs=2)]


def test_the_small_rounding_of_a_cans_rim_is_one_line(tmp_path):
    """Its facets of 0.15 mm turn by 18 deg, on a radius of 0.5 mm, too small to roll on."""
    model, spec = loaded("soup_can", tmp_path)
    region = hypothesis(model).region
    waiting = [axis for axis in base_axes(model, spec) if not axis.carries_for(CARRYING_SHARE)]
    assert waiting
    for axis in waiting:
        amid = over_close_lines(model, axis, region)
        assert amid is not None
        assert 3e-4 < amid.lines_apart < 1e-3
        assert amid.sd < 8e-4


def test_flat_sides_of_an_oval_are_tipped_over_beside_the_centre_of_mass(tmp_path):
    """The centre of mass of the bottle is 5 mm off the middle of its sides, and 20 mm from them."""
    model, spec = loaded("dish_soap", tmp_path)
    centre = hypothesis(model).region.centre
    away = sorted(float(np.max((axis.plane.polygon - centre) @ axis.tip)) for axis in base_axes(model, spec))
    assert away == pytest.approx([0.020, 0.020, 0.032, 0.042], abs=0.002)


def test_a_rounding_that_ends_before_balance_is_no_axis(tmp_path):
    """A pear's foot rolls on 8 mm up to 28 deg, then lies on its belly; balance comes at 32 deg or later."""
    model, spec = loaded("pear", tmp_path)
    axes = base_axes(model, spec)
    assert axes
    assert not any(axis.carries_for(0.0) for axis in axes)
    assert all(over_close_lines(model, axis, hypothesis(model).region) is None for axis in axes)
