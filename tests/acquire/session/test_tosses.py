"""Tosses of a session: their order after the strikes, orders of the operator, lost images, stops."""

from __future__ import annotations

import pytest

from acquire.errors import SessionError
from acquire.session import actions, events
from acquire.session.earlier import EarlierStrikes
from acquire.session.events import Order
from acquire.session.machine import MAX_FAULTS, State
from acquire.session.options import SessionOptions
from acquire.session.toss_steps import FlightWatch
from acquire.session.tosses import StrikesAndTosses, TossMachine, session_machine
from schemas.planned_toss import PlannedToss
from schemas.proto import percuss_pb2 as pb
from schemas.strike_plan import StrikePlan
from schemas.strike_result import Verdict
from schemas.watch_lines import SeenMarker, WatchEvent
from tests.acquire.session.test_machine import plan, planned, verdict
from tests.schemas.test_planned_toss import TOSS

RECORDED = events.Tossed(events.Recorded(1, 2, 100, 0))


def toss(toss_id: str) -> PlannedToss:
    return PlannedToss.model_validate(TOSS | {"id": toss_id})


def tossing(*ids: str) -> TossMachine:
    machine = TossMachine([toss(each) for each in ids])
    machine.begin()
    return machine


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
    written, _, asked = machine.handle(RECORDED)
    assert written == actions.WriteToss(toss("t1"), 1, RECORDED.recorded)
    assert asked == actions.AskToToss(toss("t2"))
    assert machine.progress == (2, 3)
    machine.handle(events.Placed())
    *_, announced, closed = machine.handle(RECORDED)
    assert announced == actions.Announce(State.FINISHED, "", 0)
    assert closed == actions.CloseRecording()
    assert machine.progress == (3, 3)


def test_tosses_alone_make_no_strike():
    machine = StrikesAndTosses(with_tosses("t1"), only_tosses=True)
    *_, asked = machine.handle(events.Started())
    assert asked == actions.AskToToss(toss("t1"))
    assert machine.progress == (0, 1)
    machine.handle(events.Placed())
    assert isinstance(machine.handle(RECORDED)[-1], actions.CloseRecording)


def test_a_plan_of_tosses_alone_begins_with_them():
    alone = with_tosses("t1").model_copy(update={"strikes": []})
    machine = session_machine(alone, SessionOptions())
    assert machine.handle(events.Started())[-1] == actions.AskToToss(toss("t1"))
    machine.handle(events.Placed())
    assert isinstance(machine.handle(RECORDED)[-1], actions.CloseRecording)


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
    machine.handle(events.Placed())
    machine.handle(RECORDED)
    assert machine.handle(events.Ordered(Order.AGAIN))[-1] == actions.AskToToss(
        toss("t1"), "again, as ordered"
    )
    machine.handle(events.Placed())
    (written, *_, asked) = machine.handle(RECORDED)
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
    machine.handle(events.Placed())
    machine.handle(RECORDED)
    assert machine.handle(events.FileCutShort("cut off"))[-1].toss.id == "t1"


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


def seen(looks: list[tuple[float, bool]]) -> list[bool]:
    """Answers of a FlightWatch to looks 90 ms apart: place of a marker [px], and whether it is at rest."""
    watch = FlightWatch()
    return [
        watch.is_over(
            WatchEvent(
                time_ns=90_000_000 * number,
                markers=[SeenMarker(id=0, corners_px=[[x, 0.0], [x + 1, 0], [x + 1, 1], [x, 1]])],
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
