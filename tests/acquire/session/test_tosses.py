"""Tosses of a session: their order after the strikes, orders of the operator, lost images, stops."""

from __future__ import annotations

from collections import Counter

import pytest

from acquire.errors import SessionError
from acquire.session import actions, events
from acquire.session.earlier import EarlierStrikes
from acquire.session.events import Order
from acquire.session.machine import MAX_ATTEMPTS, MAX_FAULTS, State
from acquire.session.options import SessionOptions
from acquire.session.toss_steps import FlightWatch
from acquire.session.tosses import StrikesAndTosses, TossMachine, session_machine
from schemas.planned_toss import PlannedToss
from schemas.proto import percuss_pb2 as pb
from schemas.strike_plan import StrikePlan
from schemas.strike_result import Verdict
from schemas.toss_result import TossVerdict
from schemas.watch_lines import SeenMarker, TossJudgement, WatchEvent
from tests.acquire.session.test_machine import plan, planned, verdict
from tests.schemas.test_planned_toss import TOSS

RECORDED = events.Tossed(events.Recorded(1, 2, 100, 0))
GOOD = TossVerdict.GOOD


def toss(toss_id: str) -> PlannedToss:
    return PlannedToss.model_validate(TOSS | {"id": toss_id})


def tossing(*ids: str) -> TossMachine:
    machine = TossMachine([toss(each) for each in ids])
    machine.begin()
    return machine


def judged(code: TossVerdict = GOOD, reason: str = "0.45 s in the air") -> events.TossJudged:
    return events.TossJudged(TossJudgement(toss_id="t1.1", code=code, reason=reason))


def made(machine, verdict: events.TossJudged | None = None) -> list[actions.Action]:
    """Actions after a toss that was recorded and judged, good by default."""
    machine.handle(events.Placed())
    machine.handle(RECORDED)
    return machine.handle(verdict or judged())


def with_tosses(*ids: str) -> StrikePlan:
    return plan(planned("s1")).model_copy(update={"tosses": [toss(each) for each in ids]})


def struck(machine: StrikesAndTosses) -> list[actions.Action]:
    """Actions after the one good strike of a plan."""
    machine.handle(events.Started())
    for event in (
        events.Placed(),
        events.PoseChecked(good=True),
        events.Ready(),
        events.Struck(1, 1.0, 0.2, 1),
        events.Recorded(1, 2, 100, 0),
    ):
        machine.handle(event)
    return machine.handle(events.Judged(verdict(Verdict.GOOD, 1.2)))


def test_tosses_follow_the_strikes_with_the_arm_out_of_the_way():
    machine = StrikesAndTosses(with_tosses("t1", "t2"))
    record, park, announced, asked = struck(machine)
    assert isinstance(record, actions.WriteRecord)
    assert isinstance(park, actions.ParkStriker)
    assert announced == actions.Announce(State.PLACING, "", 1, "", "t1")
    assert asked == actions.AskToToss(toss("t1"))
    assert machine.progress == (1, 3)
    announced, recorded = machine.handle(events.Placed())
    assert announced.state is State.TOSSING
    assert recorded == actions.RecordToss(toss("t1"))
    announced, judge = machine.handle(RECORDED)
    assert announced.state is State.JUDGING
    assert judge == actions.JudgeToss(toss("t1"), 1, RECORDED.recorded)
    written, _, asked = machine.handle(judged())
    assert written == actions.WriteToss(toss("t1"), 1, RECORDED.recorded, judged().verdict)
    assert asked == actions.AskToToss(toss("t2"))
    assert machine.progress == (2, 3)
    *_, announced, closed = made(machine)
    assert announced == actions.Announce(State.FINISHED, "", 0)
    assert closed == actions.CloseRecording()
    assert machine.progress == (3, 3)


def test_tosses_alone_make_no_strike():
    machine = StrikesAndTosses(with_tosses("t1"), only_tosses=True)
    *_, asked = machine.handle(events.Started())
    assert asked == actions.AskToToss(toss("t1"))
    assert machine.progress == (0, 1)
    assert isinstance(made(machine)[-1], actions.CloseRecording)


def test_a_plan_of_tosses_alone_begins_with_them():
    alone = with_tosses("t1").model_copy(update={"strikes": []})
    machine = session_machine(alone, SessionOptions())
    assert machine.handle(events.Started())[-1] == actions.AskToToss(toss("t1"))
    assert isinstance(made(machine)[-1], actions.CloseRecording)


def test_with_every_strike_made_before_only_tosses_are_left():
    good = pb.StrikeRecord(plan_strike_id="s1", verdict_code="good")
    machine = StrikesAndTosses(with_tosses("t1"), earlier=EarlierStrikes(strikes=(good,)))
    assert machine.handle(events.Started())[-1] == actions.AskToToss(toss("t1"))


def test_a_plan_without_tosses_is_a_session_of_strikes():
    assert type(session_machine(plan(planned("s1")), SessionOptions())).__name__ == "SessionMachine"
    with pytest.raises(
        SessionError, match="the plan has no tosses: plan them with `analyze plan --tosses 3`"
    ):
        session_machine(plan(planned("s1")), SessionOptions(only_tosses=True))


def test_skip_again_and_harder():
    machine = tossing("t1", "t2", "t3")
    made(machine)
    assert machine.handle(events.Ordered(Order.AGAIN))[-1] == actions.AskToToss(
        toss("t1"), "again, as ordered"
    )
    written, *_, asked = made(machine)
    assert written.attempt == 2
    assert asked == actions.AskToToss(toss("t2"))
    assert machine.handle(events.Ordered(Order.SKIP))[-1] == actions.AskToToss(toss("t3"))
    assert machine.skipped == ["t2"]
    hint = machine.handle(events.Ordered(Order.HARDER))[-1].hint
    assert hint == "a toss is by hand: throw it as high as its card states"


def test_again_before_the_first_toss_asks_for_it():
    assert tossing("t1").handle(events.Ordered(Order.AGAIN))[-1].toss.id == "t1"


def test_a_toss_whose_images_were_lost_is_repeated_at_most_three_times():
    machine = tossing("t1", "t2")
    for _ in range(MAX_FAULTS):
        machine.handle(events.Placed())
        assert machine.handle(events.FileCutShort("cut off"))[-1].hint == "again: its images were lost"
    machine.handle(events.Placed())
    closed = machine.handle(events.FileCutShort("cut off"))[-1]
    assert closed == actions.CloseRecording(aborted=True, text="cut off")


def test_a_toss_whose_record_was_lost_is_repeated():
    machine = tossing("t1", "t2")
    made(machine)
    assert machine.handle(events.FileCutShort("cut off"))[-1].toss.id == "t1"


def test_a_bad_toss_is_repeated_also_the_last_one():
    machine, slow = tossing("t1"), judged(TossVerdict.SLOW, "0.9 turns a second, 1.5 are needed")
    for number in range(1, MAX_ATTEMPTS):
        written, announced, asked = made(machine, slow)
        assert (written.attempt, written.verdict) == (number, slow.verdict)
        assert announced.state is State.PLACING
        assert asked == actions.AskToToss(toss("t1"), "again: 0.9 turns a second, 1.5 are needed")
    assert isinstance(made(machine, slow)[-1], actions.CloseRecording)
    assert machine.skipped == []


def test_a_toss_without_a_verdict_is_not_repeated():
    assert made(tossing("t1", "t2"), events.TossJudged(None))[-1] == actions.AskToToss(toss("t2"))


def test_good_tosses_of_earlier_recordings_are_not_asked_for():
    def earlier(**codes: str) -> EarlierStrikes:
        tosses = tuple(
            pb.TossRecord(plan_toss_id=name, verdict_code=code, attempt=1) for name, code in codes.items()
        )
        strike = pb.StrikeRecord(plan_strike_id="s1", verdict_code="good")
        return EarlierStrikes(("a.mcap",), (strike,), Counter(dict.fromkeys(codes, 1)), tosses)

    machine = StrikesAndTosses(with_tosses("t1", "t2"), earlier=earlier(t1="good", t2="slow"))
    assert machine.handle(events.Started())[-1] == actions.AskToToss(toss("t2"))
    assert machine.progress == (1, 2)
    assert made(machine)[0].attempt == 2
    assert machine.progress == (2, 2)
    with pytest.raises(SessionError, match=r"a\.mcap: every planned toss was made, and no strike is left"):
        StrikesAndTosses(with_tosses("t1"), earlier=earlier(t1="good"))


def test_strikes_end_the_session_if_every_toss_was_made_before():
    tossed = pb.TossRecord(plan_toss_id="t1", verdict_code="good")
    machine = StrikesAndTosses(with_tosses("t1"), earlier=EarlierStrikes(tosses=(tossed,)))
    assert isinstance(struck(machine)[-1], actions.CloseRecording)
    assert machine.progress == (2, 2)


def test_a_last_strike_whose_record_was_lost_is_repeated_before_the_tosses():
    machine = StrikesAndTosses(with_tosses("t1"))
    struck(machine)
    asked = machine.handle(events.FileCutShort("cut off"))[-1]
    assert isinstance(asked, actions.AskToPlace)
    assert asked.strike.id == "s1"


@pytest.mark.parametrize("throwing", [False, True])
def test_a_stop_ends_the_session(throwing):
    machine = tossing("t1")
    if throwing:
        machine.handle(events.Placed())
    announced, closed = machine.handle(events.StopRequested("enough"))
    assert announced.state is State.ABORTED
    assert closed == actions.CloseRecording(aborted=True, text="enough")


def test_an_event_of_a_strike_is_refused():
    with pytest.raises(ValueError, match="Ready does not belong to state PLACING of a toss"):
        tossing("t1").handle(events.Ready())


def seen(looks: list[tuple[float | None, bool]]) -> list[bool]:
    """Answers of a FlightWatch to looks 90 ms apart: place of a marker [px], and whether it is at rest.

    None stands for no marker in view.
    """
    watch = FlightWatch(untagged=all(x is None for x, _ in looks))
    return [
        watch.is_over(
            WatchEvent(
                time_ns=90_000_000 * number,
                markers=[]
                if x is None
                else [SeenMarker(id=0, corners_px=[[x, 0.0], [x + 1, 0], [x + 1, 1], [x, 1]])],
                at_rest=rest,
                saturated_fraction=0.0,
            )
        )
        for number, (x, rest) in enumerate(looks)
    ]


def test_a_toss_is_over_half_a_second_after_the_flight():
    held, flight, lying = [(0.0, True)] * 20, [(40.0 * n, False) for n in range(1, 6)], [(200.0, True)] * 8
    answers = seen(held + flight + lying)
    assert answers.index(True) == 25 + 6


def test_a_hand_that_trembles_has_not_tossed():
    assert not any(seen([(3.0 * (n % 2), n % 5 == 0) for n in range(60)] + [(0.0, True)] * 20))


def test_an_untagged_object_has_flown_if_it_moved_after_it_was_held_still():
    placed, held, flight = [(None, False)] * 8, [(None, True)] * 12, [(None, False)] * 7
    answers = seen(placed + held + flight + [(None, True)] * 8)
    assert answers.index(True) == 27 + 6
    regripped = [(None, False)] * 4
    assert not any(seen(placed + held + regripped + held))


def test_an_untagged_object_cannot_be_tossed_without_strikes():
    with pytest.raises(SessionError, match="make strikes and tosses in one session, or glue tags on"):
        session_machine(with_tosses("t1"), SessionOptions(only_tosses=True), untagged=True)
    assert session_machine(with_tosses("t1"), SessionOptions(), untagged=True).progress == (0, 2)
