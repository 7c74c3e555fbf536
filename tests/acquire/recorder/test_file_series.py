"""A recording in several complete files without a loss between them; refusals on a full disk."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from acquire.errors import RecorderError
from acquire.recorder.choose_recorder import choose_recorder
from acquire.recorder.direct.block_memory import BlockMemory
from acquire.recorder.direct.direct_io import can_write_directly
from acquire.recorder.disk_space import DiskSpace
from acquire.recorder.file_series import FileSeries, Rotation
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.frame_recorder import FrameRecorder
from acquire.recorder.messages import SmallMessage
from acquire.recorder.writer import McapWriter
from schemas import topics
from schemas.rig import RecorderConfig
from tests.acquire.recorder.direct.counting_buffer import CountingBuffer, frame_in
from tests.places import ROOT

ANCHOR_NS = 1_700_000_000_000_000_000
PERIOD_NS = 10_000_000
FORMAT = FrameFormat("main", 128, 64, 100.0)
IMAGE = np.random.default_rng(1).integers(0, 256, (64, 128), dtype=np.uint8)


def _head(writer: McapWriter, part: int) -> None:
    writer.metadata("percuss.manifest", {"json": json.dumps({"part": part})})
    writer.attachment("plan.json", "application/json", b"plan")


def _series(
    path: Path, rotate_bytes: int, keep_files: int = 0, memory: BlockMemory | None = None
) -> FileSeries:
    return FileSeries(
        path, _head, Rotation(rotate_bytes, keep_files), DiskSpace(path.parent, 0, lambda _: 1 << 40), memory
    )


def _feed(recorder: FrameRecorder, numbers: range, lost: int = 0) -> None:
    for number in numbers:
        mid = number * PERIOD_NS
        recorder.add(frame_in(CountingBuffer(IMAGE), number, mid, lost))


def _settle(recorder: FrameRecorder, series: FileSeries) -> None:
    """Wait until all frames are written and no thread opens or finishes a file of the series.

    A camera leaves time for that between its frames; these tests feed frames without a pause.
    """
    while recorder.waiting:
        time.sleep(1e-3)
    while (rotation := series._rotation_thread) is not None and rotation.is_alive():
        rotation.join()


def _continuous(series: FileSeries) -> FrameRecorder:
    config = RecorderConfig(mode="continuous", pre_trigger_s=0.1)
    return choose_recorder(series, FORMAT, config, ANCHOR_NS)


@pytest.fixture(params=["page cache", "direct"])
def memory(request: pytest.FixtureRequest, tmp_path: Path) -> BlockMemory | None:
    if request.param == "direct":
        if not can_write_directly(tmp_path):
            pytest.skip("this file system takes no O_DIRECT")
        return BlockMemory(8 << 20)
    return None


@pytest.fixture
def series(tmp_path: Path, memory: BlockMemory | None) -> Iterator[FileSeries]:
    series = _series(tmp_path / "a.mcap", 200_000, memory=memory)
    yield series
    series._writer.abort()


def _read(path: Path) -> dict[str, list[int]]:
    """Sequence numbers of a file's messages, by topic, in file order; the checksums are verified."""
    found: dict[str, list[int]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for _, channel, message in reader.iter_messages(log_time_order=False):
            found.setdefault(channel.topic, []).append(message.sequence)
    return found


def _part(series: FileSeries) -> int:
    return int(series.path.stem.rpartition("-")[2])


def test_no_message_is_lost_between_files_and_each_is_whole(tmp_path: Path, series: FileSeries) -> None:
    recorder = _continuous(series)
    striker = series.add_topic(topics.STRIKER_SAMPLE)
    for start in range(1, 201, 20):
        _feed(recorder, range(start, start + 20))
        for number in range(start, start + 20):
            series.write_small(striker, [SmallMessage(ANCHOR_NS + number * PERIOD_NS, b"\x18\x01", number)])
        _settle(recorder, series)
    recorder.close()
    series.finish()
    files = sorted(tmp_path.iterdir())
    names = [path.name for path in files]
    assert names == sorted(["a.mcap", *(f"a-{part:04d}.mcap" for part in range(2, _part(series) + 1))])
    assert _part(series) >= 4
    ordered = [tmp_path / "a.mcap", *(path for path in files if path.name != "a.mcap")]
    contents = [_read(path) for path in ordered]
    for topic in ("/camera/main/image", "/camera/main/meta", "/striker/sample"):
        assert list(itertools.chain.from_iterable(content.get(topic, []) for content in contents)) == list(
            range(1, 201)
        )
    for part, (path, content) in enumerate(zip(ordered, contents, strict=True), 1):
        assert content["/camera/main/image"] == content["/camera/main/meta"]
        with path.open("rb") as file:
            reader = make_reader(file)
            metadata = {entry.name: entry.metadata for entry in reader.iter_metadata()}
            assert [attachment.data for attachment in reader.iter_attachments()] == [b"plan"]
        assert json.loads(metadata["percuss.manifest"]["json"]) == {"part": part}
        assert "content_id" in metadata["percuss.seal"]
    assert max(path.stat().st_size for path in files) < 200_000 + 2 * 32 * IMAGE.size + 20_000


def test_a_window_of_a_continuous_recording_counts_earlier_frames(series: FileSeries) -> None:
    recorder = _continuous(series)
    _feed(recorder, range(1, 51))
    start = recorder.open_window(505_000_000)
    _feed(recorder, range(51, 61))
    _feed(recorder, range(62, 71), lost=1)
    report = recorder.close_window(705_000_000 - PERIOD_NS)
    recorder.close()
    assert start == ANCHOR_NS + 405_000_000
    assert (report.frames, report.lost) == (10 + 10 + 9, 9)
    assert (report.start_ns, report.end_ns) == (ANCHOR_NS + 410_000_000, ANCHOR_NS + 700_000_000)


def test_a_ring_keeps_the_newest_files(tmp_path: Path, memory: BlockMemory | None) -> None:
    series = _series(tmp_path / "a.mcap", 100_000, keep_files=3, memory=memory)
    recorder = _continuous(series)
    for start in range(1, 201, 20):
        _feed(recorder, range(start, start + 20))
        _settle(recorder, series)
    recorder.close()
    series.finish()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"a-{part:04d}.mcap" for part in range(_part(series) - 2, _part(series) + 1)]
    last = [number for name in names for number in _read(tmp_path / name)["/camera/main/image"]]
    assert last == list(range(last[0], 201))


def test_without_room_for_another_file_the_last_one_is_finished(
    tmp_path: Path, memory: BlockMemory | None
) -> None:
    free = [1 << 40]
    series = FileSeries(
        tmp_path / "a.mcap", _head, Rotation(100_000), DiskSpace(tmp_path, 50_000, lambda _: free[0]), memory
    )
    recorder = _continuous(series)
    free[0] = 149_999
    for start in range(1, 41, 10):
        _feed(recorder, range(start, start + 10))
        _settle(recorder, series)
    recorder.close()
    assert recorder.error is not None
    assert "recording a-0002.mcap needs 0.10 MB and 0.05 MB are kept back" in str(recorder.error)
    assert recorder.dropped > 0
    series.finish()
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]
    content = _read(tmp_path / "a.mcap")
    assert content["/camera/main/image"] == list(range(1, 41 - recorder.dropped))
    assert content["/camera/main/meta"] == list(range(1, 41))


def test_missing_space_is_reported_with_its_purpose(tmp_path: Path) -> None:
    disk = DiskSpace(tmp_path, 1 << 30, lambda _: 3 << 30)
    disk.require(2 << 30, "a window")
    with pytest.raises(
        RecorderError,
        match=r"a window needs 2\.15 GB and 1\.07 GB are kept back .* only 3\.22 GB are free .* free some "
        r"space$",
    ):
        disk.require((2 << 30) + 1, "a window")
    with pytest.raises(RecorderError, match="create the folder first"):
        DiskSpace(tmp_path / "missing", 0).require(0, "a window")


def fill(folder: Path) -> None:
    """Record in `folder` until its disk is full and beyond, finish, read back, print the result (JSON).

    Runs in a separate process.
    """
    series = FileSeries(folder / "a.mcap", _head, Rotation(), DiskSpace(folder, 0))
    config = RecorderConfig(pre_trigger_s=0.0, preview_hz=0.0, max_window_s=60.0)
    recorder = choose_recorder(series, FORMAT, config, ANCHOR_NS)
    _feed(recorder, range(1, 11))
    recorder.open_window(105_000_000)
    for start in range(11, 4011, 50):
        _feed(recorder, range(start, start + 50))
        while recorder.waiting:
            time.sleep(1e-3)
    with pytest.raises(RecorderError) as refused:
        recorder.close_window(40_005_000_000)
    recorder.close()
    content = _read(series.finish().path)
    result = {
        "said": str(refused.value),
        "images": content["/camera/main/image"],
        "meta": content["/camera/main/meta"],
        "dropped": recorder.dropped,
        "left": [path.name for path in folder.iterdir()],
    }
    sys.stdout.write(json.dumps(result))


def test_a_disk_that_fills_up_in_a_window_leaves_a_whole_recording(tmp_path: Path) -> None:
    """The recording is made on a real file system of 20 MB, mounted for one process alone."""
    mount = 'mount -t tmpfs -o size=20m none "$1" 2>/dev/null || exit 77; shift; exec "$@"'
    code = (
        "import sys, pathlib; from tests.acquire.recorder.test_file_series import fill; "
        "fill(pathlib.Path(sys.argv[1]))"
    )
    command = [
        "unshare",
        "-rm",
        "sh",
        "-c",
        mount,
        "sh",
        str(tmp_path),
        sys.executable,
        "-c",
        code,
        str(tmp_path),
    ]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)
    except FileNotFoundError:
        pytest.skip("no unshare on this machine")
    if done.returncode == 77 or "unshare" in done.stderr:
        pytest.skip("no mount namespaces on this machine")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert "No space left on device: free space on this disk, finish, and start a new one" in result["said"]
    assert result["left"] == ["a.mcap"]
    images = result["images"]
    # 8 MB are held back for meta and summary; the rest is images, without a gap until the space ran out.
    assert images == list(range(11, 11 + len(images)))
    assert len(images) * IMAGE.size > 10e6
    assert len(images) + result["dropped"] == 4000
    assert result["meta"] == list(range(1, 4011))
