"""Choice of the next strike, and the precision that it is expected to give."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.inertia import shape_prior
from analyze.estimation.joint import MomentModel
from analyze.estimation.priors import ComPrior
from analyze.pipeline.equiplanes import systematic_errors
from analyze.pipeline.estimate import EstimateOptions
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.frame_rate import stated_scale
from analyze.pipeline.next_strike import (
    Progress,
    Reached,
    Target,
    choose_strike,
    reached,
    stopping_checks,
)
from analyze.pipeline.solved import SolvedStrikes, body_cells, solve_strikes
from analyze.pipeline.strike_forecast import StrikeForecast, strike_forecast
from schemas.edge_names import edge_names
from tests.analyze.simulated_session import carton, session

TARGET = Target(com=5e-4)


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return session(carton(), np.random.default_rng(3))


def part(evidence: Evidence, count: int) -> Evidence:
    """Evidence of the first strikes over different edges, then of further ones."""
    first = {evidence.planned(motion).axis_id: motion for motion in reversed(evidence.motions)}
    ordered = [*first.values(), *(each for each in evidence.motions if each not in first.values())]
    return replace(evidence, motions=tuple(ordered[:count]))


def forecast(evidence: Evidence, solved: SolvedStrikes | None) -> StrikeForecast:
    moments = MomentModel(stated_scale(evidence), shape_prior(body_cells(evidence.spec, evidence.model)))
    problem = (systematic_errors(evidence), ComPrior.from_bounds(*evidence.model.bounds), moments)
    return strike_forecast(evidence, evidence.plan.strikes, problem, solved)


def choice(evidence: Evidence, target: Target = TARGET, **given):
    solved = solve_strikes(evidence, EstimateOptions()) if len(evidence.motions) >= 3 else None
    used = 0 if solved is None else len(solved.used)
    progress = Progress(**{"left": 10, "used": used, **given})
    names = edge_names(evidence.plan.strikes)
    return choose_strike(forecast(evidence, solved), target, progress, names)


def test_the_forecast_of_no_further_strike_is_the_present_precision(evidence):
    some = part(evidence, 6)
    solved = solve_strikes(some, EstimateOptions())
    model = forecast(some, solved)
    now = model.precision(np.zeros(len(model.strikes)))
    np.testing.assert_allclose(now.com, solved.solution.covariance[:3, :3], rtol=0.02, atol=1e-10)


def test_the_forecast_of_a_strike_is_what_it_then_gives(evidence):
    some, more = part(evidence, 5), part(evidence, 6)
    model = forecast(some, solve_strikes(some, EstimateOptions()))
    planned = more.planned(more.motions[5])
    counts = np.array([float(each.axis_id == planned.axis_id) for each in model.strikes])
    expected = np.sqrt(np.trace(model.precision(counts).com))
    then = solve_strikes(more, EstimateOptions()).solution.covariance[:3, :3]
    assert expected == pytest.approx(np.sqrt(np.trace(then)), rel=0.15)


def test_the_first_strikes_go_over_different_edges(evidence):
    struck: list[str] = []
    for count in range(4):
        chosen = choice(part(evidence, count) if count else replace(evidence, motions=()))
        assert chosen.strike is not None
        struck.append(chosen.strike.axis_id)
    made = [evidence.planned(motion).axis_id for motion in part(evidence, 3).motions]
    assert struck[1] not in made[:1]
    assert struck[2] not in made[:2]


def test_an_object_that_still_stands_is_struck_again_where_that_helps_as_much(evidence):
    nothing = replace(evidence, motions=())
    best = choice(nothing).strike
    other = next(each for each in evidence.plan.strikes if each.axis_id != best.axis_id)
    assert choice(nothing, last=other, stands=True).strike.axis_id == other.axis_id


def test_strikes_that_failed_often_or_cannot_be_made_are_not_chosen(evidence):
    nothing = replace(evidence, motions=())
    best = choice(nothing).strike
    assert choice(nothing, failures={best.id: 20}).strike.id != best.id
    assert choice(nothing, excluded=frozenset({best.id})).strike.id != best.id
    everything = frozenset(each.id for each in evidence.plan.strikes)
    assert choice(nothing, excluded=everything).strike is None
    assert "no edge" in choice(nothing, excluded=everything).obstacle
    assert choice(nothing, left=0).strike is None


def test_a_target_below_what_shared_errors_allow_is_out_of_reach_with_a_remedy(evidence):
    chosen = choice(evidence, Target(com=1e-6))
    assert chosen.needed is None
    assert "any number of strikes" in chosen.obstacle
    assert "mostly by the" in chosen.obstacle
    assert choice(part(evidence, 4), Target(com=1e-6)).obstacle == ""


def test_moments_can_be_a_target(evidence):
    chosen = choice(part(evidence, 3), Target(inertia=0.05))
    assert "moments" in chosen.reason
    assert "any number" in choice(evidence, Target(inertia=1e-5)).obstacle


def test_strikes_that_do_not_check_each_other_cannot_stop_a_session(evidence, monkeypatch):
    monkeypatch.setattr("analyze.pipeline.next_strike.MIN_CHECKED", 1 + len(evidence.motions))
    checks = {each.name: each for each in stopping_checks(solve_strikes(evidence, EstimateOptions()))}
    assert not checks["predictions"].passed
    assert "are needed" in checks["predictions"].text
    assert "robustness" not in checks


def test_edges_that_leave_a_direction_open_are_named_as_the_obstacle(evidence):
    first = evidence.plan.strikes[0].axis_id
    left = [m for m in evidence.motions if evidence.planned(m).axis_id == first]
    six = [replace(left[0], strike_id=f"s1.{i}") for i in range(1, 7)]
    others = frozenset(each.id for each in evidence.plan.strikes if each.axis_id != first)
    chosen = choice(replace(evidence, motions=tuple(six)), excluded=others)
    assert "leave the centre of mass open along" in chosen.obstacle


def test_consistent_strikes_pass_every_check(evidence):
    whole = solve_strikes(evidence, EstimateOptions())
    checks = {each.name: each for each in stopping_checks(whole)}
    assert all(each.passed for each in checks.values())
    assert "robustness" in checks


def test_an_unobserved_direction_meets_no_target(evidence):
    alike = [m for m in evidence.motions if evidence.planned(m).axis_id == evidence.plan.strikes[0].axis_id]
    three = [replace(alike[0], strike_id=f"s1.{i}") for i in range(1, 4)]
    solved = solve_strikes(replace(evidence, motions=tuple(three)), EstimateOptions())
    assert not reached(solved).meets(TARGET)
    assert Reached(4e-4, 1.0).meets(TARGET)
    assert not Reached(6e-4, 0.0).meets(TARGET)
