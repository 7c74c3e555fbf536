"""A continuous recording from the buffers of a real GigE Vision client: camera faults, and kill -9."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from acquire.capture.link import CaptureProcess
from acquire.recorder.recover.recover import recover
from schemas.proto import percuss_pb2 as pb
from schemas.rig import CameraConfig, RecorderConfig, RigConfig
from tests.acquire.capture.synthetic_rig import CALIBRATION, manifest_of_a_box, read
from tests.acquire.virtual.pattern_source import noise, read_stamp, stamped
from tests.loopback import loopback
from tests.places import PATTERN_CAMERA

WIDTH, HEIGHT, SEED = 656, 492, 7
ADDRESS = loopback(42)


@pytest.fixture
def start_camera() -> Iterator[Callable[[], subprocess.Popen[str]]]:
    processes: list[subprocess.Popen[str]] = []

    def start() -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, str(PATTERN_CAMERA), ADDRESS],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        return process

    yield start
    for process in processes:
        process.kill()
        process.communicate()


def _rig(rotate_bytes: int = 40 << 20) -> RigConfig:
    calibration = CALIBRATION.model_copy(update={"width": WIDTH, "height": HEIGHT})
    camera = CameraConfig(address=ADDRESS, receive_buffer_bytes=64 << 20, buffers=64, calibration=calibration)
    return RigConfig(
        camera=camera,
        recorder=RecorderConfig(mode="continuous", rotate_bytes=rotate_bytes, disk_reserve_bytes=0),
    )


def _check(paths: list[Path]) -> list[tuple[int, pb.FrameMeta]]:
    """Compare each recorded image with the camera's pattern; return its number there and meta, in order."""
    pattern = noise(WIDTH, HEIGHT, SEED)
    images: dict[int, int] = {}
    metas: dict[int, pb.FrameMeta] = {}
    for path in paths:
        found = read(path)
        for message in found.get("/camera/main/image", []):
            image = np.frombuffer(message.data[-WIDTH * HEIGHT :], np.uint8).reshape(HEIGHT, WIDTH)
            start_ns, number = read_stamp(image.reshape(-1))
            np.testing.assert_array_equal(image, stamped(pattern, start_ns, number))
            images[message.sequence] = number
        for message in found.get("/camera/main/meta", []):
            metas[message.sequence] = pb.FrameMeta.FromString(message.data)
    assert list(images) == list(metas) == list(range(min(metas), max(metas) + 1))
    assert all(meta.image_recorded for meta in metas.values())
    return [(images[sequence], meta) for sequence, meta in metas.items()]


def _files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.mcap"), key=lambda path: (len(path.name), path.name))


@pytest.mark.slow
@pytest.mark.parametrize("how", ["killed", "paused"])
def test_a_camera_that_goes_away_and_comes_back(
    tmp_path: Path,
    environment: pytest.MonkeyPatch,
    start_camera: Callable[[], subprocess.Popen[str]],
    how: str,
) -> None:
    process = start_camera()
    capture = CaptureProcess(_rig())
    capture.start()
    try:
        capture.open_recording(tmp_path / "a.mcap", manifest_of_a_box(), [])
        time.sleep(1.5)
        process.send_signal(signal.SIGKILL if how == "killed" else signal.SIGSTOP)
        time.sleep(2.5)
        if how == "killed":
            start_camera()
        else:
            process.send_signal(signal.SIGCONT)
        came = capture.status().frames
        end = time.monotonic() + 60.0
        while capture.status().frames < came + 200 and time.monotonic() < end:
            time.sleep(0.1)
        status = capture.status()
        done = capture.close_recording()
    finally:
        capture.stop()
    assert status.dropped == 0
    found = _check(_files(tmp_path))
    assert len(found) == done.frames > 300
    assert done.lost == sum(meta.frames_lost_before for _, meta in found[1:]) + found[0][1].frames_lost_before
    assert done.lost > 60
    for (earlier, _), (later, meta) in pairwise(found):
        assert later == earlier + 1 or meta.frames_lost_before > 0


def test_a_kill_costs_less_than_half_a_second(
    tmp_path: Path, environment: pytest.MonkeyPatch, start_camera: Callable[[], subprocess.Popen[str]]
) -> None:
    start_camera()
    capture = CaptureProcess(_rig(rotate_bytes=1 << 30))
    capture.start()
    process = capture._process
    assert process is not None
    held_up_s = 0.0
    try:
        manifest = manifest_of_a_box()
        capture.open_recording(tmp_path / "a.mcap", manifest, [])
        end = time.monotonic() + 1.2
        while (before := time.monotonic()) < end:
            time.sleep(0.01)
            held_up_s = max(held_up_s, time.monotonic() - before - 0.01)
        killed_ns = manifest.wall_anchor_ns + time.monotonic_ns()
        process.kill()
    finally:
        capture.stop()
    for number, part in enumerate(sorted(tmp_path.glob("*.part"))):
        assert not recover(part, tmp_path / f"z-recovered-{number}.mcap").anything_damaged
        part.unlink()
    messages = [read(path) for path in _files(tmp_path)]
    images = sorted(
        (m for found in messages for m in found.get("/camera/main/image", [])),
        key=lambda message: message.sequence,
    )
    metas = sorted(
        (m for found in messages for m in found.get("/camera/main/meta", [])),
        key=lambda message: message.sequence,
    )
    for found in (images, metas):
        assert [message.sequence for message in found] == list(
            range(found[0].sequence, found[0].sequence + len(found))
        )
        assert (killed_ns - found[-1].log_time) * 1e-9 < 0.5 + held_up_s
