"""State machine of a session, driven by events alone."""

from __future__ import annotations

import pytest

from acquire.session import actions, events
from acquire.session import machine as s
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range, StrikePlan
from schemas.strike_result import Verdict
from schemas.watch_lines import StrikeVerdict
from tests.acquire.session.driven import drive, made, records

EYE = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
POSE = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


def planned(strike_id: str, axis_id: str = "a") -> PlannedStrike:
    return PlannedStrike(
        id=strike_id,
        plane_id="p",
        axis_id=axis_id,
        R_world_object=EYE,
        p_world_object=[0.0, 0.0, 0.0],
        pivot=Pivot(point=[0.0, 0.0, 0.0], direction=[0.0, 1.0, 0.0], radius_m=0.001, sd_m=1e-4),
        impact=Impact(point=[0.0, 0.0, 0.1], direction=[1.0, 0.0, 0.0]),
        impact_height_m=0.1,
        impulse_n_s=Range(min=0.001, target=0.01, max=0.1),
        tip_speed_m_s=Range(min=0.1, target=0.4, max=0.9),
        energy_ratio=1.15,
        phi_predicted_rad=0.4,
        phi_predicted_sd_rad=0.05,
        i_edge_predicted_kg_m2=3e-4,
        visible_markers=[0],
        camera_pose=POSE,
        friction_needed=0.2,
    )


def plan(*strikes: PlannedStrike) -> StrikePlan:
    return StrikePlan(object_name="box", object_sha256="0", strikes=list(strikes))


def verdict(code: Verdict, energy: float | None) -> StrikeVerdict:
    return StrikeVerdict(strike_id="x", code=code, reason="because", phi=0.4, energy_ratio=energy)


def test_good_strikes_are_made_once_each():
    machine = s.SessionMachine(plan(planned("s1"), planned("s2"), planned("s3")))
    done = drive(machine, lambda *_: verdict(Verdict.GOOD, 1.15))
    assert machine.progress == (3, 3)
    assert made(done) == ["s1.1", "s2.1", "s3.1"]


def test_rocked_back_strike_is_recorded_and_repeated_harder():
    def judge(machine, speed):
        energy = 1.15 * (speed / 0.5) ** 2  # this object needs 0.5 m/s where the plan says 0.4
        return verdict(Verdict.GOOD if energy > 1 else Verdict.ROCKED_BACK, energy)

    done = drive(s.SessionMachine(plan(planned("s1"), planned("s2"))), judge)
    speeds = [each.tip_speed_command_m_s for each in records(done)]
    assert made(done) == ["s1.1", "s1.2", "s2.1"]
    assert speeds[0] < 0.4
    assert speeds[1:] == pytest.approx([0.5, 0.5], rel=0.05)


def test_strike_is_given_up_after_four_attempts():
    done = drive(s.SessionMachine(plan(planned("s1"))), lambda *_: verdict(Verdict.SLID, None))
    assert len(made(done)) == 4
    assert done[-1] == actions.CloseRecording()


def test_session_continues_without_a_verdict():
    done = drive(s.SessionMachine(plan(planned("s1"), planned("s2"))), lambda *_: None)
    assert made(done) == ["s1.1", "s2.1"]


def test_wrong_placement_is_requested_again_with_the_hint():
    machine = s.SessionMachine(plan(planned("s1")))
    machine.handle(events.Started())
    machine.handle(events.Placed())
    ordered = machine.handle(events.PoseChecked(good=False, text="turned by 180 deg"))
    assert isinstance(ordered[-1], actions.AskToPlace)
    assert ordered[-1].hint == "turned by 180 deg"


def test_stop_ends_the_session_from_any_state():
    machine = s.SessionMachine(plan(planned("s1")))
    machine.handle(events.Started())
    ordered = machine.handle(events.StopRequested("enough"))
    assert ordered[-1] == actions.CloseRecording(aborted=True, text="enough")


def test_striker_fault_is_cleared_and_the_strike_repeated():
    machine = s.SessionMachine(plan(planned("s1")))
    for event in (events.Started(), events.Placed(), events.PoseChecked(good=True)):
        machine.handle(event)
    ordered = machine.handle(events.StrikerFailed("overload"))
    assert actions.ClearFault() in ordered
    assert isinstance(ordered[-1], actions.AskToPlace)


def test_repeated_striker_faults_end_the_session():
    machine = s.SessionMachine(plan(planned("s1")))
    ordered = machine.handle(events.Started())
    for _ in range(4):
        machine.handle(events.Placed())
        machine.handle(events.PoseChecked(good=True))
        ordered = machine.handle(events.StrikerFailed("overload"))
    assert ordered[-1] == actions.CloseRecording(aborted=True, text="overload")


def test_event_in_the_wrong_state_is_refused():
    machine = s.SessionMachine(plan(planned("s1")))
    with pytest.raises(ValueError, match="does not belong"):
        machine.handle(events.Ready())


def test_missed_strike_does_not_change_the_estimate():
    machine = s.SessionMachine(plan(planned("s1")))
    before = machine.learner.tip_speed(machine.strike)
    for event in (
        events.Started(),
        events.Placed(),
        events.PoseChecked(good=True),
        events.Ready(),
        events.Struck(None, 0.0, 0.0, 0),
        events.Recorded(1, 2, 3, 0),
    ):
        machine.handle(event)
    machine.handle(events.Judged(verdict(Verdict.NOT_MOVED, None)))
    assert machine.learner.tip_speed(machine.strike) == before


def run_until_state(machine: s.SessionMachine, state) -> None:
    """Run a session without faults until it reaches `state`."""
    steps: list[events.Event] = [
        events.Started(),
        events.Placed(),
        events.PoseChecked(good=True),
        events.Ready(),
        events.Struck(1, 1.0, 0.4, 1),
        events.Recorded(1, 2, 3, 0),
    ]
    for event in steps:
        if machine.state == state:
            return
        machine.handle(event)
    assert machine.state == state


@pytest.mark.parametrize("state", [s.State.ARMING, s.State.STRIKING, s.State.RECORDING, s.State.JUDGING])
def test_strike_is_repeated_if_its_file_was_cut_short(state):
    machine = s.SessionMachine(plan(planned("s1"), planned("s2")))
    run_until_state(machine, state)
    ordered = machine.handle(events.FileCutShort("the window was cut off"))
    assert isinstance(ordered[-1], actions.AskToPlace)
    assert machine.strike_id == "s1.1"
    assert "the window was cut off" in ordered[0].text


@pytest.mark.parametrize("strikes", [1, 2])
def test_judged_strike_is_repeated_if_its_record_was_not_written(strikes):
    """A strike without its record is repeated even as the last one, when the session is already finished."""
    machine = s.SessionMachine(plan(*(planned(f"s{i + 1}") for i in range(strikes))))
    run_until_state(machine, s.State.JUDGING)
    ordered = machine.handle(events.Judged(verdict(Verdict.GOOD, 1.2)))
    assert isinstance(ordered[0], actions.WriteRecord)
    assert machine.state == (s.State.FINISHED if strikes == 1 else s.State.PLACING)
    ordered = machine.handle(events.FileCutShort("the capture process ended"))
    assert isinstance(ordered[-1], actions.AskToPlace)
    assert machine.strike_id == "s1.1"


def test_repeatedly_cut_files_end_the_session():
    machine = s.SessionMachine(plan(planned("s1")))
    run_until_state(machine, s.State.STRIKING)
    for _ in range(s.MAX_FAULTS):
        assert isinstance(machine.handle(events.FileCutShort("x"))[-1], actions.AskToPlace)
        machine.handle(events.Placed())
        machine.handle(events.PoseChecked(good=True))
    ordered = machine.handle(events.FileCutShort("x"))
    assert isinstance(ordered[-1], actions.CloseRecording)
    assert ordered[-1].aborted


def test_strikes_that_are_given_up_are_named() -> None:
    machine = s.SessionMachine(plan(planned("s1"), planned("s2")))
    machine.handle(events.Started())
    for _ in range(s.MAX_PLACEMENTS):
        machine.handle(events.Placed())
        machine.handle(events.PoseChecked(good=False, text="camera lost"))
    assert machine.skipped == ("s1",)
    assert machine.strike.id == "s2"


@pytest.mark.parametrize(
    ("speed_m_s", "code", "learned"),
    [
        (0.39, Verdict.GOOD, [0.39]),
        (None, Verdict.GOOD, [None]),  # a requested speed does not count as one reached
        (None, Verdict.NOT_MOVED, [None]),  # too weak, which is learned from
        (0.0, Verdict.NOT_MOVED, []),  # met nothing
    ],
)
def test_only_a_measured_speed_is_learned(speed_m_s, code, learned, monkeypatch):
    machine = s.SessionMachine(plan(planned("s1")))
    speeds = []
    monkeypatch.setattr(
        machine.learner, "learn", lambda _strike, _command, speed, _verdict: speeds.append(speed)
    )
    for event in (
        events.Started(),
        events.Placed(),
        events.PoseChecked(good=True),
        events.Ready(),
        events.Struck(None, 0.0, speed_m_s, 0),
        events.Recorded(1, 2, 100, 0),
        events.Judged(verdict(code, None)),
    ):
        machine.handle(event)
    assert speeds == learned
