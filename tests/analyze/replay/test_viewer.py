"""Rerun's own processes: they listen on loopback only, end with the command, and draw the pages."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import cv2
import pytest

from analyze.reading.recording_file import find_recording
from analyze.replay.picture import screenshot
from analyze.replay.run import replay_recording
from analyze.replay.sender import ReplayOptions
from analyze.replay.target import to_file
from tests.places import FIRST_SAMPLE

ROOT = FIRST_SAMPLE.parents[1]


def listening(port: int) -> set[str]:
    """Addresses on which a port is open, in hexadecimal as in /proc/net."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text(encoding="ascii").splitlines()[1:]:
            address, state = line.split()[1], line.split()[3]
            if state == "0A" and int(address.rpartition(":")[2], 16) == port:
                found.add(address.rpartition(":")[0])
    return found


def children(pid: int) -> list[int]:
    return [
        int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
    ]


def test_web_viewer_serves_on_loopback_only_and_ends_with_ctrl_c(tmp_path):
    stderr = (tmp_path / "stderr").open("w+")
    command = [sys.executable, "-m", "analyze", "replay", str(FIRST_SAMPLE), "--web", "--no-browser"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=stderr, text=True)
    try:
        line = process.stdout.readline()
        address = re.fullmatch(
            r"replay: (http://127\.0\.0\.1:(\d+)/\?url=rerun%2Bhttp%3A%2F%2F127\.0\.0\.1%3A(\d+)%2Fproxy)\n",
            line,
        )
        assert address, line
        with urllib.request.urlopen(address[1], timeout=20) as page:
            assert page.status == 200
            assert b"<html" in page.read().lower()
        for port in (int(address[2]), int(address[3])):
            assert listening(port) == {"0100007F"}
        (viewer,) = children(process.pid)
        process.send_signal(signal.SIGINT)
        assert process.wait(30) in {0, 130}  # 130 while strikes are still being read
        assert not Path(f"/proc/{viewer}").exists()
        stderr.seek(0)
        assert "Traceback" not in stderr.read()
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait()
        process.stdout.close()
        stderr.close()


def test_terminated_replay_leaves_no_viewer():
    command = [sys.executable, "-m", "analyze", "replay", str(FIRST_SAMPLE), "--web", "--no-browser"]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert process.stdout is not None
    assert process.stdout.readline()
    (viewer,) = children(process.pid)
    process.terminate()
    process.wait(30)
    process.stdout.close()
    ends = time.monotonic() + 5
    while Path(f"/proc/{viewer}").exists() and time.monotonic() < ends:
        time.sleep(0.05)
    assert not Path(f"/proc/{viewer}").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("vulkan")
def test_pages_rendered_without_a_screen_are_not_blank(tmp_path):
    rrd, picture = tmp_path / "r.rrd", tmp_path / "r.png"
    with to_file(rrd) as target:
        done = replay_recording(
            find_recording(FIRST_SAMPLE), target, ReplayOptions(page="s1.1"), lambda *_: None
        )
    screenshot(rrd, picture, done.moment_s)
    image = cv2.imread(str(picture))
    height, width = image.shape[:2]
    assert height > 800
    hue = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    camera = hue[height // 10 : height // 2, : width // 2]
    assert camera[..., 2].std() > 15  # grey picture of object and tag
    assert (camera[..., 1] > 90).mean() > 0.003  # the fitted pose and the pivot axis over it
    assert (hue[height * 6 // 10 :, : width // 2, 1] > 90).mean() > 0.002  # plane, pivot, centre of mass
    assert (hue[height // 5 : height * 8 // 10, width // 2 :, 1] > 90).mean() > 0.002  # measured and fitted
    assert (hue[height * 9 // 10 :, width // 2 :, 1] > 90).mean() > 0.05  # bands
