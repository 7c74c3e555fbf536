"""Camera process: ready line, frames of the world's poses, statistics, ends."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from acquire.camera.discovery import identify_camera
from acquire.virtual.camera_process import STATISTICS_FILE, WorldSource
from acquire.virtual.image_source import StreamSettings
from acquire.virtual.pose_ring import PoseRing
from tests.loopback import loopback


@pytest.fixture
def world(tmp_path: Path) -> Iterator[PoseRing]:
    """Pose ring kept up to date: the object at rest and upright, the arm cocked."""
    ring = PoseRing.create(tmp_path / "pose.ring", capacity=4096)
    stop = threading.Event()

    def keep() -> None:
        while not stop.wait(0.001):
            ring.append(time.monotonic_ns(), [0.0, 0.0, 0.07], [1.0, 0.0, 0.0, 0.0], -0.4, [-0.03, 0.0, 0.2])

    writer = threading.Thread(target=keep)
    writer.start()
    yield ring
    stop.set()
    writer.join()


def start(folder: Path, address: str) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-m",
        "acquire.virtual.camera_process",
        "--object",
        "carton",
        "--seed",
        "1",
        "--dir",
        str(folder),
        "--address",
    ]
    return subprocess.Popen([*command, address], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_process_serves_frames_and_prints_statistics_on_sigterm(world: PoseRing, tmp_path: Path) -> None:
    with start(tmp_path, loopback(75)) as process:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline())["ready"] is True
        info = identify_camera(loopback(75))
        assert info is not None
        assert info.serial == "VIRTUAL-1"
        process.send_signal(signal.SIGTERM)
        output, errors = process.communicate(timeout=60)
        assert process.returncode == 0, errors
    assert {"frames", "render_ms_mean", "late"} <= json.loads(output).keys()
    assert json.loads((tmp_path / STATISTICS_FILE).read_text())["frames"] == 0


def test_port_in_use_ends_the_process_with_one_line(world: PoseRing, tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind((loopback(76), 3956))
        with start(tmp_path, loopback(76)) as process:
            output, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert output == ""
    assert f"UDP port 3956 of {loopback(76)} is in use" in errors
    assert len(errors.splitlines()) == 1


class Recorder:
    """Fake renderer that records its arguments and draws the row number into every row."""

    def __init__(self, needed: int) -> None:
        self.needed, self.poses, self.ends = needed, np.zeros((0, 3)), np.zeros((0, 3))

    def subexposures_needed(self, p, q, arm_angle, arm_axis, /) -> int:
        self.ends = p
        return self.needed

    def render(self, p, q, arm_angle, arm_axis, exposure_us, gain_db, /):
        assert len(p) == len(q) == len(arm_angle) == len(arm_axis)
        self.poses = p
        return np.tile((np.arange(492) % 256).astype(np.uint8)[:, None], (1, 656))


@pytest.mark.parametrize(("needed", "expected_ms"), [(1, [0.0]), (4, [0.25, 0.75, 1.25, 1.75])])
def test_exposure_uses_poses_spread_over_it(tmp_path: Path, needed: int, expected_ms: list[float]) -> None:
    ring = PoseRing.create(tmp_path / "pose.ring", capacity=64)
    for step in range(11):  # 1 m/s along x
        ring.append(10**9 + step * 10**6, [step * 1e-3, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], 0.0, [0.0, 0.0, 0.2])
    renderer = Recorder(needed)
    source = WorldSource(ring, renderer)
    settings = StreamSettings(width=100, height=50, offset_x=8, offset_y=20, exposure_us=2000.0, gain_db=0.0)
    image = source.image(10**9 + 3_000_000, settings)
    assert renderer.ends[:, 0] == pytest.approx([3e-3, 5e-3], abs=1e-9)
    assert renderer.poses[:, 0] == pytest.approx([3e-3 + ms * 1e-3 for ms in expected_ms], abs=1e-9)
    assert image.shape == (50, 100)
    assert image[0, 0] == 20
    assert source.latest_time_ns() == 10**9 + 10_000_000
    ring.append(10**9 + 9 * 10**9, [9.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], 0.0, [0.0, 0.0, 0.2])
    source.image(10**9 + 3_000_000, settings)  # the same blur from a camera that is far behind
    assert renderer.poses[:, 0] == pytest.approx([3e-3 + ms * 1e-3 for ms in expected_ms], abs=1e-9)
