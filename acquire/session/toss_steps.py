"""Steps of a session's tosses, carried out through the daemon: prompt, recording window, record."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from acquire.errors import StrikerStopped
from acquire.session import actions, events, waits
from schemas.watch_lines import TossJudgement, WatchEvent
from schemas.wording import counted

STOPPED = "stopped on request"
"""striker's trouble after a stop, as the daemon's status states it"""
FAST_PX, FAST_LOOKS = 12.0, 2
"""motion of a marker between two observations [px] from which on the object flies; number of them in
succession"""
MOVING_LOOKS = 6
"""number of observations in succession with motion, 0.5 s, after which an untagged object has flown"""


class TossSteps:
    """Carries out the actions of a session's tosses.

    Args:
        call: function that makes a request (name, parameters) to the daemon.
        report: function that shows a line to the operator.
        clear_fault: homes the striker; a StopRequested event if it was stopped meanwhile.
        untagged: True if the object has no tags.
    """

    def __init__(
        self,
        call: Callable[..., Any],
        report: Callable[[str], None],
        clear_fault: Callable[[], events.StopRequested | None],
        *,
        untagged: bool = False,
    ) -> None:
        self._call, self._report, self._clear_fault = call, report, clear_fault
        self._untagged = untagged
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
            case actions.JudgeToss():
                return self._judge(action)
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
        """Record until the object has flown and lies still, or somebody pressed stop.

        The longest recorded time is TOSS_TIMEOUT_S; images may arrive late, but not by more than the rest of
        TOSS_LATE_S.
        """
        opened_ns = int(self._call("window.open")["start_ns"])
        self.begun += 1  # from here on the file may hold images that cannot be made again
        start = time.monotonic()
        flight, end_ns, seen_ns = FlightWatch(untagged=self._untagged), 0, opened_ns
        while not end_ns and (waited_s := time.monotonic() - start) < waits.TOSS_LATE_S:
            time.sleep(0.05)
            if self._call("status")["striker_trouble"] == STOPPED:
                self._call("window.close")
                return events.StopRequested(str(StrikerStopped()))
            answer = self._call("watch.latest")
            event = WatchEvent.model_validate(answer["event"]) if answer["event"] else None
            if event is None or not answer["alive"]:  # without `analyze watch`: record for a fixed time
                if waited_s > waits.TOSS_TIMEOUT_S:
                    break
                continue
            if event.time_ns > seen_ns:
                seen_ns = event.time_ns
                late = event.time_ns - opened_ns > 1e9 * waits.TOSS_TIMEOUT_S
                if flight.is_over(event) or late:
                    end_ns = event.time_ns
        found = self._call("window.close", end_ns=end_ns)
        start_ns, end_ns, frames, lost = (int(found[key]) for key in ("start_ns", "end_ns", "frames", "lost"))
        return events.Tossed(events.Recorded(start_ns, end_ns, frames, lost))

    def _judge(self, action: actions.JudgeToss) -> events.Event:
        answer = self._call(
            "watch.judge_toss",
            plan_toss_id=action.toss.id,
            toss_id=f"{action.toss.id}.{action.attempt}",
            window_start_ns=action.recorded.window_start_ns,
            window_end_ns=action.recorded.window_end_ns,
            timeout_s=waits.PRINT_JUDGE_TIMEOUT_S if self._untagged else waits.TOSS_JUDGE_TIMEOUT_S,
        )["verdict"]
        return events.TossJudged(TossJudgement.model_validate(answer) if answer else None)

    def _write(self, action: actions.WriteToss) -> None:
        verdict = action.verdict
        toss_id = f"{action.toss.id}.{action.attempt}"
        self._call(
            "recording.toss",
            toss_id=toss_id,
            plan_toss_id=action.toss.id,
            attempt=action.attempt,
            window_start_ns=action.recorded.window_start_ns,
            window_end_ns=action.recorded.window_end_ns,
            verdict_code=verdict.code.value if verdict else "",
            verdict_text=verdict.reason if verdict else "",
        )
        self.kept += 1
        outcome = f"{verdict.code.value.replace('_', ' ')}, {verdict.reason}" if verdict else "no verdict"
        self._report(f"{toss_id}: {outcome}, {counted(action.recorded.frames, 'frame')}")


class FlightWatch:
    """Decides from the observations of `analyze watch` whether a tossed object has flown and lies still.

    Args:
        untagged: True if the object has no tags, whose motion would show a flight.
    """

    def __init__(self, *, untagged: bool = False) -> None:
        self._untagged = untagged
        self._looks = MOVING_LOOKS if untagged else FAST_LOOKS
        self._last: WatchEvent | None = None
        self._fast = 0
        self._still_ns = 0
        self._held = False
        """True once all was at rest"""

    def is_over(self, event: WatchEvent) -> bool:
        """Take the next observation; True once the object lies still after a flight.

        The object flies if it moves fast in `FAST_LOOKS` observations in succession, as no hand that holds it
        trembles; it lies still if it is at rest for TOSS_REST_S. Without tags it flies if anything moves in
        `MOVING_LOOKS` observations in succession after a rest: recording begins while it is held still.
        """
        if self._fast < self._looks:
            self._fast = self._fast + 1 if self._moves_fast(event) else 0
        self._last = event
        if self._fast < self._looks or not event.at_rest:
            self._still_ns = 0
            return False
        self._still_ns = self._still_ns or event.time_ns
        return event.time_ns - self._still_ns >= 1e9 * waits.TOSS_REST_S

    def _moves_fast(self, event: WatchEvent) -> bool:
        """True if every marker seen in this observation and the one before has moved by `FAST_PX` or more.

        Also if markers were seen in both, and none in both; and without tags after a rest, unless all rests.
        """
        if self._untagged:
            self._held = self._held or event.at_rest
            return self._held and not event.at_rest
        if self._last is None or not event.markers or not self._last.markers:
            return False
        before = {marker.id: marker.corners_px for marker in self._last.markers}
        steps = [
            math.dist(marker.corners_px[0], before[marker.id][0])
            for marker in event.markers
            if marker.id in before
        ]
        return all(step >= FAST_PX for step in steps)
