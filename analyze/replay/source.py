"""Opens what is to be replayed, as far as it can be read."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.errors import RecordingError, RecordingVersion
from analyze.reading.recording import Recording, open_partial, open_recording

if TYPE_CHECKING:
    from pathlib import Path


def open_as_far_as_it_goes(path: Path) -> tuple[Recording, str | None]:
    """The recording, and in one line what is wrong with it; None where nothing is.

    Raises:
        RecordingError: there is nothing to be read, or it is of another major schema version.
    """
    try:
        recording = open_recording(path)
    except RecordingVersion:
        raise
    except RecordingError as error:
        return open_partial(path), str(error)
    # A damaged index of the strikes hides what a walk through the file still finds.
    try:
        _ = recording.strikes
    except RecordingError as error:
        recording.close()
        return open_partial(path), str(error)
    return recording, None
