"""Open a recording for a replay, a damaged one as far as it can be read."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.errors import RecordingError, RecordingVersion
from analyze.reading.recording import Recording, open_partial, open_recording

if TYPE_CHECKING:
    from pathlib import Path


def open_readable_part(path: Path) -> tuple[Recording, str | None]:
    """Open a recording, whole or damaged, as far as it can be read.

    Returns:
        The recording, which the caller closes; and its damage in one line, or None if it is whole.

    Raises:
        RecordingError: nothing can be read, or the file has another major schema version.
    """
    try:
        recording = open_recording(path)
    except RecordingVersion:
        raise
    except RecordingError as error:
        return open_partial(path), str(error)
    # Where the index of the strikes is damaged, a walk through the file still finds them.
    try:
        _ = recording.strikes
    except RecordingError as error:
        recording.close()
        return open_partial(path), str(error)
    return recording, None
