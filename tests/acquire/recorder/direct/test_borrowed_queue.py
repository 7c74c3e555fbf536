"""A recorder that borrows the frames' buffers.

Dropped frames are counted, accepted ones are in the file, and every buffer is released once.
"""

from __future__ import annotations

import errno
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader

from acquire.errors import RecorderError
from acquire.recorder.choose_recorder import choose_recorder
from acquire.recorder.direct import direct_file
from acquire.recorder.direct.backlog import backlog_memory
from acquire.recorder.direct.borrowed_queue import BATCH_FRAMES
from acquire.recorder.direct.direct_io import can_write_directly, write_pages
from acquire.recorder.disk_space import DiskSpace
from acquire.recorder.file_series import FileSeries, Rotation
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.recover.recover import recover
from acquire.recorder.window_recorder import META_WAIT_S
from schemas.proto import percuss_pb2 as pb
from schemas.rig import RecorderConfig
from tests.acquire.recorder.direct.counting_buffer import T0, CountingBuffer, frame_in, image_of
from tests.mcap_writer import McapWriter

WIDTH, HEIGHT = 331, 67
FORMAT = FrameFormat("main", WIDTH, HEIGHT, 100.0)
PERIOD_NS = 10_000_000


class Rig:
    """A continuous recorder that the test feeds with 100 frames per second."""

    def __init__(self, path: Path, rotate_bytes: int = 0) -> None:
        self.memory = backlog_memory(FORMAT, 200)
        self.path = path
        self.writer = FileSeries(
            path, lambda *_: None, Rotation(rotate_bytes), DiskSpace(path.parent, 0), self.memory
        )
        config = RecorderConfig(mode="continuous", pre_trigger_s=0.1)
        self.recorder = choose_recorder(self.writer, FORMAT, config, T0)
        self.buffers: list[CountingBuffer] = []

    @property
    def now_ns(self) -> int:
        return len(self.buffers) * PERIOD_NS + PERIOD_NS // 2

    def feed(self, count: int, lost: int = 0, *, replaceable: bool = True) -> None:
        for _ in range(count):
            buffer = CountingBuffer(image_of(WIDTH, HEIGHT, len(self.buffers) + 1), replaceable)
            self.buffers.append(buffer)
            number = len(self.buffers)
            mid = number * PERIOD_NS
            self.recorder.add(frame_in(buffer, number, mid, lost))

    def finish(self) -> tuple[list[int], list[pb.FrameMeta]]:
        """Sequence numbers of the images, and all meta, in file order; each image equals the borrowed one."""
        self.recorder.close()
        self.writer.finish()
        images: list[int] = []
        metas: list[pb.FrameMeta] = []
        for path in sorted(self.path.parent.glob("*.mcap"), key=lambda path: (len(path.name), path.name)):
            with path.open("rb") as file:
                for _, channel, message in make_reader(file, validate_crcs=True).iter_messages(
                    log_time_order=False
                ):
                    if channel.topic.endswith("image"):
                        images.append(message.sequence)
                        assert message.data.endswith(image_of(WIDTH, HEIGHT, message.sequence).tobytes())
                    else:
                        metas.append(pb.FrameMeta.FromString(message.data))
        assert {meta.sequence for meta in metas if meta.image_recorded} == set(images)
        return images, metas

    def check_given_back(self) -> None:
        assert [buffer.released for buffer in self.buffers] == [buffer.borrows for buffer in self.buffers]
        assert all(buffer.borrows <= 1 for buffer in self.buffers)
        assert self.memory.free == self.memory.blocks
        assert self.memory.used_bytes == 0


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    if not can_write_directly(tmp_path):
        pytest.skip("this file system takes no O_DIRECT")
    rig = Rig(tmp_path / "a.mcap")
    yield rig
    rig.recorder.close()
    rig.writer._writer.abort()
    rig.check_given_back()


def test_every_frame_is_in_the_file(rig: Rig) -> None:
    rig.feed(100)
    images, metas = rig.finish()
    assert images == [meta.sequence for meta in metas] == list(range(1, 101))
    assert (rig.recorder.frames, rig.recorder.dropped, rig.recorder.lost) == (100, 0, 0)
    assert all((meta.width, meta.height, meta.exposure_us) == (WIDTH, HEIGHT, 1500.0) for meta in metas)


def test_frames_that_cannot_be_borrowed_are_dropped_and_counted(rig: Rig) -> None:
    rig.feed(20)
    rig.feed(5, replaceable=False)
    rig.feed(20)
    assert rig.recorder.dropped == 5
    images, metas = rig.finish()
    assert images == [*range(1, 21), *range(26, 46)]
    assert [meta.sequence for meta in metas] == list(range(1, 46))


def test_windows_report_their_frames(rig: Rig) -> None:
    rig.feed(30)
    rig.recorder.open_window(rig.now_ns)
    rig.feed(10)
    rig.feed(2, replaceable=False)
    rig.feed(1, lost=3)
    rig.feed(8)
    report = rig.recorder.close_window(rig.now_ns - PERIOD_NS)
    assert (report.frames, report.lost) == (10 + 19, 2 + 3)
    with rig.writer._writer.part_path.open("rb") as file:
        there = file.read()
    assert image_of(WIDTH, HEIGHT, 51).tobytes() in there, "the window's last frame, when its report is given"
    images, _ = rig.finish()
    first, last = ((time_ns - T0) // PERIOD_NS for time_ns in (report.start_ns, report.end_ns))
    assert len([number for number in images if first <= number <= last]) == report.frames


def test_frames_go_to_the_file_though_no_more_come(rig: Rig) -> None:
    """Frames that wait for a full batch are written in the end if the camera sends no more."""
    rig.feed(BATCH_FRAMES // 2)
    end = time.monotonic() + 20.0
    while rig.recorder.waiting and time.monotonic() < end:
        time.sleep(0.01)
    assert rig.recorder.waiting == 0


def test_frames_wait_for_others_less_than_a_tenth_of_a_second(rig: Rig) -> None:
    """Waiting frames span less than 0.1 s of exposure times, even if fewer frames than a batch arrive."""
    for _ in range(50):
        rig.feed(1)
        assert rig.recorder.waiting * PERIOD_NS < 0.1 * META_WAIT_S * 4e9


def test_files_follow_each_other_without_a_gap(tmp_path: Path) -> None:
    if not can_write_directly(tmp_path):
        pytest.skip("this file system takes no O_DIRECT")
    rig = Rig(tmp_path / "a.mcap", rotate_bytes=1 << 20)
    end = time.monotonic() + 60.0
    while rig.writer.path.stem < "a-0004" and time.monotonic() < end:
        rig.feed(10)
        while rig.memory.used_bytes > 8 << 20:
            time.sleep(1e-3)
    images, metas = rig.finish()
    assert rig.writer.path.stem >= "a-0004"
    assert images == [meta.sequence for meta in metas] == list(range(1, len(rig.buffers) + 1))
    rig.check_given_back()


def test_a_failing_disk_releases_every_buffer_and_is_reported(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig.feed(24)
    rig.recorder.open_window(rig.now_ns)

    def broken(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(direct_file, "write_pages", broken)
    end = time.monotonic() + 20.0
    while rig.recorder.error is None and time.monotonic() < end:
        rig.feed(6)
        time.sleep(0.02)
    rig.feed(30)
    with pytest.raises(RecorderError, match="Input/output error"):
        rig.recorder.close_window(rig.now_ns - PERIOD_NS)
    rig.recorder.close()
    assert rig.recorder.dropped > 0
    with pytest.raises(RecorderError, match="Input/output error"):
        rig.writer.finish()
    rig.check_given_back()


def test_a_frame_that_arrives_during_close_is_released(rig: Rig) -> None:
    """The camera's thread is between the recorder and its queue when another thread closes both."""
    rig.feed(3)
    rig.recorder.close()
    rig.recorder._ending = False
    rig.feed(1)
    assert rig.recorder.waiting == 0
    rig.writer.finish()
    rig.feed(1)
    assert rig.recorder.waiting == 0
    assert [buffer.released for buffer in rig.buffers] == [1] * 5
    rig.recorder.close()


def test_a_stalled_disk_blocks_no_thread(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    go = threading.Event()

    def stuck(fd: int, views: list[memoryview], offset: int) -> None:
        go.wait(60)
        write_pages(fd, views, offset)

    monkeypatch.setattr(direct_file, "write_pages", stuck)
    begun = time.monotonic()
    rig.feed(200)  # as many as a camera has to borrow
    assert time.monotonic() - begun < 20.0
    assert rig.recorder.waiting < BATCH_FRAMES, "there is a place for all that may be kept"
    assert not any(buffer.released for buffer in rig.buffers[20:])
    go.set()
    images, metas = rig.finish()
    assert images == [meta.sequence for meta in metas] == list(range(1, 201))
    assert rig.recorder.dropped == 0


def test_what_a_killed_process_leaves_is_recovered(tmp_path: Path) -> None:
    if not can_write_directly(tmp_path):
        pytest.skip("this file system takes no O_DIRECT")
    rig = Rig(tmp_path / "a.mcap")
    rig.feed(40)
    rig.recorder.close()
    rig.writer.flush()
    data = rig.writer._writer.part_path.read_bytes()
    rig.writer._writer.abort()
    (tmp_path / "killed.part").write_bytes(data)
    report = recover(tmp_path / "killed.part", tmp_path / "b.mcap")
    assert not report.anything_damaged
    assert report.topics == {"/camera/main/image": 40, "/camera/main/meta": 40}
    rig.check_given_back()


def test_a_writer_through_the_page_cache_borrows_no_buffer(tmp_path: Path) -> None:
    """A recorder that writes through the page cache copies the images instead."""
    with McapWriter(tmp_path / "a.mcap") as writer:
        recorder = choose_recorder(writer, FORMAT, RecorderConfig(mode="continuous"), T0)
        buffer = CountingBuffer(image_of(WIDTH, HEIGHT, 1))
        recorder.add(frame_in(buffer, 1, PERIOD_NS))
        buffer.image[:] = 0xAA
        recorder.close()
    assert (buffer.borrows, buffer.released) == (0, 0)
    with (tmp_path / "a.mcap").open("rb") as file:
        [message] = [
            message
            for _, channel, message in make_reader(file).iter_messages()
            if channel.topic.endswith("image")
        ]
    assert message.data.endswith(image_of(WIDTH, HEIGHT, 1).tobytes())
