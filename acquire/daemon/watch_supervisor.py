"""Supervision of `analyze watch`, the child process that follows the images of one recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from acquire.daemon.watcher import Watcher
from schemas.watch_lines import WatchEvent

WATCHER_LIVES = 3
"""number of times that `analyze watch` may end in one recording before it is not started again"""


class WatchSupervisor:
    """Supervisor of `analyze watch`: runs it on the files of one recording, restarts it if it ends.

    Args:
        on_event: called with each observation of the newest image that the child process reports, in a
            thread of its own.
    """

    def __init__(self, on_event: Callable[[WatchEvent], None]) -> None:
        self._on_event = on_event
        self._expected_strike = ""
        self._lives = WATCHER_LIVES
        self.watcher: Watcher | None = None
        """current child process; None if there is none"""

    def follow(self, file: Path) -> None:
        """Start the child process `analyze watch` on the growing recording `file`.

        An earlier child must have been stopped.
        """
        self.watcher = Watcher(file, self._on_event)
        if self._expected_strike:
            self.watcher.expect(self._expected_strike)

    def expect(self, plan_strike_id: str) -> None:
        """Make `analyze watch` compare the object's placement with a strike of the plan from now on.

        A child process that is started later makes the same comparison.

        Args:
            plan_strike_id: id of the strike in the plan.
        """
        self._expected_strike = plan_strike_id
        if (watcher := self.watcher) is not None:
            watcher.expect(plan_strike_id)

    def restart_if_ended(self, file: Callable[[], Path]) -> str:
        """Restart the child process `analyze watch` if it ended; at its WATCHER_LIVES-th end give it up.

        Args:
            file: function that returns the path of the recording to follow; called only for a restart.

        Returns:
            Report for people that the child was restarted or given up; empty if it runs, was never started,
            or was given up before.
        """
        if (watcher := self.watcher) is None or watcher.alive or self._lives == 0:
            return ""
        self._lives -= 1
        watcher.close()
        if self._lives == 0:
            return "analyze watch keeps ending: the recording continues without verdicts"
        self.follow(file())
        return "analyze watch ended and was started again"

    def stop(self) -> None:
        """End the child process `analyze watch`; does nothing if there is none."""
        watcher, self.watcher = self.watcher, None
        if watcher is not None:
            watcher.close()
