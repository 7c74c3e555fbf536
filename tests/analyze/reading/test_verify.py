"""Every message is compared with the seal, in one file and in a series."""

from __future__ import annotations

import pytest

from analyze.errors import RecordingError
from analyze.reading.recording import open_recording
from analyze.reading.verify import refuse_changed_content
from tests import small_recording as small
from tests.analyze.split_recording import split_recording


@pytest.fixture
def row(tmp_path):
    """A recording in two files."""
    small.write_recording(tmp_path / "whole.mcap")
    return split_recording(tmp_path / "whole.mcap", tmp_path / "a.mcap", small.frame_time(10))


def test_unchanged_recording_passes(row):
    refuse_changed_content(row[0].with_name("whole.mcap"))
    for path in row:
        refuse_changed_content(path)


def test_changed_file_of_a_series_is_named(row):
    with open_recording(row[0]) as recording:
        sealed = recording.parts[1].content_id
    assert sealed is not None
    data = row[1].read_bytes()
    assert data.count(sealed.encode()) == 1
    row[1].write_bytes(data.replace(sealed.encode(), sealed[::-1].encode()))
    with pytest.raises(RecordingError, match=r"a-0002\.mcap: damaged: its content is not what was sealed"):
        refuse_changed_content(row[0])
