"""State of the daemon's open recording."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from acquire.daemon.salvage import Salvage
from acquire.daemon.watch_supervisor import WatchSupervisor
from acquire.errors import RecordingBroken
from acquire.recorder.file_series import newest_part, part_path
from acquire.recorder.writer import PART_SUFFIX
from schemas import topics
from schemas.session_manifest import SessionManifest


@dataclass
class RecordingState:
    """Files, owner and interruption of an open recording."""

    path: Path
    manifest: SessionManifest
    attachments: list[tuple[str, str, bytes]]
    """(name, media type, content)"""
    owner: object
    watch: WatchSupervisor
    part: int = 1
    """number of the current file"""
    began_ns: int = 0
    """log time at which the current file began"""
    window_part: int | None = None
    """number of the file in which the open window was opened; None if no window is open"""
    broken: str = ""
    """reason why nothing is recorded now; empty while the capture process records"""
    waiting: list[tuple[topics.Topic, int, bytes]] = field(default_factory=list)
    """small messages for the next file"""
    salvages: list[Salvage] = field(default_factory=list)

    def start_watching(self) -> None:
        """Start `analyze watch` on the current file; it continues with the later files of the series."""
        self.watch.follow(self._watched_file())

    def restart_watching_if_ended(self) -> str:
        """Restart an `analyze watch` that ended. Returns a report for people; empty if none is due."""
        return self.watch.restart_if_ended(self._watched_file)

    def refuse_earlier_file(self, window_start_ns: int) -> None:
        """Raise RecordingBroken if a window lies in a file that was cut short."""
        if self.part > 1 and 0 < window_start_ns < self.began_ns and self.salvages:
            name = part_path(self.path, self.part).name
            raise RecordingBroken(f"the strike's images are in a file that was cut short, before {name}")

    def _watched_file(self) -> Path:
        # The file before the newest surely exists, and holds the beginning of a strike in progress.
        number = max(self.part, newest_part(self.path) - 1)
        return Path(f"{part_path(self.path, number)}{PART_SUFFIX}")
