"""Sessions that stop themselves: target, order of the strikes, and the state machine with advice."""

from __future__ import annotations

from collections import Counter

import pytest

from acquire.errors import SessionError
from acquire.session import actions
from acquire.session import machine as s
from acquire.session.adaptive import MAX_DOUBTED, MAX_FAILURES, AdaptiveOrder, Target
from acquire.session.earlier import EarlierStrikes
from schemas.proto import percuss_pb2 as pb
from schemas.strike_result import Verdict
from schemas.watch_lines import NextStrike, SessionCheck, SessionEstimate, SessionTarget
from tests.acquire.session.driven import drive, made, records
from tests.acquire.session.test_machine import plan, planned, verdict

THREE = plan(planned("s1"), planned("s2"), planned("s3"))


def estimate(strike_id: str = "", *, met: bool = False, reason: str = "", number: int = 1) -> SessionEstimate:
    return SessionEstimate(
        number=number,
        target=SessionTarget(met=met, reason=reason),
        next=NextStrike(strike_id=strike_id, reason="it tells most") if strike_id else None,
    )


@pytest.mark.parametrize(
    ("text", "com", "inertia"),
    [
        ("com=0.5mm", 5e-4, None),
        ("inertia=2%", None, 0.02),
        ("com=1mm,inertia=5%", 1e-3, 0.05),
        (" com = .3 mm , inertia = 10 % ", 3e-4, 0.1),
    ],
)
def test_targets_are_read(text, com, inertia):
    target = Target.parse(text)
    assert (target.com_m, target.inertia) == pytest.approx((com, inertia))
    assert Target.parse(str(target)) == target


@pytest.mark.parametrize(
    "text", ["", "com", "com=0.5", "com=0.5%", "inertia=2mm", "com=0mm", "com=1mm,com=2mm"]
)
def test_other_texts_are_refused_with_the_way_to_write_them(text):
    with pytest.raises(SessionError, match=r"com=0\.5mm"):
        Target.parse(text)


def good(_machine, _speed):
    return verdict(Verdict.GOOD, 1.15)


def test_session_makes_the_strikes_that_tell_most_and_stops_when_the_target_is_met():
    answers = iter([estimate("s3"), estimate("s1"), estimate("s3"), estimate(met=True)])
    requests = []

    def advise(request):
        requests.append(request)
        return next(answers)

    machine = s.SessionMachine(THREE, Target(5e-4))
    done = drive(machine, good, advise=advise)
    assert made(done) == ["s3.1", "s1.1", "s3.2"]
    assert [each.strike_id for each in requests] == ["", "s3.1", "s1.1", "s3.2"]
    assert [each.left for each in requests] == [20, 19, 18, 17]
    assert [each.number for each in requests] == [1, 2, 3, 4]
    assert done[-1] == actions.CloseRecording(text="com=0.5mm is reached after 3 strikes")
    assert {each.choice_text for each in records(done)} == {"it tells most"}
    assert machine.progress == (3, 20)


def test_session_ends_where_no_number_of_strikes_reaches_the_target():
    done = drive(
        s.SessionMachine(THREE, Target(5e-4)),
        good,
        advise=lambda _: estimate(reason="the edges are not known"),
    )
    assert done[-1] == actions.CloseRecording(text="the edges are not known", missed=True)


def test_session_ends_after_the_largest_number_of_strikes():
    done = drive(s.SessionMachine(THREE, Target(5e-4, max_strikes=4)), good, advise=lambda _: estimate("s2"))
    assert made(done) == ["s2.1", "s2.2", "s2.3", "s2.4"]
    assert done[-1].missed


def test_session_ends_where_a_check_keeps_failing():
    doubted = estimate("s2").model_copy(
        update={
            "com_half_width_m": 4e-4,
            "checks": [SessionCheck(name="predictions", passed=False, text="s1.1 not as the others predict")],
        }
    )
    done = drive(s.SessionMachine(THREE, Target(5e-4)), good, advise=lambda _: doubted)
    assert len(made(done)) == MAX_DOUBTED
    assert "s1.1 not as the others predict" in done[-1].text
    unsure = doubted.model_copy(update={"com_half_width_m": 9e-4})
    done = drive(s.SessionMachine(THREE, Target(5e-4)), good, advise=lambda _: unsure)
    assert len(made(done)) == 20


def test_session_goes_on_by_its_plan_without_advice():
    done = drive(s.SessionMachine(THREE, Target(5e-4)), good, advise=lambda _: None)
    assert made(done) == ["s1.1", "s2.1", "s3.1"]
    assert done[-1].missed


def test_strikes_that_fail_are_reported_and_given_up():
    requests = []

    def advise(request):
        requests.append(request)
        return estimate("s2" if "s1" in request.excluded else "s1")

    done = drive(
        s.SessionMachine(THREE, Target(5e-4, max_strikes=6)),
        lambda at, _: verdict(Verdict.SLID if at.strike.id == "s1" else Verdict.ROCKED_BACK, 0.8),
        advise=advise,
    )
    assert made(done) == [*(f"s1.{i + 1}" for i in range(MAX_FAILURES)), "s2.1", "s2.2"]
    assert requests[2].failures == {"s1": 2}
    assert not requests[2].stands
    assert requests[-1].stands


def test_a_placement_refused_too_often_is_not_chosen_again():
    order = AdaptiveOrder(THREE, Target(5e-4))
    order.exclude(THREE.strikes[1])
    assert order.request().excluded == ["s2"]


def test_an_answer_with_a_strike_that_the_plan_lacks_ends_the_session():
    order = AdaptiveOrder(THREE, Target(5e-4))
    assert order.next_strike(estimate("s9")) is None
    assert order.missed


def record(plan_id: str, attempt: int, code: Verdict) -> pb.StrikeRecord:
    return pb.StrikeRecord(
        strike_id=f"{plan_id}.{attempt}",
        plan_strike_id=plan_id,
        attempt=attempt,
        verdict_code=code.value,
        tip_speed_command_m_s=0.4,
        tip_speed_m_s=0.4,
        energy_ratio=1.2,
    )


def earlier(*strikes: pb.StrikeRecord) -> EarlierStrikes:
    attempts = Counter({each.plan_strike_id: each.attempt for each in strikes})
    return EarlierStrikes(("/r.mcap",), strikes, attempts)


def test_a_resumed_session_leaves_out_what_was_made_and_counts_attempts_on():
    before = earlier(
        record("s1", 1, Verdict.GOOD), record("s2", 1, Verdict.SLID), record("s2", 2, Verdict.SLID)
    )
    done = drive(s.SessionMachine(THREE, None, before), good, advise=lambda _: None)
    assert made(done) == ["s2.3", "s3.1"]


def test_a_session_whose_strikes_were_all_made_is_refused():
    before = earlier(*(record(each.id, 1, Verdict.GOOD) for each in THREE.strikes))
    with pytest.raises(SessionError, match="every planned strike was made"):
        s.SessionMachine(THREE, None, before)
    requests = []

    def advise(request):
        requests.append(request)
        return estimate(met=True)

    assert made(drive(s.SessionMachine(THREE, Target(5e-4), before), good, advise=advise)) == []
    assert requests[0].earlier == ["/r.mcap"]


def test_a_resumed_session_learns_from_the_strikes_made():
    before = earlier(record("s1", 1, Verdict.ROCKED_BACK))
    fresh, resumed = s.SessionMachine(THREE), s.SessionMachine(THREE, None, before)
    assert resumed.learner.tip_speed(THREE.strikes[0]) != fresh.learner.tip_speed(THREE.strikes[0])
