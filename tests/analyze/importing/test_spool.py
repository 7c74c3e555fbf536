"""Stored images equal those of the source, which is read once."""

from __future__ import annotations

import errno
from collections import Counter, namedtuple
from contextlib import closing

import numpy as np
import pytest

from analyze.importing import spool as module
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.spool import Spool
from analyze.importing.write_recording import write_recording
from analyze.reading.recording import open_recording
from analyze.sources.source import TimedImage
from analyze.sources.video import VideoSource
from schemas.output_file import OutputError
from tests.analyze.importing.tip_videos import setting, tip, write_video

WIDTH, HEIGHT, STEP_NS = 8, 6, 10_000_000
Usage = namedtuple("Usage", "free")


class Numbered:
    """Source of numbered images that counts reads and reuses one image's memory for the next."""

    width, height, rate_hz = WIDTH, HEIGHT, 1e9 / STEP_NS

    def __init__(self, count=1000):
        self.count, self.read = count, Counter()

    def frames(self, start_ns=None, end_ns=None):
        image = np.empty((HEIGHT, WIDTH + 2), np.uint8)[:, :WIDTH]
        for number in range(self.count):
            if (start_ns is None or number * STEP_NS >= start_ns) and (
                end_ns is None or number * STEP_NS <= end_ns
            ):
                self.read[number] += 1
                image[:] = number % 251
                yield TimedImage(number * STEP_NS, image)


def passed(source, folder, windows):
    """Store of images (spool) after the source was searched.

    Args:
        source: source of numbered images.
        folder: folder for the images.
        windows: number of the image after which a window is known, its first and its last image.
    """
    spool = Spool(source, folder)
    for number, frame in enumerate(source.frames()):
        spool.add(frame)
        for known, first, last in windows:
            if known == number:
                spool.keep(first * STEP_NS, last * STEP_NS)
    source.read.clear()
    return spool


def numbers(spool, first, last):
    found = [
        (frame.time_ns // STEP_NS, frame.image.copy())
        for frame in spool.frames(first * STEP_NS, last * STEP_NS)
    ]
    assert all(np.all(image == number % 251) for number, image in found)
    return [number for number, _ in found]


def test_stored_windows_are_not_decoded_again(tmp_path):
    source = Numbered()
    windows = [(120, 60, 300), (290, 250, 500), (700, 640, 5000)]
    with closing(passed(source, tmp_path, windows)) as spool:
        assert numbers(spool, 60, 200) == list(range(60, 201))
        assert numbers(spool, 250, 500) == list(range(250, 501))
        assert numbers(spool, 700, 999) == list(range(700, 1000))
        assert not source.read
        assert numbers(spool, 10, 20) == list(range(10, 21))
        assert sum(source.read.values()) == 11
    assert list(tmp_path.iterdir()) == []


def test_images_that_memory_could_not_hold_are_decoded_again(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MAX_HELD_BYTES", 29 * WIDTH * HEIGHT)
    source = Numbered()
    with closing(passed(source, tmp_path, [(120, 60, 300)])) as spool:
        assert numbers(spool, 60, 300) == list(range(60, 301))
        assert sorted(source.read) == list(range(60, 91))


def test_nothing_is_stored_without_room_for_the_recording(tmp_path, monkeypatch):
    source = Numbered()
    monkeypatch.setattr(module.shutil, "disk_usage", lambda _: Usage(480 * WIDTH * HEIGHT))
    with closing(passed(source, tmp_path, [(120, 60, 300)])) as spool:
        assert numbers(spool, 60, 300) == list(range(60, 301))
        assert sum(source.read.values()) == 241


def test_disk_that_fills_up_loses_that_window_only(tmp_path, monkeypatch):
    source, real, written = Numbered(), module.os.pwrite, []

    def full(fd, data, at):
        written.append(at)
        if len(written) > 300:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(fd, data, at)

    monkeypatch.setattr(module.os, "pwrite", full)
    with closing(passed(source, tmp_path, [(120, 60, 300), (520, 500, 800)])) as spool:
        assert numbers(spool, 60, 300) == list(range(60, 301))
        assert not source.read
        assert numbers(spool, 500, 800) == list(range(500, 801))
        assert sum(source.read.values()) == 301


def test_full_disk_is_reported_before_the_search(tmp_path, monkeypatch):
    path = write_video(tmp_path / "a.mp4", tip()[:5])
    monkeypatch.setattr(module.shutil, "disk_usage", lambda _: Usage(1000))
    monkeypatch.setattr(VideoSource, "frames", lambda *_: pytest.fail("it is looked through"))
    with pytest.raises(OutputError, match="has 0 MB free, the recording needs"):
        prepare(ImportOptions((path,), *setting(tmp_path), aside=tmp_path))


def test_video_that_is_split_is_decoded_once(tmp_path, monkeypatch):
    """Finding strikes, estimating the camera pose and writing share one pass of decoding."""
    gone = [np.full_like(tip()[0], 120)] * 90
    path = write_video(
        tmp_path / "a.mkv", [*[tip()[0]] * 90, *tip(), *gone, *tip()], codec="ffv1", pixels="gray"
    )
    read, frames = Counter(), VideoSource.frames

    def counted(self, start_ns=None, end_ns=None):
        for frame in frames(self, start_ns, end_ns):
            read[frame.time_ns] += 1
            yield frame

    def images(aside):
        output = tmp_path / f"{aside is None}.mcap"
        with prepare(
            ImportOptions((path,), *setting(tmp_path, ("s1", "s2"), placed=False), aside=aside)
        ) as prepared:
            write_recording(prepared, output)
        with open_recording(output) as recording:
            return [(frame.time_ns, frame.image.copy()) for frame in recording.images()]

    expected = images(None)
    monkeypatch.setattr(VideoSource, "frames", counted)
    found = images(tmp_path)
    assert set(read.values()) == {1}
    assert [time_ns for time_ns, _ in found] == [time_ns for time_ns, _ in expected]
    assert all(np.array_equal(one[1], other[1]) for one, other in zip(found, expected, strict=True))
