"""Progress of a session as it reports it to the daemon, for consoles that show it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from acquire.session.actions import Announce, WriteRecord
from acquire.session.machine import State
from acquire.session.options import DEFAULT_OPTIONS, SessionOptions
from acquire.session.session_input import SessionInput
from schemas.edge_names import edge_names
from schemas.proto import percuss_pb2 as pb
from schemas.session_status import SessionStatus, StrikeStatus


class ProgressReporter:
    """Status of one session: it begins idle, and is reported whenever it changes.

    Args:
        call: function that makes a request (name, parameters) to the daemon.
        given: object and plan of the session.
        output: path of the recording.
        progress: function that returns the number of planned strikes done, and of all.
        options: target and earlier recordings of the session.
    """

    def __init__(
        self,
        call: Callable[..., Any],
        given: SessionInput,
        output: Path,
        progress: Callable[[], tuple[int, int]],
        options: SessionOptions = DEFAULT_OPTIONS,
    ) -> None:
        self._call, self._progress = call, progress
        self._edges = edge_names(given.plan.strikes)
        self._axes = {strike.id: strike.axis_id for strike in given.plan.strikes}
        self._status = SessionStatus(
            object=given.spec.name,
            plan=given.plan_path.name,
            file=str(output.resolve()),
            began_ns=time.time_ns(),
            total=progress()[1],
            until="" if options.target is None else str(options.target),
            max_strikes=None if options.target is None else options.target.max_strikes,
            earlier=0 if options.earlier is None else len(options.earlier.strikes),
        )

    def announce(self, action: Announce) -> None:
        """Report a state of the session."""
        self._report(
            state=_name(action.state),
            text=action.text,
            strike_id=action.strike_id,
            toss_id=action.toss_id,
            edge=self.edge(action.strike_id),
            attempt=action.attempt,
        )

    def pause(self, text: str) -> None:
        """Report that the session waits before it arms.

        Args:
            text: reason.
        """
        self._report(state="paused", text=text)

    def count_down(self, arms_at_ns: int | None) -> None:
        """Report that the countdown runs, or that it has ended.

        Args:
            arms_at_ns: Unix time at which the striker is armed [ns]; None at the end of the countdown.
        """
        self._report(arms_at_ns=arms_at_ns)

    def add_strike(self, action: WriteRecord) -> None:
        """Report a strike that was recorded."""
        verdict = action.verdict
        strike = StrikeStatus(
            id=action.strike_id,
            edge=self.edge(action.strike.id),
            verdict="no_verdict" if verdict is None else verdict.code.value,
            reason="" if verdict is None else verdict.reason,
            phi_rad=None if verdict is None else verdict.phi,
            phi_sd_rad=None if verdict is None else verdict.phi_sd,
            energy_ratio=None if verdict is None else verdict.energy_ratio,
        )
        self._report(strikes=[*self._status.strikes, strike])

    def edge(self, plan_strike_id: str) -> str:
        """Pivot edge of a planned strike in words; empty if the plan has no such strike."""
        return self._edges.get(self._axes.get(plan_strike_id, ""), "")

    def _report(self, **changes: Any) -> None:
        done, total = self._progress()
        self._status = self._status.model_copy(update={**changes, "done": done, "total": total})
        self._call("session.report", **self._status.model_dump(mode="json"))


def _name(state: pb.SessionState.State) -> Any:
    return State.Name(state).lower()
