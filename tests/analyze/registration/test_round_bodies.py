"""Tags on cans are found from tips over the round rim; what no strike shows of a round body is said."""

from __future__ import annotations

import math

import numpy as np

from analyze.registration.register import register
from analyze.registration.round_body import free_turn, rim_centre
from tests.analyze.registration.tagged_boxes import about, draw_box, plan_of
from tests.analyze.registration.tagged_cans import draw_can, errors_but_turn, rim_plan, seen_tips

TURN, PLACE = math.radians(0.2), 4e-4


def _found(can, views, **how):
    return register(views, can.sizes, can.thickness, can.model, **how)


def _check(can, places):
    turns, away = errors_but_turn(can, places)
    sd = np.array([np.sqrt(np.diag(place.covariance)) for place in places])
    assert np.linalg.norm(turns, axis=1).max() < TURN
    assert np.linalg.norm(away, axis=1).max() < PLACE
    assert np.all(np.abs(np.concatenate([turns, away], axis=1)) < 4 * sd + 1e-9)
    assert not any(place.undetermined for place in places)


def test_cards_that_touch_the_flank_are_found_against_each_other():
    """The can yaws, rolls along its rim and was put down by hand; the first tag defines O's direction."""
    rng = np.random.default_rng(15)
    can = draw_can(rng, [-90, -45])
    views = seen_tips(can, rng, [0, 45])
    assert all(view.on_rim and len(view.theta) > 20 for view in views)
    places = _found(can, views).markers
    _check(can, places)
    assert {place.marker_id for place in places} == {0, 1}
    # Where the object file states poses, its direction about the axis is kept.
    turn = np.eye(4)
    turn[:3, :3] = about([0, 0, 1], 0.3)
    turned = {name: turn @ T for name, T in can.T.items()}
    kept = _found(can, views, given=turned).markers
    _check(can, kept)
    off = kept[0].T_object_marker[:3, :3] @ turned[0][:3, :3].T
    assert abs(off[1, 0] - off[0, 1]) < 2e-3


def test_a_card_that_stands_off_by_an_unstated_height_is_found_from_three_directions():
    rng = np.random.default_rng(11)
    can = draw_can(rng, [-90], stands_off=4e-3, stated=0.0)
    places = _found(can, seen_tips(can, rng, [0, 45, -45])).markers
    _check(can, places)
    assert not places[0].on_surface


def test_a_tag_that_no_image_ties_to_the_first_is_named_with_the_remedy():
    rng = np.random.default_rng(14)
    can = draw_can(rng, [-90, 90])
    first, other = _found(can, seen_tips(can, rng, [0, 180])).markers
    assert not first.undetermined
    assert any("turn about O's z" in text for text in other.undetermined)
    assert "turned about its axis against marker 0" in other.remedy


def test_rims_and_bodies_of_revolution_are_recognised():
    rng = np.random.default_rng(1)
    can, box = draw_can(rng, [-90]), draw_box(rng, edges=1)
    plan = rim_plan(can, 0.7, 1)
    centre = rim_centre(can.model, plan)
    assert centre is not None
    assert np.linalg.norm(centre[:2]) < 1e-4
    assert rim_centre(box.model, plan_of(box.size, box.edges[0])) is None
    views = seen_tips(can, rng, [0])
    assert free_turn(can.model, views) is not None
    assert free_turn(box.model, views) is None
