"""Follows a recording that continues in numbered files, from one file to the next."""

from __future__ import annotations

import contextlib
from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading.file_series import final_path
from analyze.reading.followed_recording import PART_SUFFIX, FollowedRecording
from analyze.reading.indexed_file import RecordedMessage
from analyze.types import ImageFrame
from schemas.session_manifest import SessionManifest
from schemas.strike_plan import StrikePlan


def next_part_path(path: Path) -> Path:
    """Path of the file after `path` in the series NAME.mcap, NAME-0002.mcap, ..., while it is written.

    `path` may be finished or end in `.part`; the result ends in `.part`.
    """
    whole = final_path(path)
    head, _, number = whole.stem.rpartition("-")
    if head and len(number) == 4 and number.isdecimal():
        return whole.with_name(f"{head}-{int(number) + 1:04d}{whole.suffix}{PART_SUFFIX}")
    return whole.with_name(f"{whole.stem}-0002{whole.suffix}{PART_SUFFIX}")


class FollowedSeries:
    """A series of files that another process is writing, from `path` on, as one recording.

    A file belongs to the series if its manifest (description of the session) has the same `recording_id` and
    the next `part` number; an older file of that name does not.
    """

    def __init__(self, path: Path) -> None:
        self._present = FollowedRecording(path)

    @property
    def path(self) -> Path:
        """Path of the present file."""
        return self._present.path

    @property
    def manifest(self) -> SessionManifest | None:
        """Manifest (description of the session) of the present file; None until `poll` has read it."""
        return self._present.manifest

    @property
    def plan(self) -> StrikePlan | None:
        """Strike plan attached to the present file; None until `poll` has read it.

        Raises:
            RecordingError: the plan cannot be read.
        """
        return self._present.plan

    @property
    def shape_bytes(self) -> bytes | None:
        """Content of the object's shape file; None for a primitive, and until `poll` has read it."""
        return self._present.shape_bytes

    @property
    def finished(self) -> bool:
        """True once the writer has ended the present file; another file of the series may follow."""
        return self._present.finished

    def poll(self) -> list[RecordedMessage]:
        """Read the messages written since the last call, in the files' order, without ground truth.

        It does not wait; the list is empty if nothing was written. When a file is finished and the next one
        has its manifest, the next becomes the present file.

        Raises:
            RecordingVersion: the recording is of another major schema version.
            RecordingError: the present file is not a recording, or is damaged.
        """
        found = self._present.poll()
        while self._present.finished and (following := self._following_file()) is not None:
            self._present.close()
            self._present = following
            found += following.poll()
        return found

    def image(self, message: RecordedMessage) -> ImageFrame:
        """Decode the image in a message of an image topic, from any file of the series.

        Raises:
            RecordingError: the message holds no image, or is of an imported video.
        """
        return self._present.image(message)

    def refuse_missing(self) -> None:
        """Check that the file to follow has appeared.

        Raises:
            RecordingError: no `poll` has found it yet.
        """
        self._present.refuse_missing()

    def close(self) -> None:
        """Close the present file; messages already returned stay valid."""
        self._present.close()

    def _following_file(self) -> FollowedRecording | None:
        """Open the next file of the same recording; None until it exists and has its manifest."""
        ours, path = self._present.manifest, next_part_path(self._present.path)
        # A file that is no recording is not of this series.
        with contextlib.suppress(RecordingError), FollowedRecording(path) as file:
            head = file.read_manifest()
            if ours and head and (head.recording_id, head.part) == (ours.recording_id, ours.part + 1):
                return FollowedRecording(path)
        return None
