"""Follows a recording that continues in numbered files, from one file to the next."""

from __future__ import annotations

import contextlib
from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading.file_series import final_path
from analyze.reading.followed_recording import PART_SUFFIX, FollowedRecording
from analyze.reading.indexed_file import RecordedMessage


def next_part_path(path: Path) -> Path:
    """Path of the file after `path` in the series NAME.mcap, NAME-0002.mcap, ..., while it is written.

    `path` may be finished or end in `.part`; the result ends in `.part`.
    """
    whole = final_path(path)
    head, _, number = whole.stem.rpartition("-")
    if head and len(number) == 4 and number.isdecimal():
        return whole.with_name(f"{head}-{int(number) + 1:04d}{whole.suffix}{PART_SUFFIX}")
    return whole.with_name(f"{whole.stem}-0002{whole.suffix}{PART_SUFFIX}")


class FollowedSeries(FollowedRecording):
    """Reader of a series of files that another process is writing, from `path` on, as one recording.

    Its path, manifest, plan, shape and `finished` are those of the current file, the one being read, and
    change with it. A file belongs to the series if its manifest (description of the session) has the same
    `recording_id` and the next `part` number; an older file of that name does not.
    """

    def poll(self) -> list[RecordedMessage]:
        """Read the messages written since the last call, in the files' order, without ground truth.

        The call does not wait; the list is empty if nothing was written or the file does not exist yet. When
        the current file is finished and the next one has its manifest, the next becomes the current file.

        Raises:
            RecordingVersion: the recording is of another major schema version.
            RecordingError: the current file is not a recording, cannot be read, or is damaged.
        """
        found = super().poll()
        while self.finished and self._has_next(path := next_part_path(self.path)):
            self.close()
            self._follow(path)
            found += super().poll()
        return found

    def _has_next(self, path: Path) -> bool:
        """True if the file at `path` exists, has its manifest, and is the next file of this recording."""
        # A file that is no recording is not of this series.
        with contextlib.suppress(RecordingError), FollowedRecording(path) as file:
            ours, head = self.manifest, file.read_manifest()
            if ours and head:
                return (head.recording_id, head.part) == (ours.recording_id, ours.part + 1)
        return False
