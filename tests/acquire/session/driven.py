"""Session's state machine driven without a daemon: every action is carried out without a fault."""

from __future__ import annotations

from collections.abc import Callable

from acquire.session import actions, events
from acquire.session.machine import SessionMachine
from schemas.watch_lines import AdviceRequest, SessionEstimate, StrikeVerdict

MOST_EVENTS = 500


def _no_advice(_request: AdviceRequest) -> SessionEstimate | None:
    raise AssertionError("advice was asked for")


def drive(
    machine: SessionMachine,
    judge: Callable[[SessionMachine, float], StrikeVerdict | None],
    *,
    advise: Callable[[AdviceRequest], SessionEstimate | None] = _no_advice,
    place: Callable[[SessionMachine], events.Event] = lambda _machine: events.Placed(),
) -> list[actions.Action]:
    """Run a session to its end and return its actions.

    Args:
        machine: state machine at its beginning.
        judge: gives the verdict on a strike, by the machine and the commanded tip speed [m/s].
        advise: answers requests for advice.
        place: what the operator does when asked to place the object.
    """
    done: list[actions.Action] = []
    event: events.Event = events.Started()
    speed = 0.0
    for _ in range(MOST_EVENTS):
        ordered = machine.handle(event)
        done += ordered
        match ordered[-1]:
            case actions.Advise(request=request):
                event = events.Advised(advise(request))
            case actions.AskToPlace():
                event = place(machine)
            case actions.CheckPose():
                event = events.PoseChecked(good=True)
            case actions.Arm():
                event = events.Ready()
            case actions.Strike(tip_speed_m_s=speed):
                event = events.Struck(1, 1e5, speed, 1)
            case actions.RecordUntilRest():
                event = events.Recorded(1, 2, 100, 0)
            case actions.Judge():
                event = events.Judged(judge(machine, speed))
            case actions.CloseRecording():
                return done
            case other:
                raise AssertionError(other)
    raise AssertionError("the session never ends")


def records(done: list[actions.Action]) -> list[actions.WriteRecord]:
    """Records of strikes among the actions of a session."""
    return [each for each in done if isinstance(each, actions.WriteRecord)]


def made(done: list[actions.Action]) -> list[str]:
    """Ids of the strikes among the actions of a session."""
    return [each.strike_id for each in records(done)]
