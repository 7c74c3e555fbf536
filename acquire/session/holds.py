"""Wait of a session while it is held: before it arms, until a person goes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from acquire.errors import StrikerStopped
from acquire.session.events import StopRequested
from acquire.session.machine import SessionMachine
from acquire.session.progress import ProgressReporter


def wait_while_held(
    call: Callable[..., Any],
    machine: SessionMachine,
    status: ProgressReporter,
    report: Callable[[str], None],
) -> StopRequested | bool:
    """Wait while the session is held, with its state and the reason in the recording.

    Args:
        call: function that makes a request (name, parameters) to the daemon.
        machine: state machine of the session.
        status: reporter of the session's progress.
        report: function that shows a line to the operator.

    Returns:
        False if it was not held, True after a hold; StopRequested if the striker was stopped meanwhile.

    Raises:
        SessionError: the daemon stops.
    """
    hold = call("hold.status")
    if not hold.get("held"):
        return False
    text = f"paused: {hold['text']}"
    strike_id = machine.strike.id if machine.plan.strikes else ""
    attempt = machine.attempt
    call("recording.state", state=machine.state, strike_id=strike_id, attempt=attempt, text=text)
    status.pause(hold["text"])
    report(text)
    try:
        call("hold.wait")
    except StrikerStopped as error:
        return StopRequested(str(error))
    return True
