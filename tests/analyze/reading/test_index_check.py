"""A message index with a wrong bit is refused: it has no checksum, and its times become the frames' times."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from acquire.recorder.recover.recover import recover
from analyze.errors import RecordingError
from analyze.reading.recording import open_recording
from schemas.mcap import records as container
from schemas.mcap.walk import walk
from tests import small_recording as small


def index_of_frame_meta(data: bytearray) -> int:
    """Offset of the first message index record that lists several messages."""
    return next(
        at
        for opcode, at, body in walk(memoryview(data), len(container.MAGIC))
        if opcode == container.MESSAGE_INDEX and len(body) > 100
    )


def read_all(path: Path) -> None:
    with open_recording(path) as recording:
        for topic in recording.topics():
            recording.times(topic.name)


@pytest.mark.parametrize(
    ("byte", "mask", "problem"),
    [
        (0, 1, "states another time than its message"),
        (5, 0x80, "states another time than its message"),
        (8, 1, "points at something else"),
        (15, 0x80, "points outside of its chunk"),
    ],
)
def test_one_wrong_bit_of_an_entry_is_refused_and_recovered(
    tmp_path: Path, byte: int, mask: int, problem: str
) -> None:
    path = tmp_path / "a.mcap"
    small.write_recording(path)
    read_all(path)
    data = bytearray(path.read_bytes())
    entry = index_of_frame_meta(data) + container.RECORD_HEAD + 2 + 4 + 16 * 3
    data[entry + byte] ^= mask
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=problem):
        read_all(path)
    report = recover(path, tmp_path / "b.mcap")
    assert not report.anything_lost
    read_all(tmp_path / "b.mcap")


def test_a_shortened_index_is_refused(tmp_path: Path) -> None:
    """A list that ends early would leave messages out without a word."""
    path = tmp_path / "a.mcap"
    small.write_recording(path)
    data = bytearray(path.read_bytes())
    at = index_of_frame_meta(data) + container.RECORD_HEAD + 2
    (size,) = struct.unpack_from("<I", data, at)
    struct.pack_into("<I", data, at, size - 16)
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="do not list as many messages"):
        read_all(path)


def test_an_entry_that_stands_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    small.write_recording(path)
    data = bytearray(path.read_bytes())
    at = index_of_frame_meta(data) + container.RECORD_HEAD + 6
    data[at : at + 16] = data[at + 16 : at + 32]
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="twice"):
        read_all(path)
