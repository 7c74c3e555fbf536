"""Faults while the daemon records: what is lost, and how long until the rig works again.

A part of the rig dies, is paused, is unplugged, or is asked to end.

Rows of docs/reference/faults.md (`make bench-faults`). The daemon's own end, in every state of the striker,
is in test_striker_faults.py; the servo's faults are in test_servo_faults.py and test_session_servo_faults.py,
damaged files in test_recover.py.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

from acquire.daemon.client import DaemonClient
from acquire.errors import AcquireError
from schemas import topics
from tests.system.fault_rig import (
    ADDRESS,
    FAST_M_S,
    OTHER_ADDRESS,
    RATE_HZ,
    FaultRig,
    Frames,
    add_row,
    messages,
    mid_swing,
    milliseconds,
    recording_request,
    wait_for_frames,
    wait_until,
    works_again,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(90)]


def refused(rig_file: Path) -> tuple[str, float]:
    """Run `acquire run`, which must refuse: its one line, and the time that it took [s]."""
    start = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "acquire", "run", str(rig_file)],
        capture_output=True,
        text=True,
        timeout=40,
        check=False,
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    return line, time.monotonic() - start


# --- the daemon ---


def test_a_second_daemon(rig: FaultRig) -> None:
    rig.camera()
    rig.camera(OTHER_ADDRESS)
    daemon = rig.daemon()
    client = rig.client(daemon)
    rig.open_recording(client)
    line, socket_s = refused(daemon.rig_file)
    assert f"a daemon already listens at {daemon.socket}: stop it with" in line
    line, port_s = refused(rig.rig_file("port", OTHER_ADDRESS))
    assert "in use by another program; `fuser" in line
    line, camera_s = refused(rig.rig_file("camera", ADDRESS, 'kind = "manual"'))
    assert f"camera {ADDRESS} is controlled by another program" in line
    rig.cocked(client)
    assert client.call("striker.strike", strike_id="s1.1", tip_speed_m_s=FAST_M_S)["contacts"] == 1
    client.call("recording.close")
    frames = Frames.of(rig.recording)
    assert frames.lost == 0
    assert abs(frames.unaccounted) < 1.0
    for what, seconds in (("socket", socket_s), ("serial port", port_s), ("camera", camera_s)):
        add_row(
            f"second daemon on the same {what}",
            f"nothing: refused in one line after {seconds:.1f} s; the first keeps recording",
            "at once",
        )


# --- the camera ---


def recorded_gap(rig: FaultRig, client: DaemonClient) -> Frames:
    """Close the recording, check that the frames lost in its gap are counted, and return its counts."""
    report = client.call("recording.close")
    frames = Frames.of(rig.recording)
    assert report["lost"] == frames.lost
    assert abs(frames.unaccounted) < 1.5
    return frames


def gap_by_device_time(path: Path) -> tuple[float, int]:
    """Longest gap by the camera's own clock [frame periods], and the frames counted as lost in it."""
    metas = [meta for _, meta in messages(path, topics.frame_meta("main"))]
    gaps = [(b.device_time_ns - a.device_time_ns, b.frames_lost_before) for a, b in pairwise(metas)]
    longest_ns, lost = max(gaps)
    return longest_ns * 1e-9 * RATE_HZ - 1.0, lost


def test_camera_killed_and_restarted(rig: FaultRig) -> None:
    camera, daemon, client = rig.recording_daemon()
    wait_for_frames(client)
    camera.kill()
    told_s = wait_until(lambda: not client.call("status")["connected"], 5.0, 0.02)
    assert f"camera {ADDRESS} was lost" in client.call("status")["trouble"]
    time.sleep(1.0)
    rig.camera()
    back_s = wait_for_frames(client)
    assert client.call("status")["trouble"] == ""
    frames = recorded_gap(rig, client)
    assert any("camera lost" in log.message for _, log in messages(rig.recording, topics.LOG))
    works_again(rig, daemon)
    add_row(
        "camera killed, 1 s later started again",
        f"the frames meanwhile, {frames.lost} in {frames.longest_gap_s:.1f} s, counted exactly; "
        f"reported after {told_s:.1f} s",
        f"{back_s:.1f} s after the camera's start; the recording continues",
    )


def test_camera_paused_for_3_s(rig: FaultRig) -> None:
    camera, daemon, client = rig.recording_daemon()
    wait_for_frames(client)
    camera.process.send_signal(signal.SIGSTOP)
    told_s = wait_until(lambda: not client.call("status")["connected"], 5.0, 0.02)
    time.sleep(max(0.0, 3.0 - told_s))
    camera.process.send_signal(signal.SIGCONT)
    back_s = wait_for_frames(client)
    frames = recorded_gap(rig, client)
    missing, counted = gap_by_device_time(rig.recording)
    assert abs(missing - counted) < 1.0  # the camera's clock went on
    works_again(rig, daemon)
    add_row(
        "camera stands still for 3 s",
        f"{frames.lost} frames in {frames.longest_gap_s:.1f} s, counted exactly; reported after "
        f"{told_s:.1f} s",
        f"{back_s:.1f} s after it continues; the recording continues",
    )


def test_one_packet_in_500_lost(rig: FaultRig) -> None:
    camera = rig.camera(packet_loss=0.002)
    daemon = rig.daemon()
    client = rig.client(daemon)
    rig.open_recording(client)
    client.call("window.open")
    time.sleep(6.0)
    client.call("window.close")
    client.call("recording.close")
    frames = Frames.of(rig.recording)
    daemon.end()
    counts = camera.finish()
    assert counts["dropped"] > 20, counts
    assert counts["resent"] > 0  # what was dropped before the recording began, or after its end, is nobody's
    assert frames.lost == 0, counts
    assert abs(frames.unaccounted) < 1.0
    add_row(
        "0.2 % of the camera's packets lost",
        f"{frames.lost} of {frames.arrived} frames: {counts['dropped']} lost packets were sent again",
        "never stopped",
    )


# --- the daemon's children and clients ---


def test_watcher_killed(rig: FaultRig) -> None:
    _, daemon, client = rig.recording_daemon()
    wait_until(lambda: client.call("watch.latest")["event"], 20.0, 0.05)
    os.kill(daemon.watcher, signal.SIGKILL)
    killed = time.monotonic()
    wait_until(lambda: "analyze watch ended and was started again" in daemon.complaints, 5.0, 0.01)
    wait_until(lambda: client.call("watch.latest")["event"], 20.0, 0.05)
    back_s = time.monotonic() - killed
    for _ in range(2):
        wait_until(lambda: daemon.watcher, 5.0)
        os.kill(daemon.watcher, signal.SIGKILL)
        time.sleep(0.5)
    assert "keeps ending" in daemon.complaints
    assert not client.call("watch.latest")["alive"]
    report = client.call("recording.close")
    assert report["lost"] == 0
    works_again(rig, daemon)
    add_row(
        "`analyze watch` killed",
        "no frame; a verdict in preparation. Killed three times in one recording, it is not started "
        "again, and strikes are recorded without verdict",
        f"{back_s:.1f} s: started again by the daemon",
    )


CLIENT = """
import json, sys
from pathlib import Path
from acquire.daemon.client import DaemonClient
client = DaemonClient(Path(sys.argv[1]))
client.call("recording.open", **json.loads(sys.argv[2]))
for verb in ("home", "arm", "cock"):
    client.call("striker." + verb)
client.call("window.open")
print("cocked", flush=True)
if sys.argv[3] == "strike":
    client.call("striker.strike", strike_id="s1.1", tip_speed_m_s=0.15)
sys.stdin.read()
"""


@pytest.mark.parametrize("where", ["cocked", "strike"])
def test_session_client_killed(rig: FaultRig, where: str) -> None:
    rig.camera()
    daemon = rig.daemon()
    given = [str(daemon.socket), json.dumps(recording_request(rig.recording)), where]
    with subprocess.Popen(
        [sys.executable, "-c", CLIENT, *given], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as session:
        assert session.stdout is not None
        assert session.stdout.readline() == "cocked\n"
        if where == "strike":
            wait_until(lambda: mid_swing(rig), 5.0, 0.001)
        session.kill()
        killed_ns = time.monotonic_ns()
        closed_s = wait_until(rig.recording.exists, 10.0)
    client = rig.client(daemon)
    wait_until(lambda: client.call("status")["striker"] == "disarmed", 1.0)
    assert client.call("status")["recording"] is None
    moved_s = rig.still_after_s(killed_ns)
    assert moved_s < 0.3
    assert Frames.of(rig.recording).lost == 0
    works_again(rig, daemon)
    what = "the strike in progress" if where == "strike" else "nothing"
    add_row(
        f"session client killed, striker {'in mid-swing' if where == 'strike' else 'cocked'}",
        f"{what}: the arm stands after {milliseconds(moved_s)}, the file is finished after {closed_s:.1f} s",
        "at once, for a new session",
    )


def test_status_survives_whatever_the_camera_does(rig: FaultRig) -> None:
    """A camera that dies and stays away: the daemon still answers `status`, and ends on request."""
    camera, daemon, client = rig.recording_daemon()
    camera.kill()
    wait_until(lambda: not client.call("status")["connected"], 5.0, 0.02)
    start = time.monotonic()
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(30) == 0
    end_s = time.monotonic() - start
    assert rig.recording.exists()
    with pytest.raises(AcquireError):
        client.call("status")
    add_row(
        "camera gone for good, then SIGTERM",
        "nothing more: file finished, torque off",
        f"ended after {end_s:.1f} s",
    )
