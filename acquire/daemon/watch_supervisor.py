"""Supervision of `analyze watch` for one recording."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from acquire.daemon.watcher import Watcher
from schemas.watch_lines import WatchEvent

WATCHER_LIVES = 3
"""number of times that `analyze watch` may end in one recording before it is not started again"""


class WatchSupervisor:
    """Runs `analyze watch` on the files of one recording, and restarts it a limited number of times."""

    def __init__(self, on_event: Callable[[WatchEvent], None]) -> None:
        self._on_event = on_event
        self._expected_strike = ""
        self._lives = WATCHER_LIVES
        self.watcher: Watcher | None = None
        """current child process; None if there is none"""

    def follow(self, file: Path) -> None:
        """Start a child on a growing file."""
        self.watcher = Watcher(file, self._on_event)
        if self._expected_strike:
            self.watcher.expect(self._expected_strike)

    def expect(self, plan_strike_id: str) -> None:
        """Compare placements with this planned strike from now on, also after a restart."""
        self._expected_strike = plan_strike_id
        if (watcher := self.watcher) is not None:
            watcher.expect(plan_strike_id)

    def restart_if_ended(self, file: Callable[[], Path]) -> str:
        """Restart a child that ended, on the file that `file()` returns.

        Returns:
            Text of a report; empty if there is nothing to report.
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
        """End the child."""
        watcher, self.watcher = self.watcher, None
        if watcher is not None:
            watcher.close()
