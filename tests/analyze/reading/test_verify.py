"""Every message is compared with the seal, in one file and in a series."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analyze.errors import RecordingError
from analyze.reading.recording import open_recording
from analyze.reading.verify import refuse_changed_content
from schemas.mcap import records as container
from schemas.mcap.walk import walk
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


def _bytes_around_messages(data: bytes) -> list[int]:
    """Offsets of all bytes but messages, which a CRC covers, the header's names and the unused CRC."""
    magic, found = len(container.MAGIC), []
    for opcode, at, body in walk(memoryview(data), magic):
        size = container.RECORD_HEAD + len(body)
        if opcode in {container.HEADER, container.DATA_END}:
            size = container.RECORD_HEAD
        found += range(at, at + (container.CHUNK_HEAD if opcode == container.CHUNK else size))
    return [*range(magic), *found, *range(len(data) - magic, len(data))]


def test_a_changed_bit_around_the_messages_is_found(tmp_path):
    path = tmp_path / "whole.mcap"
    small.write_recording(path)
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(31)
    missed = []
    for at in rng.choice(_bytes_around_messages(bytes(data)), 300, replace=False):
        bit = 1 << rng.integers(8)
        data[at] ^= bit
        path.write_bytes(data)
        if _passes(path):
            missed.append((at, bytes(data[at - 30 : at + 10])))
        data[at] ^= bit
    # A seal whose key has another name states no hash of the manifest.
    assert all(b"manifest_sha256" in around or b"anifest_sha" in around for _, around in missed), missed
    assert len(missed) < 3


def _passes(path: Path) -> bool:
    try:
        refuse_changed_content(path)
    except RecordingError:
        return False
    return True
