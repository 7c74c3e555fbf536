"""Handle of `analyze advise`, a child process of the daemon that states a session's answer so far.

It is started by the first request and again if it has ended; without it a session goes on by its plan.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from acquire.daemon.line_process import LineProcess
from schemas.watch_lines import AdviceRequest, SessionEstimate

INFORM_FROM = 1 << 30
"""requests of `inform` are numbered from here on, so that none has the number of one by `ask`"""


class Adviser:
    """Child process `analyze advise FILE`: the answer so far of one recording, and the next strike.

    Args:
        on_estimate: called with each answer, in a thread of its own.
    """

    def __init__(self, on_estimate: Callable[[SessionEstimate], None]) -> None:
        self._on_estimate = on_estimate
        self._process: LineProcess | None = None
        self._series: tuple[Path, int] | None = None
        self._latest: SessionEstimate | None = None
        self._changed = threading.Condition()
        self._informed = INFORM_FROM
        self.asked = False
        """True once the session itself has asked for advice in this recording"""

    @property
    def latest(self) -> SessionEstimate | None:
        """Latest answer; None before the first of this recording."""
        return self._latest

    def ask(self, file: Path, part: int, request: AdviceRequest, timeout_s: float) -> SessionEstimate | None:
        """Ask for the answer so far, and wait for it.

        Args:
            file: first file of the recording; the child reads those that continue it as well.
            part: number of the file that is being written: once it has changed, the child is started again,
                as an earlier file was cut short and recovered.
            request: target and state of the session.
            timeout_s: longest wait [s].

        Returns:
            The answer; None if the child process ended or does not answer in time.
        """
        end = time.monotonic() + timeout_s
        self.asked = True
        for _ in range(2):  # a child that died meanwhile is started once more
            process = self._running((file, part))
            process.send(request)
            if (answer := self._awaited(process, request.number, end)) is not None:
                return answer
            if process.alive:
                break
        return None

    def _awaited(self, process: LineProcess, number: int, end_s: float) -> SessionEstimate | None:
        """Answer to the request `number`; None if the child ends, or does not answer until `end_s`."""
        with self._changed:
            while self._latest is None or self._latest.number != number:
                left = end_s - time.monotonic()
                if left <= 0 or not process.alive:
                    return None
                self._changed.wait(min(left, 0.5))
            return self._latest

    def inform(self, file: Path, part: int, strike_id: str) -> None:
        """Let the answer so far be published once a strike has been read, without waiting for it.

        Args:
            file: first file of the recording.
            part: number of the file that is being written.
            strike_id: id of the newest attempt.
        """
        self._informed += 1
        self._running((file, part)).send(AdviceRequest(number=self._informed, strike_id=strike_id))

    def close(self) -> None:
        """End the child process and forget its answers; does nothing if there is none."""
        process, self._process = self._process, None
        self.asked = False
        self._series, self._latest = None, None
        if process is not None:
            process.close()

    def _running(self, series: tuple[Path, int]) -> LineProcess:
        """Child process for a recording, started if there is none."""
        if self._process is None or not self._process.alive or series != self._series:
            asked = self.asked
            self.close()
            self.asked, self._series = asked, series
            self._process = LineProcess(["analyze", "advise", str(series[0])], self._take, self._note_end)
        return self._process

    def _take(self, data: dict[str, Any]) -> None:
        """Take an answer of the child.

        Raises:
            ValueError: the line is none.
        """
        estimate = SessionEstimate.model_validate(data)
        with self._changed:
            self._latest = estimate
            self._changed.notify_all()
        self._on_estimate(estimate)

    def _note_end(self) -> None:
        with self._changed:
            self._changed.notify_all()
