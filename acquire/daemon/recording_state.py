"""State of the daemon's open recording: its files, its owner and its interruption."""

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
    """State of the daemon's open recording: files, the client that owns it, and any interruption."""

    path: Path
    """first file of the recording"""
    manifest: SessionManifest
    """object, hash of the plan, camera and clock, as written at the head of every file"""
    attachments: list[tuple[str, str, bytes]]
    """files attached to the recording: (name, media type, content) of each"""
    owner: object
    """client that opened the recording"""
    watch: WatchSupervisor
    """runner of `analyze watch` on the recording's files"""
    part: int = 1
    """number of the current file"""
    began_ns: int = 0
    """log time at which the current file began [ns]"""
    window_part: int | None = None
    """number of the file in which the open window was opened; None if no window is open"""
    broken: str = ""
    """reason why nothing is recorded now; empty while the capture process records"""
    waiting: list[tuple[topics.Topic, int, bytes]] = field(default_factory=list)
    """(topic, log time [ns], serialised message) of small messages for the next file"""
    refused: int = 0
    """number of small messages that the capture process did not take, and that were not reported yet"""
    salvages: list[Salvage] = field(default_factory=list)
    """recoveries of files that were cut short, in order"""

    def start_watching(self) -> None:
        """Start the child process `analyze watch` on the recording's current file.

        The child follows that file and the later ones of the recording. It reports what the newest image
        shows, and judges strikes.
        """
        self.watch.follow(self._watched_file())

    def restart_watching_if_ended(self) -> str:
        """Restart the child process `analyze watch` if it ended, unless it has ended too often.

        Returns:
            A report for people: it was restarted, or given up; an empty text if nothing was done.
        """
        return self.watch.restart_if_ended(self._watched_file)

    def refuse_earlier_file(self, window_start_ns: int) -> None:
        """Raise RecordingBroken if a window (time span of a strike) began in an earlier file, cut short.

        Args:
            window_start_ns: log time of the window's start [ns]; 0 if there was no window.
        """
        if self.part > 1 and 0 < window_start_ns < self.began_ns and self.salvages:
            name = part_path(self.path, self.part).name
            raise RecordingBroken(f"the strike's images are in a file that was cut short, before {name}")

    def _watched_file(self) -> Path:
        # The file before the newest surely exists, and holds the beginning of a strike in progress.
        number = max(self.part, newest_part(self.path) - 1)
        return Path(f"{part_path(self.path, number)}{PART_SUFFIX}")
