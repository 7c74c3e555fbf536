"""Faces planned on: where it surely stands; where that is not enough, where it is expected to, which plan
and cards say."""

from __future__ import annotations

import io
from functools import cache

import numpy as np
import pytest
from rich.console import Console

from analyze.cards.page import render_cards
from analyze.geometry.object_model import load_object_model
from analyze.planning import design, view
from analyze.planning.examine import Bench
from analyze.planning.footing import SHARES, footing
from analyze.planning.hypothesis import hypothesis
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import Request, finish
from analyze.planning.prepared import Prepared, prepare
from analyze.planning.stable_planes import resting_planes, stable_planes
from analyze.verbs.plan.table import render_plan
from schemas.strike_plan import StrikePlan, parse_strike_plan
from tests.analyze.geometry.shapes import spec_of, stl
from tests.analyze.planning.comparison import compare
from tests.analyze.planning.random_bodies import FAR_TAG, convex_triangles, random_body, spec_for

BENCH = Bench(StrikerModel(fastest_m_s=5.0), view.default_camera(), 0.6)
LOPSIDED = 41
"""a hull of random points, two of whose faces surely hold c: not enough"""


@cache
def lopsided() -> tuple[Prepared, StrikePlan]:
    body = random_body(LOPSIDED)
    prepared = prepare(body.model, body.spec, BENCH)
    return prepared, finish(prepared, "0" * 64, Request(9))


def test_where_sure_faces_give_no_set_those_that_hold_the_expected_c_are_used():
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


def test_the_note_says_what_it_rests_on_and_what_to_do():
    _, plan = lopsided()
    (note,) = (text for text in plan.warnings if "where it is expected" in text)
    for name in {strike.plane_id for strike in plan.strikes if not strike.stands_surely}:
        assert f"{name} (" in note
    assert "mm inside an edge" in note
    assert "tips over by itself" in note
    assert "--given" in note


def test_surer_faces_come_first():
    prepared, plan = lopsided()
    planes = {plane.id: plane for plane in prepared.planes}
    firm = [min(planes[strike.plane_id].firmness(prepared.believed.region), 1.0) for strike in plan.strikes]
    assert np.all(np.diff(firm) < 1e-6)


def test_terminal_cards_and_file_say_it():
    prepared, plan = lopsided()
    out = io.StringIO()
    render_plan(plan, Console(file=out, width=500))
    assert "where it is expected" in out.getvalue()
    page = render_cards(plan, prepared.model, prepared.spec)
    unsure = [strike for strike in plan.strikes if not strike.stands_surely]
    assert page.count("this is not certain") == len(unsure)
    assert all("--given" in strike.card for strike in unsure)
    assert not any("--given" in strike.card for strike in plan.strikes if strike.stands_surely)
    assert parse_strike_plan(plan.model_dump_json(), "plan.json") == plan


def test_where_sure_faces_do_nothing_changes():
    spec = spec_of({"box": {"size_m": [0.08, 0.06, 0.15]}}, markers=[FAR_TAG])
    plan = finish(prepare(load_object_model(spec, None, ""), spec, BENCH), "", Request(9))
    assert all(strike.stands_surely for strike in plan.strikes)
    assert not any("expected" in text for text in plan.warnings)


@pytest.mark.parametrize("sides", [16, 24, 48])
def test_facets_of_a_flank_are_no_faces_to_stand_on(sides):
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = 30 * np.column_stack([np.cos(turn), np.sin(turn)])
    triangles = convex_triangles(
        np.vstack([np.column_stack([ring, np.full(sides, z)]) for z in (0.0, 120.0)])
    )
    spec = spec_for(triangles)
    model = load_object_model(spec, stl(triangles), "b.stl")
    planes, region = resting_planes(model), hypothesis(model).region
    for share in SHARES:
        assert all(abs(plane.up[2]) > 0.99 for plane in footing(model, planes, region, share))


@pytest.mark.parametrize("seed", [6, 7, 41, 42, 47])
def test_ours_is_not_refused_where_the_papers_set_is_regular(seed):
    """Hulls of random points and leaning prisms, whose faces hold c only where it is expected."""
    result = compare(random_body(seed), 0, seed)
    assert not result.paper.refusal
    assert not result.paper.singular
    assert not result.ours.refusal
    assert not result.ours.singular
