"""Follows a recording from file to file: a continuous one is a row of numbered files."""

from __future__ import annotations

import contextlib
from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading.followed_recording import PART_SUFFIX, FollowedRecording
from analyze.reading.indexed_file import RecordedMessage
from analyze.types import ImageFrame
from schemas.session_manifest import SessionManifest
from schemas.strike_plan import StrikePlan


def next_file(path: Path) -> Path:
    """The `.part` name of the file after `path` (a `.part` name or a whole file's): NAME.mcap, NAME-0002.mcap, NAME-0003.mcap, ..."""
    whole = path.with_suffix("") if path.suffix == PART_SUFFIX else path
    head, _, number = whole.stem.rpartition("-")
    if head and len(number) == 4 and number.isdecimal():
        return whole.with_name(f"{head}-{int(number) + 1:04d}{whole.suffix}{PART_SUFFIX}")
    return whole.with_name(f"{whole.stem}-0002{whole.suffix}{PART_SUFFIX}")


class FollowedSeries:
    """A row of files that somebody is writing, from `path` on, as one recording.

    A file belongs to the row when it carries the same `recording_id` and the next `part`; an older one of the same name does not.
    """

    def __init__(self, path: Path) -> None:
        self._present = FollowedRecording(path)

    @property
    def path(self) -> Path:
        """Of the present file."""
        return self._present.path

    @property
    def manifest(self) -> SessionManifest | None:
        """Of the present file; None until it was written."""
        return self._present.manifest

    @property
    def plan(self) -> StrikePlan | None:
        """None until it was written."""
        return self._present.plan

    @property
    def shape_bytes(self) -> bytes | None:
        """The object's shape file, None for a primitive and before it was written."""
        return self._present.shape_bytes

    @property
    def finished(self) -> bool:
        """Whether the writer ended the present file; another of the row may follow."""
        return self._present.finished

    def poll(self) -> list[RecordedMessage]:
        """Messages written since the last call, in the order of the files; see FollowedRecording.poll."""
        found = self._present.poll()
        while self._present.finished and (after := self._after()) is not None:
            self._present.close()
            self._present = after
            found += after.poll()
        return found

    def image(self, message: RecordedMessage) -> ImageFrame:
        """The image in a message of an image topic, of any file of the row: all have the same topics."""
        return self._present.image(message)

    def refuse_missing(self) -> None:
        """Raise RecordingError if the file has not appeared."""
        self._present.refuse_missing()

    def close(self) -> None:
        """Let go of the file; messages already given out stay valid."""
        self._present.close()

    def _after(self) -> FollowedRecording | None:
        """The next file of the same recording, once it has its head."""
        ours, path = self._present.manifest, next_file(self._present.path)
        head = None
        with contextlib.suppress(RecordingError), FollowedRecording(path) as file:  # what is no recording is none of this row
            head = file.peek()
        if ours is None or head is None or (head.recording_id, head.part) != (ours.recording_id, ours.part + 1):
            return None
        return FollowedRecording(path)
