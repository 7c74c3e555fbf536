"""Faults of the computer while the daemon records: a full disk and a stepped wall clock."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from acquire.errors import RecorderError
from schemas import topics
from tests.system.fault_rig import (
    FAST_M_S,
    FaultRig,
    Frames,
    add_row,
    contact_event,
    messages,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(90)]

# --- the disk ---

OWN_DISK = (
    "unshare",
    "--user",
    "--map-root-user",
    "--mount",
    "sh",
    "-c",
    'mount -t tmpfs -o size=100m tmpfs "$0" && exec "$@"',
)


def may_mount() -> bool:
    return (
        shutil.which("unshare") is not None
        and subprocess.run([*OWN_DISK[:4], "true"], check=False, capture_output=True).returncode == 0
    )


@pytest.mark.skipif(not may_mount(), reason="this user may make no name space of its own")
def test_disk_full_in_a_window(rig: FaultRig) -> None:
    """Another program fills the daemon's disk (100 MB, mounted for the daemon alone) during the window."""
    disk = rig.folder / "disk"
    disk.mkdir()
    rig.camera()
    daemon = rig.daemon(rig.rig_file(recorder="max_window_s = 1.5"), before=(*OWN_DISK, str(disk)))
    assert daemon.ready, daemon.complaints
    inside = Path(f"/proc/{daemon.pid}/root{disk}")
    client = rig.client(daemon)
    rig.open_recording(client, disk / "r.mcap")
    rig.cocked(client)
    client.call("window.open")
    state = os.statvfs(inside)
    ballast = inside / "ballast"
    with ballast.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, state.f_bavail * state.f_frsize - 16_000_000)
    assert client.call("striker.strike", strike_id="s1.1", tip_speed_m_s=FAST_M_S)["contacts"] == 1
    with pytest.raises(
        RecorderError, match=r"cannot be written.*free space on this disk, finish, and start a new one"
    ):
        client.call("window.close")
    assert "cannot be written" in client.call("status")["trouble"]
    with pytest.raises(RecorderError, match="free"):
        client.call("window.open")
    report = client.call("recording.close")
    metas = [meta for _, meta in messages(inside / "r.mcap", topics.frame_meta("main"))]
    images = sum(meta.image_recorded for meta in metas)
    assert images > 20
    assert report["lost"] > 10
    assert contact_event(inside / "r.mcap") is not None
    ballast.unlink()
    again = disk / "again.mcap"
    rig.open_recording(client, again)
    client.call("window.open")
    time.sleep(0.3)
    assert client.call("window.close")["lost"] == 0
    client.call("recording.close")
    add_row(
        "disk full in mid-window",
        f"{report['lost']} images of the window, counted and reported; the file is complete: {images} images,"
        " every servo sample and event",
        "with the next recording, once there is space",
    )


# --- clocks ---

WALL_CLOCK = """
# Steps the wall clock of every Python process that finds this on its path; the machine's own stays as it is.
import os, time
_time, _time_ns = time.time, time.time_ns
def _shift():
    try:
        with open(os.environ["FAULT_WALL_SHIFT"]) as file:
            return int(file.read() or 0)
    except (OSError, ValueError):
        return 0
time.time = lambda: _time() + _shift()
time.time_ns = lambda: _time_ns() + _shift() * 10**9
"""


def test_wall_clock_steps_by_an_hour(rig: FaultRig) -> None:
    shift = rig.folder / "shift"
    shift.write_text("0")
    (rig.folder / "site").mkdir()
    (rig.folder / "site" / "sitecustomize.py").write_text(WALL_CLOCK)
    rig.camera()
    daemon = rig.daemon(PYTHONPATH=str(rig.folder / "site"), FAULT_WALL_SHIFT=str(shift))
    client = rig.client(daemon)
    anchor = rig.open_recording(client)
    begun_ns = time.monotonic_ns()
    errors = []
    """errors of the contact's time and their stated standard deviations [ms]"""
    for step in (3600, -3600):
        rig.cocked(client)
        client.call("window.open")
        shift.write_text(str(step))
        outcome = client.call("striker.strike", strike_id="s1.1", tip_speed_m_s=FAST_M_S)
        window = client.call("window.close")
        assert outcome["contacts"] == 1
        assert window["lost"] == 0
        error_ns, sd_ns = (
            outcome["contact_time_ns"] - rig.plant.touches[0].time_ns,
            outcome["contact_time_sd_ns"],
        )
        assert abs(error_ns) < 3 * sd_ns
        errors.append((error_ns * 1e-6, sd_ns * 1e-6))
        assert window["start_ns"] < anchor + outcome["contact_time_ns"] < window["end_ns"]
    client.call("recording.close")
    ended_ns = time.monotonic_ns()
    frames = Frames.of(rig.recording)
    assert frames.lost == 0
    assert abs(frames.unaccounted) < 1.0
    assert anchor + begun_ns - 1_000_000_000 < frames.first_ns
    assert frames.last_ns < anchor + ended_ns
    off = [f"{error:+.2f} ms ({sd:.2f} stated)" for error, sd in errors]
    add_row(
        "wall clock set 1 h ahead, then 1 h back, while striking",
        f"nothing: {frames.lost} frames lost; contact times off by {' and '.join(off)}",
        "never stopped",
    )
