"""Plans that start from earlier results, plans for a target, and the advice to stop."""

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
from analyze.planning.information import SharedErrors
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import prepare_object
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
    return prepare_object(*box(), BENCH)


@cache
def first_plan(strikes):
    return plan_strikes(prepared(), "", PlanRequest(strikes))


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


def test_merged_results_do_not_understate_their_covariance():
    """Covariance intersection: no direction is surer than the surest of both, in either order."""
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


def test_edge_with_another_id_is_recognised_by_its_place():
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


def test_target_is_reached_with_the_fewest_strikes():
    found = strikes_for(prepared().information, 0.0004, 3)
    assert found is not None
    count, reached = found
    assert reached.com_rms <= 0.0004
    plan = plan_strikes(prepared(), "", PlanRequest(9, 0.0004))
    assert len(plan.strikes) == count
    assert plan.prediction.target_reached
    tighter = plan_strikes(prepared(), "", PlanRequest(9, 0.0001))
    assert len(tighter.strikes) > count


def test_target_out_of_reach_is_reported_with_the_error_reached():
    plan = plan_strikes(prepared(), "", PlanRequest(9, 1e-6))
    assert len(plan.strikes) == 9
    assert plan.prediction.target_reached is False
    assert "0.001 mm is out of reach: 36 strikes reach 0." in plan.prediction.advice


def test_larger_requested_number_may_be_used_for_the_target():
    usual, count = (
        choose_design(prepared().information, strikes).com_rms for strikes in (MAX_STRIKES, 2 * MAX_STRIKES)
    )
    target = (usual + count) / 2
    assert count < target < usual
    plan = plan_strikes(prepared(), "", PlanRequest(2 * MAX_STRIKES, target))
    assert plan.prediction.target_reached
    assert plan.prediction.com_rms_m <= target
    assert MAX_STRIKES < len(plan.strikes) <= 2 * MAX_STRIKES


def test_advice_to_stop_does_not_depend_on_the_requested_number():
    model, spec = box()
    given = given_after(6)[1]
    plans = [
        make_plan(model, spec, "", BENCH.striker, strikes=count, friction=0.6, given=given)
        for count in (1, 9)
    ]
    assert plans[0].prediction.stop == plans[1].prediction.stop


def test_advice_to_stop_when_shared_errors_dominate():
    model, spec = box()
    count = first_plan(36)
    assert count.prediction.stop
    assert "36 more would only reach 0." in count.prediction.advice
    assert "more strikes no longer pay; instead: " in count.prediction.advice
    again = make_plan(model, spec, "", BENCH.striker, strikes=3, friction=0.6, given=given_after(36)[1])
    assert "the 36 strikes so far give c to 0." in again.prediction.advice
    assert "stop striking" in again.prediction.advice
    few = first_plan(4)
    assert not few.prediction.stop
    sources = np.array(list(few.prediction.error_sources_m.values()))
    assert np.isclose(np.sqrt(np.sum(sources**2)), few.prediction.com_rms_m, rtol=1e-6)


def test_level_table_gives_a_smaller_error():
    model, spec = box()
    level = make_plan(model, spec, "", BENCH.striker, strikes=3, friction=0.6, errors=SharedErrors(tilt=1e-5))
    tilted = make_plan(
        model, spec, "", BENCH.striker, strikes=3, friction=0.6, errors=SharedErrors(tilt=0.01)
    )
    assert level.predicted_com_sd_m < tilted.predicted_com_sd_m


@pytest.mark.slow
def test_plan_from_a_recording_or_its_result(tmp_path: Path):
    """The sample recording and the JSON of its result give the same knowledge of the object.

    The next edges may differ: only the recording holds impacts, from which the striker is estimated.
    """
    from analyze.result.answer import answer_recordings

    answer = answer_recordings([SAMPLE])
    assert answer.estimate.evidence.spec.shape.file is None
    result = answer.json()
    (tmp_path / "r.json").write_text(result)
    thing = tmp_path / "object.toml"
    thing.write_bytes(_attachment(SAMPLE))
    rig = tmp_path / "rig.toml"
    rig.write_bytes(_attachment(SAMPLE, "rig.toml"))
    plan = plan_object(thing, PlanOptions(rig_path=rig, strikes=2, given=(tmp_path / "r.json",))).plan
    assert plan.strikes[0].id == f"s{sum(strike['used'] for strike in json.loads(result)['strikes']) + 1}"
    taught = plan_object(thing, PlanOptions(rig_path=rig, strikes=2, given=(SAMPLE,))).plan
    so_far = {each.prediction.advice.partition(";")[0] for each in (plan, taught)}
    assert len(so_far) == 1
    assert "4 strikes so far" in so_far.pop()
    assert [strike.id for strike in taught.strikes] == [strike.id for strike in plan.strikes]
    assert np.allclose(taught.hypothesis.com_m, plan.hypothesis.com_m, rtol=0, atol=1e-9)
    assert taught.hypothesis.striker.restitution_sd < 0.5 * plan.hypothesis.striker.restitution_sd
    (tmp_path / "other.json").write_text(result.replace(answer.result.inputs.object_sha256, "0" * 64))
    with pytest.raises(PlanError, match="is of another object"):
        plan_object(thing, PlanOptions(given=(tmp_path / "other.json",)))
    (tmp_path / "none.json").write_text("{")
    with pytest.raises(PlanError, match="is no result"):
        plan_object(thing, PlanOptions(given=(tmp_path / "none.json",)))


def _attachment(recording: Path, name: str = "object.toml") -> bytes:
    from mcap.reader import make_reader

    with recording.open("rb") as stream:
        return next(found.data for found in make_reader(stream).iter_attachments() if found.name == name)


def test_target_already_reached_is_reported():
    model, spec = box()
    plan = plan_strikes(
        prepare_object(model, spec, BENCH, SharedErrors(), given_after(9)[1]),
        "",
        PlanRequest(target_com=0.01),
    )
    assert plan.prediction is not None
    assert plan.prediction.stop
    assert plan.prediction.advice.startswith("10 mm is reached already: stop. ")


def test_plan_uses_the_rig_of_the_latest_recording(tmp_path):
    """A further plan is made for the rig that made the recording, unless another is given."""
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
