"""Interface between the console's routes and the rig; tests and the sample server put others in its place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from acquire.console.web.orders import Answer, ArchiveEntry, Curve, StartSession, StopDone
from acquire.console.web.snapshot import Role, Snapshot


@dataclass(frozen=True)
class Viewer:
    """Role of the browser for which a snapshot is made, and who else looks on."""

    role: Role
    operator_present: bool
    watchers: int


class Backend(Protocol):
    """Rig as the console's routes see it; methods may block, and are called from any thread.

    Raises:
        AcquireError: the rig, or a program that was started, refuses.
        Refusal: the order cannot be carried out.
    """

    def snapshot(self, viewer: Viewer) -> Snapshot:
        """State for one browser, without waiting for anything."""
        ...

    def stop(self) -> StopDone:
        """Stop the striker."""
        ...

    def clear_stop(self) -> None:
        """Home the striker again after a stop."""
        ...

    def start_daemon(self) -> None:
        """Start the daemon in a process of its own; return when it listens or has failed."""
        ...

    def start_check(self) -> None:
        """Start the preflight check; its lines appear in the snapshot."""
        ...

    def start_session(self, order: StartSession) -> None:
        """Start a session in a process of its own."""
        ...

    def pause(self, when: str) -> None:
        """Hold the session before its next arming."""
        ...

    def resume(self) -> None:
        """Release a hold."""
        ...

    def abort(self) -> None:
        """Stop the striker and end the session; its recording is kept."""
        ...

    def answer(self, answer: Answer) -> None:
        """Answer a prompt."""
        ...

    def card(self, strike_id: str) -> bytes:
        """Drawing (SVG) of a strike's placement card."""
        ...

    def curve(self, strike_id: str) -> Curve:
        """Curve of a strike of the session."""
        ...

    def preview(self) -> tuple[int, bytes] | None:
        """Number and JPEG bytes of the newest preview image; None if there is none."""
        ...

    def archive(self) -> list[ArchiveEntry]:
        """Recordings in the folder of recordings."""
        ...

    def estimate(self, recording_id: str) -> dict[str, Any]:
        """Estimate a recording (again), and return the result document."""
        ...

    def report(self, recording_id: str) -> Path:
        """Path of the recording's report (HTML), made if it is missing or older than the recording."""
        ...

    def recording(self, recording_id: str) -> Path:
        """Path of a recording."""
        ...
