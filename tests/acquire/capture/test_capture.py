"""The capture process with a synthetic camera behind it: windows, pre-trigger, previews, loss, endings."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap.reader import make_reader

from acquire.capture.link import BATCH_LIMIT_BYTES, CaptureProcess
from acquire.errors import CameraNotFound, RecorderError
from schemas.proto import percuss_pb2 as pb
from schemas.rig import CameraConfig, RecorderConfig, RigConfig
from schemas.session_manifest import SessionManifest
from schemas.wording import counted
from tests.acquire.capture.synthetic_rig import (
    CALIBRATION,
    COMMAND,
    RATE,
    check_times,
    frame_number,
    manifest_of_a_box,
    read,
    rig,
)
from tests.loopback import loopback
from tests.places import PATTERN_CAMERA


def test_a_window_holds_every_frame_from_before_it_opened(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    capture = CaptureProcess(rig(preview_hz=10.0), COMMAND)
    info = capture.start()
    try:
        assert info.model == "Synthetic"
        manifest = manifest_of_a_box()
        capture.open_recording(
            tmp_path / "a.mcap",
            manifest,
            [("plan.json", "application/json", b"plan"), ("object.toml", "application/toml", b"o")],
        )
        time.sleep(0.8)
        asked = manifest.wall_anchor_ns + time.monotonic_ns()
        start = capture.open_window()
        time.sleep(0.5)
        report = capture.close_window()
        time.sleep(0.4)
        status = capture.status()
        assert status.recording == tmp_path / "a.mcap"
        assert status.fps == pytest.approx(RATE, rel=0.02)
        assert (status.lost, status.dropped, status.error) == (0, 0, "")
        assert status.last_frame_age_s is not None
        assert status.last_frame_age_s < 0.1
        done = capture.close_recording()
    finally:
        capture.stop()
    assert start == pytest.approx(asked - 0.25e9, abs=0.05e9)
    found = read(tmp_path / "a.mcap")
    images, metas = (
        found["/camera/main/image"],
        [pb.FrameMeta.FromString(m.data) for m in found["/camera/main/meta"]],
    )

    inside = [m for m in images if report.start_ns <= m.log_time <= report.end_ns]
    assert len(inside) == report.frames
    assert report.lost == 0
    assert np.all(np.diff([frame_number(m) for m in inside]) == 1)
    assert report.start_ns - start == pytest.approx(0, abs=1e9 / RATE)
    assert (report.end_ns - report.start_ns) * 1e-9 == pytest.approx(0.75, abs=0.06)

    before = [m.log_time for m in images if m.log_time < report.start_ns]
    assert np.all(np.diff(before) > 0.09e9)
    assert len(before) >= 2
    assert any(m.log_time > report.end_ns for m in images)

    # Every frame has its meta, in order; it says truly whether the image is there, and all share the
    # sequence.
    assert np.all(np.diff([meta.sequence for meta in metas]) == 1)
    assert {meta.sequence for meta in metas if meta.image_recorded} == {m.sequence for m in images}
    assert [m.sequence for m in found["/camera/main/meta"]] == [meta.sequence for meta in metas]
    assert np.all(np.diff([m.log_time for m in images]) > 0)
    assert done.frames == len(metas)
    check_times(found["/camera/main/meta"], manifest.wall_anchor_ns)
    clocks = [pb.ClockSample.FromString(m.data) for m in found["/clock/sample"]]
    assert len(clocks) >= 3
    assert {sample.clock for sample in clocks} == {"camera/main"}
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file)
        assert [(a.name, a.data) for a in reader.iter_attachments()] == [
            ("plan.json", b"plan"),
            ("object.toml", b"o"),
        ]
        names = {m.name: m.metadata for m in reader.iter_metadata()}
    assert SessionManifest.model_validate_json(names["percuss.manifest"]["json"]) == manifest
    assert names["percuss.seal"]["content_id"] == done.content_id


def test_a_continuous_recording_of_the_cameras_own_buffers(
    tmp_path: Path, environment: pytest.MonkeyPatch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every frame is recorded unchanged, though its buffer is reused, the camera is lost and files change."""
    monkeypatch.setenv("CAMERA_FAULTS", "die:120,lose:50")
    capture = CaptureProcess(rig(large=True, mode="continuous", rotate_bytes=500_000), COMMAND)
    capture.start()
    try:
        capture.open_recording(tmp_path / "a.mcap", manifest_of_a_box(), [])
        time.sleep(0.3)
        start = capture.open_window()
        time.sleep(1.0)
        report = capture.close_window()
        time.sleep(1.5)
        status = capture.status()
        done = capture.close_recording()
    finally:
        capture.stop()
    assert (status.dropped, status.error) == (0, "")
    images: list = []
    metas: list[pb.FrameMeta] = []
    files = sorted(tmp_path.iterdir(), key=lambda path: (len(path.name), path.name))
    assert len(files) >= 3
    for path in files:
        found = read(path)
        images += found.get("/camera/main/image", [])
        metas += [pb.FrameMeta.FromString(message.data) for message in found.get("/camera/main/meta", [])]
    assert (
        [meta.sequence for meta in metas]
        == [image.sequence for image in images]
        == list(range(metas[0].sequence, metas[-1].sequence + 1))
    )
    assert all(meta.image_recorded for meta in metas)
    numbers = [frame_number(image) for image in images]
    runs = [later - earlier for earlier, later in pairwise(numbers)]
    assert sum(step not in {1, 2} for step in runs) == 1, (
        "numbers begin again once, where the camera came back"
    )
    assert sum(step == 2 for step in runs) >= 2
    assert done.lost == sum(meta.frames_lost_before for meta in metas)
    inside = [image for image in images if report.start_ns <= image.log_time <= report.end_ns]
    assert len(inside) == report.frames
    assert report.start_ns >= start


def test_small_topics_arrive_in_order_and_complete(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    capture = CaptureProcess(rig(), COMMAND)
    capture.start()
    try:
        manifest = manifest_of_a_box()
        capture.open_recording(tmp_path / "a.mcap", manifest, [])
        for number in range(3000):
            capture.write(
                "/striker/sample",
                manifest.wall_anchor_ns + time.monotonic_ns(),
                pb.StrikerSample(tick_ms=number).SerializeToString(),
            )
        with pytest.raises(RecorderError, match="/camera/main/image"):
            capture.write("/camera/main/image", 1, b"")
        capture.close_recording()
        assert capture.status().recording is None
    finally:
        capture.stop()
    found = read(tmp_path / "a.mcap")
    assert [pb.StrikerSample.FromString(m.data).tick_ms for m in found["/striker/sample"]] == list(
        range(3000)
    )
    assert [m.sequence for m in found["/striker/sample"]] == list(range(3000))


def test_a_process_that_does_not_read_takes_no_more_than_it_can(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    capture = CaptureProcess(rig(), COMMAND)
    capture.start()
    try:
        capture.open_recording(tmp_path / "a.mcap", manifest_of_a_box(), [])
        pid = capture._process.pid  # type: ignore[union-attr]
        os.kill(pid, signal.SIGSTOP)
        taken = 0
        while capture.write("/log", 1, b" " * (1 << 16)) and taken < 2000:
            taken += 1
        os.kill(pid, signal.SIGCONT)
        assert BATCH_LIMIT_BYTES >> 16 <= taken < 2000
        end = time.monotonic() + 10
        while not capture.write("/log", 2, b"later") and time.monotonic() < end:
            time.sleep(0.05)
        capture.close_recording()
    finally:
        capture.stop()
    assert len(read(tmp_path / "a.mcap")["/log"]) == taken + 1


def test_lost_frames_are_counted_where_they_were_lost(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    environment.setenv("CAMERA_FAULTS", "lose:20")
    capture = CaptureProcess(rig(), COMMAND)
    capture.start()
    try:
        capture.open_recording(tmp_path / "a.mcap", manifest_of_a_box(), [])
        time.sleep(0.4)
        capture.open_window()
        time.sleep(0.5)
        report = capture.close_window()
        capture.close_recording()
    finally:
        capture.stop()
    found = read(tmp_path / "a.mcap")
    images = [m for m in found["/camera/main/image"] if report.start_ns <= m.log_time <= report.end_ns]
    numbers = [frame_number(m) for m in images]
    assert report.lost == numbers[-1] - numbers[0] + 1 - len(numbers)
    assert report.lost >= 3
    assert re.fullmatch(
        r"\d+ frames? lost before frame \d+, \d+ in all", Log.FromString(found["/log"][0].data).message
    )


def test_a_lost_camera_comes_back_into_the_same_recording(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    environment.setenv("CAMERA_FAULTS", "die:60")
    capture = CaptureProcess(rig(), COMMAND)
    capture.start()
    try:
        capture.open_recording(tmp_path / "a.mcap", manifest_of_a_box(), [])
        deadline = time.monotonic() + 10
        seen_lost = False
        while time.monotonic() < deadline:
            status = capture.status()
            if not status.connected:
                seen_lost = True
                assert "camera lost" in status.error
            elif seen_lost and status.frames > 80:
                break
            time.sleep(0.02)
        assert seen_lost
        assert capture.status().error == ""
        capture.open_window()
        time.sleep(0.2)
        assert capture.close_window().lost == 0
        done = capture.close_recording()
    finally:
        capture.stop()
    found = read(tmp_path / "a.mcap")
    metas = [pb.FrameMeta.FromString(m.data) for m in found["/camera/main/meta"]]
    gap = max(meta.frames_lost_before for meta in metas)
    after = next(n for n, meta in enumerate(metas) if meta.frames_lost_before == gap)
    away_s = (metas[after].mid_exposure_host_ns - metas[after - 1].mid_exposure_host_ns) * 1e-9
    assert away_s > 0.5  # the retry time
    assert gap == round(away_s * RATE) - 1
    assert done.lost == gap
    assert np.all(np.diff([meta.sequence for meta in metas]) == 1)
    assert [Log.FromString(m.data).message.split(":")[0] for m in found["/log"]] == [
        "camera lost",
        "camera is back",
        f"{counted(gap, 'frame')} lost before frame {metas[after].sequence + 1}, {gap} in all",
    ]


def test_an_absent_camera_is_one_line_and_leaves_no_process(environment: pytest.MonkeyPatch) -> None:
    capture = CaptureProcess(rig("absent"), COMMAND)
    with pytest.raises(CameraNotFound, match="nothing answers"):
        capture.start()
    capture.stop()


def test_a_taken_path_and_a_full_disk_are_refused_without_a_trace(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.mcap").write_bytes(b"mine")
    capture = CaptureProcess(rig(disk_reserve_bytes=1 << 50), COMMAND)
    capture.start()
    try:
        with pytest.raises(RecorderError, match=r"recording b\.mcap needs .* free some space"):
            capture.open_recording(tmp_path / "b.mcap", manifest_of_a_box(), [])
    finally:
        capture.stop()
    capture = CaptureProcess(rig(), COMMAND)
    capture.start()
    try:
        with pytest.raises(RecorderError, match="exists already"):
            capture.open_recording(tmp_path / "a.mcap", manifest_of_a_box(), [])
        with pytest.raises(RecorderError, match="no recording is open"):
            capture.open_window()
        with pytest.raises(RecorderError, match="create the folder"):
            capture.open_recording(tmp_path / "missing" / "a.mcap", manifest_of_a_box(), [])
    finally:
        capture.stop()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap"]


def test_a_window_without_room_is_refused_before_the_striker_is_armed(
    tmp_path: Path, environment: pytest.MonkeyPatch
) -> None:
    disk = os.statvfs(tmp_path)
    free = disk.f_bavail * disk.f_frsize
    # 64 x 48 at 120 fps for an hour, with room for half of it: the recording may begin, the window not, and
    # if others free some space meanwhile.
    capture = CaptureProcess(
        rig(max_window_s=3600.0, disk_reserve_bytes=free - 1800 * 64 * 48 * RATE), COMMAND
    )
    capture.start()
    try:
        capture.open_recording(tmp_path / "a.mcap", manifest_of_a_box(), [])
        for refused in (capture.require_space, capture.open_window):
            with pytest.raises(RecorderError, match=rf"{tmp_path}: a window needs .* free some space"):
                refused()  # of the disk that the file is on, whatever [recorder] directory says
        capture.close_recording()
    finally:
        capture.stop()


def test_a_signal_finishes_the_file(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    capture = CaptureProcess(rig(), COMMAND)
    capture.start()
    process = capture._process
    assert process is not None
    try:
        capture.open_recording(tmp_path / "a.mcap", manifest_of_a_box(), [])
        capture.open_window()
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)  # is the daemon's to handle
        time.sleep(0.1)
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0
        with pytest.raises(RecorderError, match=r"ended \(exit code 0\)"):
            capture.status()
    finally:
        capture.stop()
    assert len(read(tmp_path / "a.mcap")["/camera/main/image"]) >= 30


def test_the_daemons_death_finishes_the_file(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    capture = CaptureProcess(rig(), COMMAND)
    capture.start()
    process, connection = capture._process, capture._socket
    assert process is not None
    assert connection is not None
    capture.open_recording(tmp_path / "a.mcap", manifest_of_a_box(), [])
    capture.open_window()
    time.sleep(0.3)
    connection.shutdown(2)  # what the kernel does with a dead process's sockets
    assert process.wait(10) == 0
    capture.stop()
    assert len(read(tmp_path / "a.mcap")["/camera/main/image"]) >= 30
    assert not os.path.lexists(tmp_path / "a.mcap.part")


def test_a_gige_camera_over_loopback(tmp_path: Path, environment: pytest.MonkeyPatch) -> None:
    """Aravis with GVSP on loopback, full size and rate, striker samples at 1 kHz beside it: no loss."""
    calibration = CALIBRATION.model_copy(update={"width": 656, "height": 492})
    camera = CameraConfig(address=loopback(41), receive_buffer_bytes=8 << 20, calibration=calibration)
    with subprocess.Popen(
        [sys.executable, str(PATTERN_CAMERA), camera.address],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        capture = CaptureProcess(RigConfig(camera=camera, recorder=RecorderConfig(disk_reserve_bytes=0)))
        try:
            assert capture.start().serial == "PATTERN"
            manifest = manifest_of_a_box()
            capture.open_recording(tmp_path / "a.mcap", manifest, [])
            time.sleep(0.5)
            capture.open_window()
            for number in range(1000):
                capture.write(
                    "/striker/sample",
                    manifest.wall_anchor_ns + time.monotonic_ns(),
                    pb.StrikerSample(tick_ms=number).SerializeToString(),
                )
                time.sleep(0.001)
            report = capture.close_window()
            status = capture.status()
            capture.close_recording()
        finally:
            capture.stop()
            process.kill()
    assert status.clock_latched
    assert (report.lost, status.dropped) == (0, 0)
    assert status.receive_buffer_bytes > 0
    assert status.foreign_packets == 0
    found = read(tmp_path / "a.mcap")
    assert len(found["/striker/sample"]) == 1000
    times = np.array(
        [m.log_time for m in found["/camera/main/image"] if report.start_ns <= m.log_time <= report.end_ns]
    )
    assert len(times) == report.frames > 120
    np.testing.assert_allclose(np.diff(times) * 1e-9, 1 / 120, atol=1e-3)
