"""Test videos are read; a damaged one fails the check of the frames instead of ending `acquire check`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquire.errors import RecorderError
from acquire.preflight.check import Outcome
from acquire.preflight.read_video import read_video
from acquire.preflight.session import LINES
from acquire.preflight.video import CheckVideo
from schemas import topics
from tests import small_recording as small
from tests.acquire.preflight.bench import Bench, FakeVideoSource
from tests.mcap_writer import McapWriter


def _with_damaged_chunk(path: Path) -> Path:
    small.write_recording(path)
    data = bytearray(path.read_bytes())
    data[data.find(small.image(5).tobytes()) + 9] ^= 4
    path.write_bytes(data)
    return path


def _with_message(path: Path, topic: topics.Topic, message: bytes) -> Path:
    """Recording whose last message on `topic` is `message`, in an intact chunk."""
    writer = McapWriter(path)
    small.write_head(writer)
    small.write_body(writer)
    writer.write(writer.add_topic(topic), small.frame_time(small.FRAMES), message)
    writer.finish()
    return path


def test_last_image_and_clock_are_read(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    content = read_video(tmp_path / "a.mcap", "main")
    assert np.array_equal(content.image, small.image(small.FRAMES - 1))
    assert (content.clock_samples, content.mapping_sd_ns) == (2, 20_000)


def test_damaged_chunk_is_refused_with_a_remedy(tmp_path: Path) -> None:
    path = _with_damaged_chunk(tmp_path / "a.mcap")
    with pytest.raises(RecorderError, match=r"a\.mcap: the test video is damaged: chunk .*: check the disk"):
        read_video(path, "main")


@pytest.mark.parametrize("topic", [topics.raw_image("main"), topics.frame_meta("main"), topics.CLOCK_SAMPLE])
def test_message_that_is_no_protobuf_is_refused(tmp_path: Path, topic: topics.Topic) -> None:
    path = _with_message(tmp_path / "a.mcap", topic, b"\xff" * 30)
    with pytest.raises(RecorderError, match=r"a\.mcap: the test video"):
        read_video(path, "main")


def test_damaged_video_fails_the_check_of_the_frames(bench: Bench, tmp_path: Path) -> None:
    path = _with_damaged_chunk(tmp_path / "a.mcap")

    class Damaged(FakeVideoSource):
        def record(self, folder: Path) -> CheckVideo:
            read_video(path, "main")
            raise AssertionError("the damage was not noticed")

    bench.source = Damaged()
    lines = bench.lines()
    assert tuple(lines) == LINES
    assert {name for name, line in lines.items() if line.outcome is Outcome.FAIL} == {"frames"}
    assert lines["frames"].remedy.startswith("check the disk")
    assert lines["marker"].outcome is Outcome.NOT_CHECKED
    assert bench.source.closed == 1
