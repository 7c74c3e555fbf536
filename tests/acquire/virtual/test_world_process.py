import json
import os
import select
import socket
import stat
import subprocess
import sys
import termios
import time
import tty
from pathlib import Path

import numpy as np
import pytest

from acquire.errors import AcquireError
from acquire.virtual.pace import read_pace
from acquire.virtual.pose_ring import PoseRing
from acquire.virtual.truth_file import TruthWriter, read_truth_file
from schemas.proto import percuss_pb2 as pb
from tests.acquire.virtual.world_link import WorldLink
from tests.schemas.test_planned_toss import TOSS

PING = bytes.fromhex("FFFFFD00010300 01 194E")


@pytest.fixture
def world(tmp_path):
    command = [
        sys.executable,
        "-m",
        "acquire.virtual.world_process",
        "--object",
        "carton",
        "--seed",
        "1",
        "--dir",
        str(tmp_path),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        ready = json.loads(process.stdout.readline())
        try:
            yield process, ready, tmp_path
        finally:
            process.terminate()
            process.wait(5)


def wait_until(condition, seconds=5.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.01)


def test_places_poses_truth_servo_and_a_clean_end(world):
    process, ready, folder = world
    assert ready == {"ready": True, "port": str(folder / "ttyDXL")}
    assert stat.S_IMODE((folder / "world.sock").stat().st_mode) == 0o600
    ring = PoseRing.open(folder / "pose.ring")
    link = WorldLink(folder / "world.sock")
    try:
        link.place(np.eye(3), [0.01, 0.0, 0.075], [-0.03, 0.0, 0.12])
        wait_until(lambda: link.state()["at_rest"])
        assert link.state()["p_world_object"] == pytest.approx([0.01, 0.0, 0.075], abs=5e-5)
        now_ns = time.monotonic_ns()
        wait_until(lambda: ring.latest_time_ns() > now_ns)
        assert ring.poses_at([now_ns]).p_world_object[0] == pytest.approx([0.01, 0.0, 0.075], abs=5e-5)
        assert ring.poses_at([now_ns]).arm_axis_world[0] == pytest.approx([-0.038, 0.0, 0.24], abs=1e-9)

        with pytest.raises(AcquireError, match="rotation"):
            link.place(np.zeros((3, 3)), [0, 0, 0], [0, 0, 0])

        fd = os.open(ready["port"], os.O_RDWR | os.O_NOCTTY)
        try:
            tty.setraw(fd)
            attributes = termios.tcgetattr(fd)
            attributes[4] = attributes[5] = termios.B1000000
            termios.tcsetattr(fd, termios.TCSANOW, attributes)
            os.write(fd, PING)
            assert select.select([fd], [], [], 2.0)[0]
            assert os.read(fd, 64).startswith(bytes.fromhex("FFFFFD0001"))
        finally:
            os.close(fd)

        messages = list(read_truth_file(Path(link.truth())))
        assert isinstance(messages[0], pb.TruthBody)
        assert sum(messages[0].region_mass_kg) == pytest.approx(0.044)
        poses = [message for message in messages if isinstance(message, pb.TruthPose)]
        assert poses[-1].p_world_object == pytest.approx([0.01, 0.0, 0.075], abs=5e-5)
        link.quit()
    finally:
        link.close()
    assert process.wait(5) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["pose.ring", "truth.bin", "world.json"]
    assert 0 <= read_pace(folder).world_s < 5


def test_a_toss_is_held_let_go_and_in_the_truth_file_at_1_khz(world):
    _, _, folder = world
    link = WorldLink(folder / "world.sock")
    link.toss(TOSS, "good", 1e6)
    wait_until(lambda: link.state()["at_rest"])
    held = link.state()["p_world_object"]
    assert held[1] == pytest.approx(TOSS["p_world_apex"][1], abs=0.15)
    link.let_go(0.05)
    released_ns = link.state()["time_ns"]
    wait_until(lambda: not link.state()["at_rest"])
    wait_until(lambda: link.state()["at_rest"])
    messages = read_truth_file(Path(link.truth()))
    body, *rest = messages
    assert 1.0 <= body.drag_coefficient <= 1.2
    times = [
        each.world_time_ns
        for each in rest
        if isinstance(each, pb.TruthPose) and each.world_time_ns > released_ns + 100_000_000
    ][:300]
    assert set(np.diff(times)) == {1_000_000}
    link.place(np.eye(3), np.zeros(3), [-0.04, 0.0, 0.08])
    wait_until(lambda: link.state()["at_rest"] and abs(link.state()["p_world_object"][2] - 0.075) < 1e-3)
    link.close()


def test_invalid_control_requests_get_one_error_line_each(world):
    _process, _ready, folder = world
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(5)
        client.connect(str(folder / "world.sock"))
        lines = client.makefile("r")
        for request in (b"{", b"[]", b'{"method": "fly"}', b'{"method": "place"}'):
            client.sendall(request + b"\n")
            assert "virtual world" in json.loads(lines.readline())["error"]
        client.sendall(b'{"method": "state"}\n')
        assert "time_ns" in json.loads(lines.readline())
        lines.close()


def test_missing_world_is_one_line(tmp_path):
    with pytest.raises(AcquireError, match=r"world\.sock: the virtual world does not answer"):
        WorldLink(tmp_path / "world.sock")


def test_truth_file_reads_back_in_order_and_one_that_is_cut_is_refused(tmp_path):
    path = tmp_path / "truth.bin"
    writer = TruthWriter(path, pb.TruthBody(mass_kg=0.05))
    for i in range(300):
        writer.pose(pb.TruthPose(world_time_ns=i))
    writer.contact(pb.TruthContact(world_time_ns=300, impulse_n_s=0.02))
    writer.close()
    body, *poses, contact = read_truth_file(path)
    assert body == pb.TruthBody(mass_kg=0.05)
    assert [pose.world_time_ns for pose in poses] == list(range(300))
    assert contact.impulse_n_s == 0.02
    path.write_bytes(path.read_bytes()[:-3])
    with pytest.raises(AcquireError, match=r"truth\.bin"):
        list(read_truth_file(path))
