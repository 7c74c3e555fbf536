"""State machine of a session, driven by events alone."""

from __future__ import annotations

import pytest

from acquire.session import machine as s
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range, StrikePlan
from schemas.strike_result import Verdict
from schemas.watch_lines import StrikeVerdict

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


def drive(machine: s.SessionMachine, judge) -> list[s.Action]:
    """Run a session without faults and return its actions; `judge(machine, speed)` gives the verdicts."""
    done: list[s.Action] = []
    event: s.Event = s.Started()
    speed = 0.0
    for _ in range(500):
        actions = machine.handle(event)
        done += actions
        match actions[-1]:
            case s.AskToPlace():
                event = s.Placed()
            case s.CheckPose():
                event = s.PoseChecked(good=True)
            case s.Arm():
                event = s.Ready()
            case s.Strike(tip_speed_m_s=speed):
                event = s.Struck(1, 1e5, speed, 1)
            case s.RecordUntilRest():
                event = s.Recorded(1, 2, 100, 0)
            case s.Judge():
                event = s.Judged(judge(machine, speed))
            case s.CloseRecording():
                return done
    raise AssertionError("the session never ends")


def test_good_strikes_are_made_once_each():
    machine = s.SessionMachine(plan(planned("s1"), planned("s2"), planned("s3")))
    done = drive(machine, lambda *_: verdict(Verdict.GOOD, 1.15))
    assert machine.progress == (3, 3)
    assert [a.strike_id for a in done if isinstance(a, s.WriteRecord)] == ["s1.1", "s2.1", "s3.1"]


def test_rocked_back_strike_is_recorded_and_repeated_harder():
    def judge(machine, speed):
        energy = 1.15 * (speed / 0.5) ** 2  # this object needs 0.5 m/s where the plan says 0.4
        return verdict(Verdict.GOOD if energy > 1 else Verdict.ROCKED_BACK, energy)

    done = drive(s.SessionMachine(plan(planned("s1"), planned("s2"))), judge)
    speeds = [a.tip_speed_command_m_s for a in done if isinstance(a, s.WriteRecord)]
    assert [a.strike_id for a in done if isinstance(a, s.WriteRecord)] == ["s1.1", "s1.2", "s2.1"]
    assert speeds[0] < 0.4
    assert speeds[1:] == pytest.approx([0.5, 0.5], rel=0.05)


def test_strike_is_given_up_after_four_attempts():
    done = drive(s.SessionMachine(plan(planned("s1"))), lambda *_: verdict(Verdict.SLID, None))
    assert len([a for a in done if isinstance(a, s.WriteRecord)]) == 4
    assert done[-1] == s.CloseRecording()


def test_session_continues_without_a_verdict():
    done = drive(s.SessionMachine(plan(planned("s1"), planned("s2"))), lambda *_: None)
    assert [a.strike_id for a in done if isinstance(a, s.WriteRecord)] == ["s1.1", "s2.1"]


def test_wrong_placement_is_requested_again_with_the_hint():
    machine = s.SessionMachine(plan(planned("s1")))
    machine.handle(s.Started())
    machine.handle(s.Placed())
    actions = machine.handle(s.PoseChecked(good=False, text="turned by 180 deg"))
    assert isinstance(actions[-1], s.AskToPlace)
    assert actions[-1].hint == "turned by 180 deg"


def test_stop_ends_the_session_from_any_state():
    machine = s.SessionMachine(plan(planned("s1")))
    machine.handle(s.Started())
    actions = machine.handle(s.StopRequested("enough"))
    assert actions[-1] == s.CloseRecording(aborted=True, text="enough")


def test_striker_fault_is_cleared_and_the_strike_repeated():
    machine = s.SessionMachine(plan(planned("s1")))
    for event in (s.Started(), s.Placed(), s.PoseChecked(good=True)):
        machine.handle(event)
    actions = machine.handle(s.StrikerFailed("overload"))
    assert s.ClearFault() in actions
    assert isinstance(actions[-1], s.AskToPlace)


def test_repeated_striker_faults_end_the_session():
    machine = s.SessionMachine(plan(planned("s1")))
    actions = machine.handle(s.Started())
    for _ in range(4):
        machine.handle(s.Placed())
        machine.handle(s.PoseChecked(good=True))
        actions = machine.handle(s.StrikerFailed("overload"))
    assert actions[-1] == s.CloseRecording(aborted=True, text="overload")


def test_event_in_the_wrong_state_is_refused():
    machine = s.SessionMachine(plan(planned("s1")))
    with pytest.raises(ValueError, match="does not belong"):
        machine.handle(s.Ready())


def test_missed_strike_does_not_change_the_estimate():
    machine = s.SessionMachine(plan(planned("s1")))
    before = machine.learner.tip_speed(machine.strike)
    for event in (
        s.Started(),
        s.Placed(),
        s.PoseChecked(good=True),
        s.Ready(),
        s.Struck(None, 0.0, 0.0, 0),
        s.Recorded(1, 2, 3, 0),
    ):
        machine.handle(event)
    machine.handle(s.Judged(verdict(Verdict.NOT_MOVED, None)))
    assert machine.learner.tip_speed(machine.strike) == before


def run_until_state(machine: s.SessionMachine, state) -> None:
    """Run a session without faults until it reaches `state`."""
    events: list[s.Event] = [
        s.Started(),
        s.Placed(),
        s.PoseChecked(good=True),
        s.Ready(),
        s.Struck(1, 1.0, 0.4, 1),
        s.Recorded(1, 2, 3, 0),
    ]
    for event in events:
        if machine.state == state:
            return
        machine.handle(event)
    assert machine.state == state


@pytest.mark.parametrize("state", [s.State.ARMING, s.State.STRIKING, s.State.RECORDING, s.State.JUDGING])
def test_strike_is_repeated_if_its_file_was_cut_short(state):
    machine = s.SessionMachine(plan(planned("s1"), planned("s2")))
    run_until_state(machine, state)
    actions = machine.handle(s.FileCutShort("the window was cut off"))
    assert isinstance(actions[-1], s.AskToPlace)
    assert machine.strike_id == "s1.1"
    assert "the window was cut off" in actions[0].text


@pytest.mark.parametrize("strikes", [1, 2])
def test_judged_strike_is_repeated_if_its_record_was_not_written(strikes):
    """Also after the last strike, when the session is already finished."""
    machine = s.SessionMachine(plan(*(planned(f"s{i + 1}") for i in range(strikes))))
    run_until_state(machine, s.State.JUDGING)
    actions = machine.handle(s.Judged(verdict(Verdict.GOOD, 1.2)))
    assert isinstance(actions[0], s.WriteRecord)
    assert machine.state == (s.State.FINISHED if strikes == 1 else s.State.PLACING)
    actions = machine.handle(s.FileCutShort("the capture process ended"))
    assert isinstance(actions[-1], s.AskToPlace)
    assert machine.strike_id == "s1.1"


def test_repeatedly_cut_files_end_the_session():
    machine = s.SessionMachine(plan(planned("s1")))
    run_until_state(machine, s.State.STRIKING)
    for _ in range(s.MAX_FAULTS):
        assert isinstance(machine.handle(s.FileCutShort("x"))[-1], s.AskToPlace)
        machine.handle(s.Placed())
        machine.handle(s.PoseChecked(good=True))
    actions = machine.handle(s.FileCutShort("x"))
    assert isinstance(actions[-1], s.CloseRecording)
    assert actions[-1].aborted
