"""Follows a recording that continues in numbered files, from one file to the next."""

from __future__ import annotations

import contextlib
from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading.file_series import final_path
from analyze.reading.followed_recording import PART_SUFFIX, FollowedRecording
from analyze.reading.indexed_file import RecordedMessage


def next_part_path(path: Path) -> Path:
    """Path of the file that follows `path` in a recording's series, while that file is being written.

    The series is NAME.mcap, NAME-0002.mcap, ...; files being written end in `.part`, as the result does.
    `path` may have this ending or not.
    """
    whole = final_path(path)
    head, _, number = whole.stem.rpartition("-")
    if head and len(number) == 4 and number.isdecimal():
        return whole.with_name(f"{head}-{int(number) + 1:04d}{whole.suffix}{PART_SUFFIX}")
    return whole.with_name(f"{whole.stem}-0002{whole.suffix}{PART_SUFFIX}")


class FollowedSeries(FollowedRecording):
    """Reader of a recording in several files that another process is writing, from the file `path` on.

    Path, manifest, plan, shape and `finished` are those of the current file, the one being read. A file
    counts as the next one only if its manifest (description of the session) has the same `recording_id` and
    the next `part` number; thus an older file that has the next file's name is not read.
    """

    def poll(self) -> list[RecordedMessage]:
        """Read what was written since the last call; return the messages in the order of files and messages.

        The call does not wait: the list is empty if nothing was written or the file does not exist yet.
        Ground truth of a simulation (topics under /truth/) is left out. When the current file is finished and
        the next one has its manifest (description of the session), the next becomes the current file.

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
        """True if the file at `path` exists and its manifest states that it is the recording's next file."""
        # A file that is no recording is not of this series.
        with contextlib.suppress(RecordingError), FollowedRecording(path) as file:
            ours, head = self.manifest, file.read_manifest()
            if ours and head:
                return (head.recording_id, head.part) == (ours.recording_id, ours.part + 1)
        return False
