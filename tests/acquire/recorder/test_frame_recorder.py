"""Recorded frames: previews, windows with their pre-trigger time, and losses on a slow or full disk."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from acquire.errors import RecorderError
from acquire.recorder.choose_recorder import choose_recorder
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.window_recorder import META_WAIT_S
from acquire.recorder.writer import McapWriter
from schemas.proto import percuss_pb2 as pb
from schemas.rig import RecorderConfig
from tests.acquire.recorder.direct.counting_buffer import CountingBuffer, frame_in

ANCHOR_NS = 1_700_000_000_000_000_000
PERIOD_NS = 10_000_000
BUFFER = CountingBuffer(np.zeros((8, 16), np.uint8))


class Rig:
    """A recorder that the test feeds with 100 frames per second."""

    def __init__(self, path: Path, **config: object) -> None:
        self.path = path
        self.writer = McapWriter(path)
        settings = {"pre_trigger_s": 0.1, "preview_hz": 5.0, **config}
        frames = FrameFormat("main", 16, 8, 100.0)
        self.recorder = choose_recorder(
            self.writer, frames, RecorderConfig.model_validate(settings), ANCHOR_NS
        )
        self.next = 1

    @property
    def now_ns(self) -> int:
        return (self.next - 1) * PERIOD_NS + PERIOD_NS // 2

    def feed(self, count: int, lost: int = 0) -> None:
        for _ in range(count):
            self.next += lost
            mid = self.next * PERIOD_NS
            self.recorder.add(frame_in(BUFFER, self.next, mid, lost))
            self.next += 1
            lost = 0

    def settle(self) -> None:
        """Wait until everything that is due is handed to the writer."""
        self.recorder._path.wait_until_written(10.0)

    def finish(self) -> tuple[list[int], list[pb.FrameMeta]]:
        """Sequence numbers of the images, and all meta, in the order of the file."""
        self.recorder.close()
        self.writer.finish()
        images, metas = [], []
        with self.path.open("rb") as file:
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
                if channel.topic.endswith("image"):
                    images.append(message.sequence)
                else:
                    metas.append(pb.FrameMeta.FromString(message.data))
        assert {meta.sequence for meta in metas if meta.image_recorded} == set(images)
        return images, metas


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    rig = Rig(tmp_path / "a.mcap")
    yield rig
    rig.recorder.close()
    rig.writer.abort()


def test_outside_windows_there_are_previews_and_every_meta(rig: Rig) -> None:
    rig.feed(100)
    images, metas = rig.finish()
    assert images == [1, 21, 41, 61, 81]
    assert [meta.sequence for meta in metas] == list(range(1, 101))


def test_a_window_reaches_back_and_ends_when_it_is_closed(rig: Rig) -> None:
    rig.feed(50)
    assert rig.recorder.open_window(rig.now_ns) == ANCHOR_NS + rig.now_ns - 100_000_000
    with pytest.raises(RecorderError, match="open already"):
        rig.recorder.open_window(rig.now_ns)
    rig.feed(20)
    closing = threading.Thread(
        target=lambda now: reports.append(rig.recorder.close_window(now)), args=(rig.now_ns + 30_000_000,)
    )
    reports: list = []
    closing.start()
    rig.feed(5)
    closing.join()
    rig.feed(30)
    images, metas = rig.finish()
    report = reports[0]
    first, last = ((time - ANCHOR_NS) // PERIOD_NS for time in (report.start_ns, report.end_ns))
    assert first == 41
    assert 70 <= last <= 73
    assert [number for number in images if first <= number <= last] == list(range(first, last + 1))
    assert (report.frames, report.lost) == (last - first + 1, 0)
    assert images == sorted(images)
    assert len(metas) == 105


@pytest.mark.parametrize("pre_trigger_s", [0.1, 0.25, 3.0])
def test_meta_and_previews_never_wait_longer_than_a_quarter_second(
    tmp_path: Path, pre_trigger_s: float
) -> None:
    """Meta and previews reach the writer within META_WAIT_S (0.25 s), so that a kill loses no more.

    The writer may hold them for another 0.1 s.
    """
    rig = Rig(tmp_path / "a.mcap", pre_trigger_s=pre_trigger_s)
    written: dict[str, list[int]] = {"/camera/main/image": [], "/camera/main/meta": []}

    def noting(write):
        def noted(channel, messages) -> None:
            written[channel.topic.name].extend(message.sequence for message in messages)
            write(channel, messages)

        return noted

    for name in ("write_small", "write_images"):
        setattr(rig.writer, name, noting(getattr(rig.writer, name)))
    rig.feed(400)
    rig.settle()
    waits = int(min(pre_trigger_s, META_WAIT_S) * 100)
    assert written["/camera/main/meta"] == list(range(1, 400 - waits))
    assert written["/camera/main/image"] == list(range(1, 400 - waits, 20))
    rig.recorder.open_window(rig.now_ns)
    rig.settle()
    assert written["/camera/main/meta"] == list(range(1, 401))
    reaches = int(pre_trigger_s * 100)
    assert set(range(401 - reaches, 401)) <= set(written["/camera/main/image"])
    rig.feed(20)
    report = rig.recorder.close_window(rig.now_ns - PERIOD_NS)
    assert (report.frames, report.lost) == (reaches + 20, 0)
    rig.recorder.close()
    rig.writer.finish()
    with rig.path.open("rb") as file:
        images = [
            message.sequence
            for _, _, message in make_reader(file).iter_messages(topics=["/camera/main/image"])
        ]
    assert images == sorted(set(written["/camera/main/image"])), "in the order of their times, none twice"


def test_loss_counts_in_the_window_it_fell_into(rig: Rig) -> None:
    rig.feed(30)
    rig.feed(20, lost=7)  # before the window's first frame
    rig.feed(3, lost=2)  # in the delay line
    rig.recorder.open_window(rig.now_ns)
    rig.feed(10, lost=4)
    rig.feed(1)
    report = rig.recorder.close_window(rig.now_ns)
    assert report.lost == 2 + 4
    assert rig.recorder.lost == 7 + 2 + 4
    with pytest.raises(RecorderError, match="no window"):
        rig.recorder.close_window(rig.now_ns)


def test_frames_of_a_silent_camera_count_as_lost(rig: Rig) -> None:
    rig.feed(30)
    rig.recorder.open_window(rig.now_ns)
    rig.feed(10)
    report = rig.recorder.close_window(rig.now_ns + 50 * PERIOD_NS)
    assert report.frames == 10 + 10
    assert report.lost == pytest.approx(50, abs=1)


def test_a_window_does_not_wait_for_images_after_its_end(rig: Rig) -> None:
    rig.feed(30)
    rig.recorder.open_window(rig.now_ns)
    rig.feed(10)
    late_ns = rig.now_ns + 50 * PERIOD_NS  # the camera is half a second behind
    report = rig.recorder.close_window(late_ns, ANCHOR_NS + rig.now_ns - 2 * PERIOD_NS)
    assert (report.frames, report.lost) == (10 + 10, 0)


def test_a_window_that_is_never_closed_ends_at_its_limit(tmp_path: Path) -> None:
    rig = Rig(tmp_path / "a.mcap", max_window_s=0.5, preview_hz=0.0)
    rig.feed(20)
    rig.recorder.open_window(rig.now_ns)
    rig.feed(200)
    report = rig.recorder.close_window(rig.now_ns)
    images, metas = rig.finish()
    assert (report.frames, report.lost) == (60, 0)
    assert images == list(range(11, 71))
    assert len(metas) == 220


def test_a_stalled_disk_drops_and_counts_images_but_no_meta(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(tmp_path / "a.mcap", max_window_s=60.0)
    go, write = threading.Event(), rig.writer.write_images

    def slow(*arguments: object) -> None:
        go.wait(30)
        write(*arguments)

    monkeypatch.setattr(rig.writer, "write_images", slow)
    rig.recorder.open_window(rig.now_ns)
    rig.feed(500)  # there is room for 2.1 s of images
    go.set()
    report = rig.recorder.close_window(rig.now_ns)
    images, metas = rig.finish()
    assert report.frames + report.lost == 500
    assert len(images) == report.frames == pytest.approx(212, abs=3)
    assert rig.recorder.dropped == report.lost
    assert [meta.sequence for meta in metas] == list(range(1, 501))


def test_a_failing_disk_is_reported_by_close_window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(tmp_path / "a.mcap")
    rig.recorder.open_window(rig.now_ns)
    rig.feed(10)

    def full(*_: object, **__: object) -> None:
        raise RecorderError("a.mcap.part: cannot be written: No space left on device")

    monkeypatch.setattr(rig.writer, "write_images", full)
    rig.feed(10)
    with pytest.raises(RecorderError, match="No space left"):
        rig.recorder.close_window(rig.now_ns)
    with pytest.raises(RecorderError, match="No space left"):
        rig.recorder.open_window(rig.now_ns)
    monkeypatch.undo()
    images, _ = rig.finish()
    assert images == list(range(1, len(images) + 1))
    assert rig.recorder.dropped >= 1


def test_png_is_written_on_request(tmp_path: Path) -> None:
    rig = Rig(tmp_path / "a.mcap", image_format="png")
    rig.feed(100)
    assert rig.finish()[0] == [1, 21, 41, 61, 81]
    with (tmp_path / "a.mcap").open("rb") as file:
        schema, _, _ = next(make_reader(file).iter_messages(topics=["/camera/main/image"]))
    assert schema is not None
    assert schema.name == "foxglove.CompressedImage"
