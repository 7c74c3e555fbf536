"""Handle of `analyze watch`, a child process of the daemon that follows a growing recording.

If the child ends, the recording continues.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from acquire.daemon.line_process import LineProcess
from schemas.watch_lines import JudgeRequest, StrikeVerdict, TossJudgement, TossRequest, WatchEvent

_Verdict = TypeVar("_Verdict", StrikeVerdict, TossJudgement)


class Watcher:
    """Child process `analyze watch FILE`: it reports what the newest image shows, and judges strikes.

    Args:
        recording: growing file; the child continues with the later files of its series.
        on_event: called with each observation of the newest image, in a thread of its own.
    """

    def __init__(self, recording: Path, on_event: Callable[[WatchEvent], None]) -> None:
        self.recording = recording
        self._on_event = on_event
        self._latest: WatchEvent | None = None
        self._verdicts: dict[str, StrikeVerdict] = {}
        self._tosses: dict[str, TossJudgement] = {}
        self._changed = threading.Condition()
        self._process = LineProcess(["analyze", "watch", str(recording)], self._take, self._note_end)

    @property
    def alive(self) -> bool:
        """True while the child runs."""
        return self._process.alive

    @property
    def latest(self) -> WatchEvent | None:
        """Latest report of the child process (`analyze watch`) on an image; None before the first.

        It holds the markers in the newest image, whether anything moves, the saturated pixels and the angle
        of the object to its planned placement.
        """
        return self._latest

    def expect(self, plan_strike_id: str) -> None:
        """Make the child compare the object's placement with a strike of the plan from now on.

        Args:
            plan_strike_id: id of the strike in the plan.
        """
        self._process.send(JudgeRequest(kind="expect", plan_strike_id=plan_strike_id))

    def judge(self, request: JudgeRequest, timeout_s: float) -> StrikeVerdict | None:
        """Make the child judge a strike from its images, and wait for the verdict.

        Args:
            request: ids of the strike, and the time span of its images.
            timeout_s: longest wait [s].

        Returns:
            The verdict; None if the child process ended or does not answer in time.
        """
        self._process.send(request)
        return self._wait_for(self._verdicts, request.strike_id, timeout_s)

    def judge_toss(self, request: TossRequest, timeout_s: float) -> TossJudgement | None:
        """Make the child judge a toss from its images, and wait for the verdict.

        Args:
            request: ids of the toss, and the time span of its images.
            timeout_s: longest wait [s].

        Returns:
            The verdict; None if the child process ended or does not answer in time.
        """
        self._process.send(request)
        return self._wait_for(self._tosses, request.toss_id, timeout_s)

    def _wait_for(self, verdicts: dict[str, _Verdict], name: str, timeout_s: float) -> _Verdict | None:
        end = time.monotonic() + timeout_s
        with self._changed:
            while name not in verdicts:
                left = end - time.monotonic()
                if left <= 0 or not self.alive:
                    return None
                self._changed.wait(min(left, 0.5))
            return verdicts[name]

    def close(self) -> None:
        """Terminate the child process, which has nothing to save, and end the thread that reads from it."""
        self._process.close()

    def _take(self, data: dict[str, Any]) -> None:
        """Take a line of the child: a verdict, or an observation of an image.

        Raises:
            ValueError: it is neither.
        """
        if data.get("kind") == "verdict":
            verdict = StrikeVerdict.model_validate(data)
            with self._changed:
                self._verdicts[verdict.strike_id] = verdict
                self._changed.notify_all()
        elif data.get("kind") == "toss_verdict":
            judged = TossJudgement.model_validate(data)
            with self._changed:
                self._tosses[judged.toss_id] = judged
                self._changed.notify_all()
        else:
            self._latest = WatchEvent.model_validate(data)
            self._on_event(self._latest)

    def _note_end(self) -> None:
        with self._changed:
            self._changed.notify_all()
