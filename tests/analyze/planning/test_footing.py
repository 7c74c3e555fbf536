"""Faces planned on: sure ones; if these do not suffice, also those that hold the expected c."""

from __future__ import annotations

import io
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from analyze.cards.page import render_cards
from analyze.geometry.object_model import load_object_model
from analyze.planning import design, view
from analyze.planning.examine import Bench
from analyze.planning.footing import Q_SCALES, footing
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import PreparedObject, prepare_object
from analyze.planning.stable_planes import resting_planes
from analyze.verbs.plan.table import render_plan
from schemas.strike_plan import StrikePlan, parse_strike_plan
from schemas.terminal import Terminal
from tests.analyze.geometry.shapes import spec_of, stl
from tests.analyze.planning.comparison import compare
from tests.analyze.planning.planned import stable_planes
from tests.analyze.planning.random_bodies import FAR_TAG, convex_triangles, random_body, spec_for

BENCH = Bench(StrikerModel(fastest_m_s=5.0), view.default_camera(), 0.6)
LOPSIDED = 41
"""seed of a hull of random points of which only two faces surely hold c"""


@cache
def lopsided() -> tuple[PreparedObject, StrikePlan]:
    body = random_body(LOPSIDED)
    prepared = prepare_object(body.model, body.spec, BENCH)
    return prepared, plan_strikes(prepared, "0" * 64, PlanRequest(9))


def test_faces_that_hold_the_expected_c_are_used_if_sure_ones_do_not_suffice():
    prepared, plan = lopsided()
    region = prepared.believed.region
    sure = {plane.id for plane in stable_planes(prepared.planes, region)}
    planes = {plane.id: plane for plane in prepared.planes}
    unsure = {strike.plane_id for strike in plan.strikes if not strike.stands_surely}
    assert unsure
    assert all(strike.stands_surely == (strike.plane_id in sure) for strike in plan.strikes)
    assert all(planes[name].margin(region.centre[None]) > 0 for name in unsure)
    only_sure = tuple(each for each in prepared.information.candidates if each.axis.plane.id in sure)
    assert not design.can_determine_com(
        type(prepared.information)(only_sure, prepared.information.belief, prepared.information.errors)
    )


def test_warning_names_the_unsure_faces_and_the_remedy():
    _, plan = lopsided()
    (note,) = (text for text in plan.warnings if "where it is expected" in text)
    for name in {strike.plane_id for strike in plan.strikes if not strike.stands_surely}:
        assert f"{name} (" in note
    assert "mm inside an edge" in note
    assert "tips over by itself" in note
    assert "--given" in note


def test_surer_faces_are_struck_first():
    prepared, plan = lopsided()
    planes = {plane.id: plane for plane in prepared.planes}
    firm = [min(planes[strike.plane_id].firmness(prepared.believed.region), 1.0) for strike in plan.strikes]
    assert np.all(np.diff(firm) < 1e-6)


def test_terminal_cards_and_file_contain_the_warning():
    prepared, plan = lopsided()
    out = io.StringIO()
    render_plan(plan, Terminal(file=out, width=500))
    assert "where it is expected" in out.getvalue()
    page = render_cards(plan, prepared.model, prepared.spec)
    unsure = [strike for strike in plan.strikes if not strike.stands_surely]
    assert page.count("this is not certain") == len(unsure)
    assert all("--given" in strike.card for strike in unsure)
    assert not any("--given" in strike.card for strike in plan.strikes if strike.stands_surely)
    assert parse_strike_plan(plan.model_dump_json(), "plan.json") == plan


def test_sure_faces_give_no_warning():
    spec = spec_of({"box": {"size_m": [0.08, 0.06, 0.15]}}, markers=[FAR_TAG])
    plan = plan_strikes(prepare_object(load_object_model(spec, None, ""), spec, BENCH), "", PlanRequest(9))
    assert all(strike.stands_surely for strike in plan.strikes)
    assert not any("expected" in text for text in plan.warnings)


@pytest.mark.parametrize("sides", [16, 24, 48])
def test_facets_of_a_round_flank_are_not_planned_on(sides):
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = 30 * np.column_stack([np.cos(turn), np.sin(turn)])
    triangles = convex_triangles(
        np.vstack([np.column_stack([ring, np.full(sides, z)]) for z in (0.0, 120.0)])
    )
    spec = spec_for(triangles)
    model = load_object_model(spec, stl(triangles), "b.stl")
    planes, region = resting_planes(model), hypothesis(model).region
    for share in Q_SCALES:
        assert all(abs(plane.up[2]) > 0.99 for plane in footing(model, planes, region, share))


@pytest.mark.parametrize("seed", [6, 7, 41, 42, 47])
def test_our_plan_is_not_refused_where_the_paper_has_a_regular_set(seed):
    """Hulls of random points and leaning prisms on whose faces c is expected, but not sure, to lie."""
    result = compare(random_body(seed), 0, seed)
    assert not result.paper.refusal
    assert not result.paper.singular
    assert not result.ours.refusal
    assert not result.ours.singular


def test_a_wide_face_with_bevels_beside_it_is_no_facet_of_a_round_flank():
    """A hammer on its cheek: the face is far larger than a facet of a flank of 16 sides or more could be."""
    outline = np.array(
        [[-30, 0], [30, 0], [33, 0.8], [33, 39.2], [30, 40], [-30, 40], [-33, 39.2], [-33, 0.8]]
    )
    prism = np.vstack([np.insert(outline, 1, y, axis=1) for y in (0.0, 100.0)])
    model = load_object_model(spec_for(triangles := convex_triangles(prism)), stl(triangles), "hammer.stl")
    planes = resting_planes(model)
    # The region reaches beyond the bevelled edges by a fifth of their distance.
    region = replace(hypothesis(model).region, centre=np.array([0.0, 0.05, 0.02]), axes=np.eye(3))
    region = replace(region, half=np.array([0.0375, 0.01, 0.01]), groups=(0, 1, 2))
    wide = {plane.id for plane in planes if abs(plane.up[2]) > 0.99 and plane.area > 0.005}
    assert len(wide) == 2
    assert not wide & {plane.id for plane in footing(model, planes, region, 1.0)}
    assert wide <= {plane.id for plane in footing(model, planes, region, 0.5)}


def test_a_facet_of_a_round_flank_is_no_face_to_stand_on():
    angle = np.arange(24) * np.pi / 12
    rim = 40 * np.column_stack([np.cos(angle), np.sin(angle)])
    triangles = convex_triangles(np.vstack([np.column_stack([rim, np.full(24, z)]) for z in (0.0, 150.0)]))
    model = load_object_model(spec_for(triangles), stl(triangles), "rod.stl")
    planes = resting_planes(model)
    found = footing(model, planes, hypothesis(model).region, 0.0)
    assert all(abs(plane.up[2]) > 0.99 for plane in found)


def test_a_flat_end_between_rounded_edges_is_a_face_to_stand_on():
    """A bar whose four upright edges are rounded by 8 mm, in facets 0.22 times as wide as its flat end."""
    quarter = np.radians(np.linspace(0, 90, 5))
    arc = 8 * np.column_stack([np.cos(quarter), np.sin(quarter)])
    corners = [(np.array([72.0, 7.0]) + arc) * (x, y) for x in (1, -1) for y in (1, -1)]
    outline = np.vstack(corners)
    triangles = convex_triangles(
        np.vstack([np.column_stack([outline, np.full(len(outline), z)]) for z in (0.0, 40.0)])
    )
    model = load_object_model(spec_for(triangles), stl(triangles), "bar.stl")
    planes, region = resting_planes(model), hypothesis(model).region
    ends = {plane.id for plane in planes if abs(plane.up[0]) > 0.999}
    assert len(ends) == 2
    assert ends <= {plane.id for plane in footing(model, planes, region, 0.5)}
    assert not ends & {plane.id for plane in footing(model, planes, region, 1.0)}
