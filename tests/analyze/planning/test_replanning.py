"""Plans that start from a result so far, plans for a target, and the advice to stop."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from analyze.errors import PlanError
from analyze.geometry.object_model import load_object_model
from analyze.pipeline.merge import edge_line
from analyze.planning.design import choose_design
from analyze.planning.earlier_results import EarlierResult, StrikeMade, merge_results
from analyze.planning.examine import Bench
from analyze.planning.forecast import MAX_STRIKES, strikes_for
from analyze.planning.impact import StrikerModel
from analyze.planning.information import Errors
from analyze.planning.plan import Request, finish
from analyze.planning.prepared import prepare
from analyze.planning.view import default_camera
from analyze.reading.recording import open_recording
from analyze.verbs.plan import plan_object as plan_files
from analyze.verbs.plan.plan_object import PlanOptions, plan_object
from tests.analyze.geometry.shapes import spec_of
from tests.analyze.planning.planned import make_plan
from tests.analyze.planning.random_bodies import FAR_TAG
from tests.places import SAMPLE

BENCH = Bench(StrikerModel(), default_camera(), 0.6)
COM = np.array([0.004, -0.003, 0.012])


@cache
def box():
    spec = spec_of(
        {"box": {"size_m": [0.08, 0.06, 0.15]}},
        markers=[FAR_TAG],
        edge_radius_m=0.001,
        edge_radius_sd_m=0.0002,
    )
    return load_object_model(spec, None, ""), spec


@cache
def prepared():
    return prepare(*box(), BENCH)


@cache
def first_plan(strikes):
    return finish(prepared(), "", Request(strikes))


@cache
def given_after(strikes):
    first = first_plan(strikes)
    made = tuple(StrikeMade(strike.axis_id, strike.phi_measured_sd_rad, 0.005) for strike in first.strikes)
    directions = {strike.axis_id: np.array(strike.pivot.direction) for strike in first.strikes}
    return first, EarlierResult(
        "so far", COM, np.array(first.predicted_com_covariance_m2), None, made, directions
    )


def test_posterior_is_the_next_plans_prior():
    model, spec = box()
    first, given = given_after(6)
    blind = first_plan(3)
    after = make_plan(model, spec, "", BENCH.striker, strikes=3, friction=BENCH.friction, given=given)
    assert [strike.id for strike in after.strikes] == ["s7", "s8", "s9"]
    assert after.predicted_com_sd_m < first.predicted_com_sd_m
    assert after.predicted_com_sd_m < blind.predicted_com_sd_m
    assert max(strike.phi_predicted_sd_rad for strike in after.strikes) < 0.2 * max(
        strike.phi_predicted_sd_rad for strike in blind.strikes
    )
    for strike in after.strikes:
        arm = COM - np.array(strike.pivot.point)
        R = np.array(strike.R_world_object)
        assert np.isclose(np.tan(strike.phi_predicted_rad), -(R[0] @ arm) / (R[2] @ arm), rtol=1e-6)
    assert "6 strikes so far" in after.prediction.advice


def test_a_single_further_strike_can_be_planned():
    _, given = given_after(6)
    model, spec = box()
    plan = make_plan(model, spec, "", BENCH.striker, strikes=1, friction=BENCH.friction, given=given)
    assert [strike.id for strike in plan.strikes] == ["s7"]


def test_another_objects_result_is_refused():
    _, given = given_after(6)
    model, spec = box()
    for wrong in (
        replace(given, strikes=(StrikeMade("p99e9", 0.001, None),)),
        replace(given, directions={key: -value for key, value in given.directions.items()}),
    ):
        with pytest.raises(PlanError, match=r"so far: strike on axis .*plan from the first strike anew"):
            make_plan(model, spec, "", BENCH.striker, strikes=3, given=wrong)


def test_results_that_share_unknown_errors_are_never_joined_to_more_than_they_know():
    """Covariance intersection: no direction surer than the surest of both, and c between them; whatever
    the order."""
    _, given = given_after(6)
    flat, tall = (
        replace(given, com=COM + shift, com_covariance=np.diag(sd) ** 2)
        for shift, sd in (
            (np.array([1e-4, 0, 0]), [2e-4, 2e-4, 2e-3]),
            (np.array([-1e-4, 0, 0]), [1e-3, 1e-3, 3e-4]),
        )
    )
    both = merge_results([replace(flat, name="flat"), replace(tall, name="tall")])
    assert both.name in {"flat, tall", "tall, flat"}
    assert np.trace(both.com_covariance) < min(np.trace(flat.com_covariance), np.trace(tall.com_covariance))
    best = np.minimum(np.diag(flat.com_covariance), np.diag(tall.com_covariance))
    assert (np.diag(both.com_covariance) >= best).all()
    assert len(both.strikes) == len(flat.strikes) + len(tall.strikes)
    assert np.allclose(merge_results([replace(tall, name="tall"), replace(flat, name="flat")]).com, both.com)
    same = merge_results([given, given])
    assert np.allclose(same.com_covariance, given.com_covariance), "the same twice is known no better"


def test_an_edge_made_under_another_name_is_known_by_its_place():
    model, spec = box()
    first, given = given_after(6)
    edges = {f"old {strike.axis_id}": edge_line(strike) for strike in first.strikes}
    older = replace(
        given,
        strikes=tuple(replace(each, axis_id=f"old {each.axis_id}") for each in given.strikes),
        directions={},
        edges=edges,
    )
    plans = [
        make_plan(model, spec, "", BENCH.striker, strikes=2, friction=0.6, given=each)
        for each in (given, older)
    ]
    assert plans[0].predicted_com_covariance_m2 == plans[1].predicted_com_covariance_m2
    assert [strike.axis_id for strike in plans[0].strikes] == [strike.axis_id for strike in plans[1].strikes]


def test_target_is_met_with_the_fewest_strikes():
    found = strikes_for(prepared().information, 0.0004, 3)
    assert found is not None
    many, reached = found
    assert reached.com_rms <= 0.0004
    plan = finish(prepared(), "", Request(9, 0.0004))
    assert len(plan.strikes) == many
    assert plan.prediction.target_reached
    tighter = finish(prepared(), "", Request(9, 0.0001))
    assert len(tighter.strikes) > many


def test_target_out_of_reach_says_how_near_it_comes():
    plan = finish(prepared(), "", Request(9, 1e-6))
    assert len(plan.strikes) == 9
    assert plan.prediction.target_reached is False
    assert "0.001 mm is out of reach: 36 strikes come to 0." in plan.prediction.advice


def test_more_strikes_asked_for_may_be_used_for_the_target():
    usual, many = (
        choose_design(prepared().information, strikes).com_rms for strikes in (MAX_STRIKES, 2 * MAX_STRIKES)
    )
    target = (usual + many) / 2
    assert many < target < usual
    plan = finish(prepared(), "", Request(2 * MAX_STRIKES, target))
    assert plan.prediction.target_reached
    assert plan.prediction.com_rms_m <= target
    assert MAX_STRIKES < len(plan.strikes) <= 2 * MAX_STRIKES


def test_whether_to_stop_does_not_hang_on_how_many_were_asked_for():
    model, spec = box()
    given = given_after(6)[1]
    plans = [
        make_plan(model, spec, "", BENCH.striker, strikes=many, friction=0.6, given=given) for many in (1, 9)
    ]
    assert plans[0].prediction.stop == plans[1].prediction.stop


def test_advice_to_stop_when_what_strikes_share_dominates():
    model, spec = box()
    many = first_plan(36)
    assert many.prediction.stop
    assert "36 more would only bring 0." in many.prediction.advice
    assert "more strikes no longer pay; instead: " in many.prediction.advice
    again = make_plan(model, spec, "", BENCH.striker, strikes=3, friction=0.6, given=given_after(36)[1])
    assert "the 36 strikes so far give c to 0." in again.prediction.advice
    assert "stop striking" in again.prediction.advice
    few = first_plan(4)
    assert not few.prediction.stop
    sources = np.array(list(few.prediction.error_sources_m.values()))
    assert np.isclose(np.sqrt(np.sum(sources**2)), few.prediction.com_rms_m, rtol=1e-6)


def test_a_level_table_and_good_edges_help():
    model, spec = box()
    level = make_plan(model, spec, "", BENCH.striker, strikes=3, friction=0.6, errors=Errors(tilt=1e-5))
    tilted = make_plan(model, spec, "", BENCH.striker, strikes=3, friction=0.6, errors=Errors(tilt=0.01))
    assert level.predicted_com_sd_m < tilted.predicted_com_sd_m


@pytest.mark.slow
def test_a_recordings_result_is_taken_up(tmp_path: Path):
    """The committed sample: estimated, its posterior becomes the prior; the result's JSON does the same."""
    from analyze.pipeline.estimate import estimate_recording
    from analyze.result.document import result_json

    estimate = estimate_recording(SAMPLE)
    spec = estimate.evidence.spec
    assert spec.shape.file is None
    result = result_json(estimate.result)
    (tmp_path / "r.json").write_text(result)
    thing = tmp_path / "object.toml"
    thing.write_bytes(_attachment(SAMPLE))
    plan = plan_object(thing, PlanOptions(strikes=2, given=(tmp_path / "r.json",))).plan
    assert plan.strikes[0].id == f"s{sum(strike['used'] for strike in json.loads(result)['strikes']) + 1}"
    taught = plan_object(thing, PlanOptions(strikes=2, given=(SAMPLE,))).plan
    assert taught.prediction == plan.prediction
    assert [strike.axis_id for strike in taught.strikes] == [strike.axis_id for strike in plan.strikes]
    # Only the recording holds what the striker gave.
    assert taught.hypothesis.striker.restitution_sd < 0.5 * plan.hypothesis.striker.restitution_sd
    (tmp_path / "other.json").write_text(result.replace(estimate.result.inputs.object_sha256, "0" * 64))
    with pytest.raises(PlanError, match="is of another object"):
        plan_object(thing, PlanOptions(given=(tmp_path / "other.json",)))
    (tmp_path / "none.json").write_text("{")
    with pytest.raises(PlanError, match="is no result"):
        plan_object(thing, PlanOptions(given=(tmp_path / "none.json",)))


def _attachment(recording: Path) -> bytes:
    from mcap.reader import make_reader

    with recording.open("rb") as stream:
        return next(
            found.data for found in make_reader(stream).iter_attachments() if found.name == "object.toml"
        )


def test_a_target_that_is_reached_already_is_said():
    model, spec = box()
    plan = finish(prepare(model, spec, BENCH, Errors(), given_after(9)[1]), "", Request(target_com=0.01))
    assert plan.prediction is not None
    assert plan.prediction.stop
    assert plan.prediction.advice.startswith("10 mm is reached already: stop. ")


def test_the_rig_of_the_last_recording_given_is_the_one_planned_for(tmp_path):
    """A plan that goes on is struck on the rig that made the recording, unless another is named."""
    with open_recording(SAMPLE) as recording:
        rig_file = tmp_path / "rig.toml"
        rig_file.write_bytes(recording.attachments["rig.toml"])
    found, notes = plan_files._rig_of(PlanOptions(given=(SAMPLE,)))
    named, silent = plan_files._rig_of(PlanOptions(rig_path=rig_file, given=(SAMPLE,)))
    assert found.config == named.config
    assert np.array_equal(found.bench.camera.T_world_camera, named.bench.camera.T_world_camera)
    assert notes == [f"planned for the rig of {SAMPLE}: for another rig give its file with --rig"]
    assert silent == []
    assert plan_files._rig_of(PlanOptions())[0].config is None
