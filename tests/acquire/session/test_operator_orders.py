"""Orders of the operator in place of a placed object, and the pause before the arming."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from acquire.errors import StrikerStopped
from acquire.session import actions, events
from acquire.session import machine as s
from acquire.session import runner as session_runner
from acquire.session.options import SessionOptions
from acquire.session.runner import SessionRunner
from schemas.strike_result import Verdict
from tests.acquire.session.driven import drive, records
from tests.acquire.session.test_machine import plan, planned, verdict
from tests.acquire.session.test_runner import Host


def session(orders: dict[str, events.Order], strikes: int = 3) -> tuple[list[Any], s.SessionMachine]:
    """Run a session whose operator gives an order when first asked to place for an attempt.

    Args:
        orders: order by the id of the attempt that is prompted.
        strikes: number of planned strikes.

    Returns:
        Records written: (id, commanded speed); and the machine.
    """
    machine = s.SessionMachine(plan(*(planned(f"s{i + 1}", f"a{i}") for i in range(strikes))))
    given = dict(orders)

    def place(at: s.SessionMachine) -> events.Event:
        order = given.pop(at.strike_id, None)
        return events.Placed() if order is None else events.Ordered(order)

    done = drive(machine, lambda *_: verdict(Verdict.GOOD, 1.15), place=place)
    return [(each.strike_id, each.tip_speed_command_m_s) for each in records(done)], machine


def test_a_strike_is_left_out() -> None:
    records, machine = session({"s2.1": events.Order.SKIP})
    assert [each[0] for each in records] == ["s1.1", "s3.1"]
    assert machine.skipped == ("s2",)


def test_the_strike_judged_last_is_repeated() -> None:
    records, _ = session({"s2.1": events.Order.AGAIN})
    assert [each[0] for each in records] == ["s1.1", "s1.2", "s2.1", "s3.1"]


def test_there_is_nothing_to_repeat_before_the_first_strike() -> None:
    records, _ = session({"s1.1": events.Order.AGAIN})
    assert [each[0] for each in records] == ["s1.1", "s2.1", "s3.1"]


def test_the_next_attempt_is_harder_once_and_within_the_plan() -> None:
    (_, plain), *_ = session({}, 1)[0]
    (_, harder), *_ = session({"s1.1": events.Order.HARDER}, 1)[0]
    assert harder == pytest.approx(min(plain * s.HARDER_RATIO, 0.9))
    machine = s.SessionMachine(plan(planned("s1")))
    machine.handle(events.Started())
    for _ in range(30):
        machine.handle(events.Ordered(events.Order.HARDER))
    machine.handle(events.Placed())
    machine.handle(events.PoseChecked(good=True))
    assert machine.handle(events.Ready())[-1].tip_speed_m_s == 0.9


def test_a_pause_while_arming_checks_the_pose_again() -> None:
    machine = s.SessionMachine(plan(planned("s1")))
    for event in (events.Started(), events.Placed(), events.PoseChecked(good=True)):
        ordered = machine.handle(event)
    assert isinstance(ordered[-1], actions.Arm)
    assert isinstance(machine.handle(events.PoseChecked(good=True))[-1], actions.Arm)
    assert isinstance(machine.handle(events.PoseChecked(good=False, text="moved"))[-1], actions.AskToPlace)


class Held:
    """Fake daemon that holds the session, and whose wait ends as a test states."""

    def __init__(self, ends: Exception | None) -> None:
        self.ends, self.calls = ends, []

    def call(self, name: str, **params: Any) -> dict[str, Any]:
        self.calls.append((name, params))
        if name == "hold.wait" and self.ends is not None:
            raise self.ends
        return {"held": True, "text": "the operator's browser was lost"} if name == "hold.status" else {}


@pytest.mark.parametrize("ends", [None, StrikerStopped()])
def test_a_session_waits_while_it_is_held(ends: Exception | None, monkeypatch: pytest.MonkeyPatch) -> None:
    runner, daemon, paused = SessionRunner.__new__(SessionRunner), Held(ends), []
    runner._client, runner._options = daemon, SessionOptions()  # type: ignore[assignment]
    runner._machine = SimpleNamespace(  # type: ignore[assignment]
        state=s.State.ARMING, plan=plan(planned("s1")), strike=planned("s1"), attempt=2
    )
    runner._status = SimpleNamespace(pause=paused.append)  # type: ignore[assignment]
    monkeypatch.setattr(runner, "_report", paused.append)
    monkeypatch.setattr(runner, "_check_pose", lambda strike: events.PoseChecked(good=True))
    event = runner._arm_when_released()
    state = dict(daemon.calls)["recording.state"]
    assert state["text"] == "paused: the operator's browser was lost"
    assert (state["strike_id"], state["attempt"]) == ("s1", 2)
    assert len(paused) == 2
    assert isinstance(event, events.PoseChecked if ends is None else events.StopRequested)


@pytest.mark.parametrize(("moving", "good"), [(None, True), (0.0, True), (0.3, False)])
def test_the_striker_is_not_armed_while_hands_move(
    monkeypatch: pytest.MonkeyPatch, moving: float | None, good: bool
) -> None:
    host = Host()
    monkeypatch.setattr(session_runner, "time", host)

    def call(name: str, **_: Any) -> dict[str, Any]:
        host.sleep(0.001)
        now_ns = host.monotonic_ns()
        seen = {"id": 7, "corners_px": [[0.0, 0.0]] * 4}
        event = {"time_ns": now_ns, "markers": [seen], "at_rest": True, "saturated_fraction": 0.0}
        event |= {"placement_error_rad": 0.01, "moving_fraction": moving}
        return {"now_ns": now_ns, "alive": True, "event": event, "trouble": ""}

    runner = SessionRunner.__new__(SessionRunner)
    runner._client = SimpleNamespace(call=call)  # type: ignore[assignment]
    tagged = SimpleNamespace(untagged=False, is_placed=lambda error, _: error is not None)
    runner._input = tagged  # type: ignore[assignment]
    checked = runner._check_pose(planned("s1"))
    assert isinstance(checked, events.PoseChecked)
    assert checked.good is good
    assert ("take your hands away" in checked.text) is not good
