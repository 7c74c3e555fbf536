"""Steps of a session's tosses, carried out through the daemon: prompt, recording window, record."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from acquire.errors import StrikerStopped
from acquire.session import actions, events, waits
from schemas.watch_lines import WatchEvent
from schemas.wording import counted


class TossSteps:
    """Carries out the actions of a session's tosses.

    Args:
        call: function that makes a request (name, parameters) to the daemon.
        report: function that shows a line to the operator.
        clear_fault: homes the striker; a StopRequested event if it was stopped meanwhile.
    """

    def __init__(
        self,
        call: Callable[..., Any],
        report: Callable[[str], None],
        clear_fault: Callable[[], events.StopRequested | None],
    ) -> None:
        self._call, self._report, self._clear_fault = call, report, clear_fault
        self.begun = 0
        """number of tosses whose recording window was opened"""
        self.kept = 0
        """number of tosses whose record is in the file"""

    @property
    def text(self) -> str:
        """Text that follows the number of strikes kept: ", 2 tosses"; empty without a toss."""
        return f", {counted(self.kept, 'toss')}" if self.begun else ""

    def execute(self, action: actions.TossStep) -> events.Event | None:
        """Carry out an action and return the event that results; None if there is none.

        Raises:
            RecordingBroken: the file with the toss's images was cut short.
            StrikerError: homing the striker failed.
        """
        match action:
            case actions.ParkStriker():
                self._report(f"the arm moves out of the way{waits.at_most(waits.HOME_TIMEOUT_S)}")
                return self._clear_fault()
            case actions.AskToToss():
                return self._ask(action)
            case actions.RecordToss():
                return self._record()
            case actions.WriteToss():
                return self._write(action)

    def _ask(self, action: actions.AskToToss) -> events.Event:
        toss = action.toss
        self._call("watch.expect", plan_strike_id="")  # no placement is compared
        answer = self._call(
            "prompt",
            kind="toss",
            strike_id=toss.id,
            text=toss.card,
            hint=action.hint,
            toss=toss.model_dump(mode="json"),
        )
        if not answer["ok"]:
            return events.StopRequested(answer["text"] or "stopped by the operator")
        order = answer.get("order", "placed")
        return events.Placed() if order == "placed" else events.Ordered(events.Order(order))

    def _record(self) -> events.Event:
        """Record until the object has moved and lies still, but at most TOSS_TIMEOUT_S."""
        self._call("window.open")
        self.begun += 1  # from here on the file may hold images that cannot be made again
        start = time.monotonic()
        moved, still_ns, end_ns, seen_ns = False, 0, 0, 0
        while time.monotonic() - start < waits.TOSS_TIMEOUT_S:
            time.sleep(0.05)
            if self._call("status")["striker_trouble"]:
                raise StrikerStopped
            answer = self._call("watch.latest")
            event = WatchEvent.model_validate(answer["event"]) if answer["event"] else None
            if event is None or not answer["alive"] or event.time_ns == seen_ns:
                continue  # without `analyze watch` the whole time is recorded
            seen_ns = event.time_ns
            moved = moved or not event.at_rest
            still_ns = (still_ns or event.time_ns) if moved and event.at_rest else 0
            if still_ns and event.time_ns - still_ns >= 1e9 * waits.TOSS_REST_S:
                end_ns = event.time_ns
                break
        found = self._call("window.close", end_ns=end_ns)
        return events.Tossed(
            events.Recorded(
                int(found["start_ns"]), int(found["end_ns"]), int(found["frames"]), int(found["lost"])
            )
        )

    def _write(self, action: actions.WriteToss) -> None:
        toss_id = f"{action.toss.id}.{action.attempt}"
        self._call(
            "recording.toss",
            toss_id=toss_id,
            plan_toss_id=action.toss.id,
            attempt=action.attempt,
            window_start_ns=action.recorded.window_start_ns,
            window_end_ns=action.recorded.window_end_ns,
        )
        self.kept += 1
        self._report(f"{toss_id}: tossed, {action.recorded.frames} frames")
