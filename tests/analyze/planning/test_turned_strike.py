"""`--gravity`: an additional strike, turned by 180 degrees, that measures the table's tilt."""

import re
from dataclasses import replace

import numpy as np
import pytest

from analyze.cards.page import placement_cards
from analyze.errors import PlanError
from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.geometry.object_model import load_object_model
from analyze.planning.earlier_results import EarlierResult, StrikeMade
from analyze.planning.examine import Bench
from analyze.planning.forecast import error_so_far
from analyze.planning.impact import StrikerModel
from analyze.planning.information import TILT as TILT_TERM
from analyze.planning.information import SharedErrors
from analyze.planning.prepared import prepare_object
from analyze.planning.view import default_camera
from tests.analyze.estimation.bodies import fit_of
from tests.analyze.geometry.shapes import spec_of
from tests.analyze.planning.planned import make_plan

BENCH = Bench(StrikerModel(), default_camera(), 0.6)
SIZE = (0.08, 0.06, 0.15)
TILT = float(np.radians(0.5))


def tag(number, axis, sign):
    z, x = np.zeros(3), np.zeros(3)
    z[axis], x[(axis + 1) % 3] = sign, 1.0
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    T[:3, 3] = z * np.array(SIZE) / 2
    return {"id": number, "size_m": 0.036, "T_object_marker": T.tolist()}


ALL_ROUND = [tag(2 * axis + (sign < 0), axis, sign) for axis in range(3) for sign in (1, -1)]


def box(markers):
    spec = spec_of(
        {"box": {"size_m": list(SIZE)}}, markers=markers, edge_radius_m=0.001, edge_radius_sd_m=0.0001
    )
    return load_object_model(spec, None, ""), spec


def planned(markers, strikes=6, **more):
    model, spec = box(markers)
    return make_plan(
        model,
        spec,
        "",
        BENCH.striker,
        strikes=strikes,
        friction=BENCH.friction,
        errors=SharedErrors(tilt=TILT),
        **more,
    )


@pytest.fixture(scope="module")
def plan():
    return planned(ALL_ROUND, gravity=True)


@pytest.fixture(scope="module")
def short():
    """Plan of three strikes and the turned one."""
    return planned(ALL_ROUND, strikes=3, gravity=True)


def test_turned_strike_repeats_a_planned_edge(plan):
    *usual, turned = plan.strikes
    assert len(usual) == 6
    assert {strike.heading_rad for strike in usual} == {0.0}
    assert turned.heading_rad == pytest.approx(np.pi)
    before = next(strike for strike in usual if strike.axis_id == turned.axis_id)
    assert (turned.R_world_object, turned.pivot, turned.tip_speed_m_s) == (
        before.R_world_object,
        before.pivot,
        before.tip_speed_m_s,
    )
    assert turned.visible_markers != before.visible_markers
    pose = np.array(turned.camera_pose)
    assert pose[:3, 2] == pytest.approx([0, -1, 0]), "from the other end of the edge"
    assert pose[:3, 3] == pytest.approx([-0.03, 0.55, 0.08])


def test_card_describes_the_turn(plan):
    turned = plan.strikes[-1]
    assert "turned by 180 degrees" in turned.card
    assert "on the other side of the line" in turned.card
    assert f"marker {turned.visible_markers[0]} towards the camera" in turned.card


def test_printed_card_shows_the_other_side(short):
    *_, before, turned = placement_cards(short, *box(ALL_ROUND))
    assert "to the other side of the line" in turned.change
    assert not turned.repeated
    assert turned.put_down.startswith(f"Tag {turned.strike.visible_markers[0]} faces the camera")
    assert before.put_down.startswith(f"Tag {before.strike.visible_markers[0]} faces the camera")
    assert "seen from opposite the camera" in turned.scene
    assert ">camera<" in before.scene
    assert ">camera<" not in turned.scene + turned.above


def estimated_com(plan):
    """Centre of mass estimated from strikes that move as the plan predicts."""
    planes = []
    for strike in plan.strikes:
        fit = fit_of(
            strike.phi_predicted_rad, 60.0, max(np.sqrt(strike.phi_measured_sd_rad**2 - 5e-4**2), 1e-5), 0.3
        )
        planes.append(equiplane_from_fit(strike.id, strike, fit))
    half = np.array(SIZE) / 2
    return centre_of_mass(
        planes, SystematicErrors(TILT, edge_radius_sd=1e-4), ComPrior.from_bounds(-half, half)
    )


def test_predicted_error_equals_that_of_the_estimate(plan):
    com = estimated_com(plan)
    assert np.sqrt(np.trace(com.covariance)) == pytest.approx(plan.prediction.com_rms_m, rel=0.15)
    assert com.tilts[0].sd[0] < 0.1 * TILT


def test_plan_after_a_turned_strike_uses_its_tilt(short):
    """Three edges do not cancel the tilt: with the turned strike taken as a usual one its prior remains."""
    made = tuple(
        StrikeMade(each.axis_id, each.phi_measured_sd_rad, None, each.heading_rad) for each in short.strikes
    )
    com = estimated_com(short)
    model, spec = box(ALL_ROUND)
    so_far = EarlierResult("so far", com.position, com.covariance, None, made)
    known = prepare_object(model, spec, BENCH, SharedErrors(tilt=TILT), so_far).information
    assert error_so_far(known) == pytest.approx(np.sqrt(np.trace(com.covariance)), rel=0.15)
    usual = replace(so_far, strikes=tuple(replace(each, heading=0.0) for each in made))
    blind = prepare_object(model, spec, BENCH, SharedErrors(tilt=TILT), usual).information
    assert error_so_far(blind) > 1.5 * error_so_far(known)
    assert known.covariance([], [])[TILT_TERM, TILT_TERM] < (0.1 * TILT) ** 2


def test_error_so_far_excludes_the_planned_turned_strike(short):
    usual = [strike for strike in short.strikes if not strike.heading_rad]
    made = tuple(StrikeMade(each.axis_id, each.phi_measured_sd_rad, None) for each in usual)
    so_far = EarlierResult("so far", np.zeros(3), np.array(short.predicted_com_covariance_m2), None, made)
    advice = [
        planned(ALL_ROUND, strikes=1, given=so_far, gravity=gravity).prediction.advice
        for gravity in (False, True)
    ]
    figures = [float(re.search(r"so far give c to ([\d.]+) mm", each).group(1)) for each in advice]
    assert figures[0] == figures[1]


def test_object_with_markers_on_one_side_is_refused_with_the_remedy():
    with pytest.raises(
        PlanError, match=r"sees its other side.*marker on the opposite side too.*analyze gravity"
    ):
        planned([tag(1, 0, -1), tag(3, 1, -1), tag(5, 2, -1)], strikes=3, gravity=True)


def test_markers_without_a_pose_are_not_checked():
    found = planned([{"id": 0, "size_m": 0.03}], gravity=True)
    assert found.strikes[-1].heading_rad == pytest.approx(np.pi)
