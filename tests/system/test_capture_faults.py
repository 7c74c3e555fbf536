"""The capture process, or its camera thread, dies or hangs while the daemon records.

The recording continues in the next file, and the loss is reported. Rows of docs/reference/faults.md (`make
bench-faults`).
"""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from acquire.capture.heartbeat import SILENCE_S
from acquire.daemon.client import DaemonClient
from acquire.errors import DaemonSilent, RecordingBroken
from acquire.recorder.recover.edit import read_manifest
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from schemas.rig import RecorderConfig
from tests.system.fault_rig import (
    FAST_M_S,
    RATE_HZ,
    FaultRig,
    Frames,
    add_row,
    messages,
    milliseconds,
    wait_for_frames,
    wait_until,
    works_again,
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]


def second(rig: FaultRig) -> Path:
    return rig.recording.with_name("r-0002.mcap")


def strike(rig: FaultRig, client: DaemonClient, strike_id: str) -> pb.StrikeRecord:
    """Make a strike and its record, as a session does."""
    rig.cocked(client)
    client.call("window.open")
    assert client.call("striker.strike", strike_id=strike_id, tip_speed_m_s=FAST_M_S)["contacts"]
    window = client.call("window.close")
    assert window["frames"] > 10
    record = {
        "strike_id": strike_id,
        "window_start_ns": window["start_ns"],
        "window_end_ns": window["end_ns"],
    }
    client.call("recording.strike", **record)
    return pb.StrikeRecord(**record)


def check_files(rig: FaultRig, report: dict, gap_from_ns: int, gap_to_ns: int) -> float:
    """Check two complete files of one recording; returns the gap between them [s].

    Every frame is in one file, counted as lost in one, or counted as lost between them.
    """
    assert [Path(path).name for path in report["files"]] == ["r.mcap", "r-0002.mcap"]
    first, then = (Frames.of(Path(path)) for path in report["files"])
    heads = [read_manifest(Path(path)) for path in report["files"]]
    assert heads[0].recording_id == heads[1].recording_id
    assert (heads[0].part, heads[1].part) == (1, 2)
    gap_s = (then.first_ns - first.last_ns) * 1e-9
    assert report["frames"] == first.arrived + then.arrived
    assert report["lost"] == pytest.approx(first.lost + then.lost + gap_s * RATE_HZ - 1, abs=1.0)
    assert abs(first.unaccounted) < 1.0
    assert abs(then.unaccounted) < 1.0
    assert gap_from_ns - 0.6e9 - RecorderConfig().pre_trigger_s * 1e9 < first.last_ns
    assert then.first_ns < gap_to_ns + 1.0e9
    said = [log.message for _, log in messages(second(rig), topics.LOG)]
    assert any(f"{round(gap_s * RATE_HZ) - 1} frames are lost ({gap_s:.1f} s)" in text for text in said), said
    return gap_s


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hangs"])
def test_capture_process_fails_between_strikes(rig: FaultRig, how: signal.Signals) -> None:
    rig.camera()
    daemon = rig.daemon()
    client = rig.client(daemon)
    anchor = rig.open_recording(client)
    before = strike(rig, client, "s1.1")
    wait_for_frames(client, 60)
    os.kill(daemon.capture, how)
    failed_ns = time.monotonic_ns()
    said = "gave no sign of life for 3 s and was ended" if how is signal.SIGSTOP else "ended (exit code -9)"
    told_s = wait_until(
        lambda: f"the recording was interrupted: the capture process {said}" in daemon.complaints,
        SILENCE_S + 5.0,
        0.01,
    )
    client.call("recording.state", state=1, strike_id="s2", attempt=1, text="")  # waits
    back_s = (time.monotonic_ns() - failed_ns) * 1e-9
    assert "the recording continues in r-0002.mcap" in daemon.complaints
    after = strike(rig, client, "s2.1")
    report = client.call("recording.close")
    gap_s = check_files(rig, report, anchor + failed_ns, anchor + failed_ns + round(back_s * 1e9))
    records = [
        [record for _, record in messages(path, topics.SESSION_STRIKE)]
        for path in (rig.recording, second(rig))
    ]
    assert records == [[before], [after]]
    assert any(
        event.kind == pb.StrikerEvent.CONTACT for _, event in messages(second(rig), topics.STRIKER_EVENT)
    )
    works_again(rig, daemon)
    what = "hangs (SIGSTOP)" if how is signal.SIGSTOP else "killed (kill -9)"
    add_row(
        f"capture process {what} between two strikes",
        f"{round(gap_s * RATE_HZ) - 1} frames in {gap_s:.1f} s, counted in the file; reported after"
        f" {milliseconds(told_s)}; its file is rebuilt",
        f"{back_s:.1f} s: the recording continues in the next numbered file",
    )


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hangs"])
def test_capture_process_fails_in_a_window(rig: FaultRig, how: signal.Signals) -> None:
    """The strike in progress is lost; its client gets an error and repeats the strike."""
    rig.camera()
    daemon = rig.daemon()
    client = rig.client(daemon)
    anchor = rig.open_recording(client)
    rig.cocked(client)
    client.call("window.open")
    capture = daemon.capture
    time.sleep(0.5)
    os.kill(capture, how)
    failed_ns = time.monotonic_ns()
    assert client.call("striker.strike", strike_id="s1.1", tip_speed_m_s=FAST_M_S)[
        "contacts"
    ]  # the arm is nobody's hostage
    with pytest.raises(RecordingBroken, match="the window was cut off"):
        client.call("window.close")
    again = strike(rig, client, "s1.1")
    back_s = (time.monotonic_ns() - failed_ns) * 1e-9
    report = client.call("recording.close")
    gap_s = check_files(rig, report, anchor + failed_ns, anchor + failed_ns + round(back_s * 1e9))
    assert [record for _, record in messages(second(rig), topics.SESSION_STRIKE)] == [again]
    images = [time for time, _ in messages(rig.recording, topics.raw_image("main"))]
    lost_s = (anchor + failed_ns - images[-1]) * 1e-9
    assert lost_s < 0.5
    add_row(
        f"capture process {'hangs (SIGSTOP)' if how is signal.SIGSTOP else 'killed (kill -9)'} in a "
        "strike's window",
        f"that strike, which is repeated; its file keeps all but the last {milliseconds(lost_s)} before the "
        f"fault; then {gap_s:.1f} s, counted in the file",
        f"{back_s:.1f} s, including the repeated strike",
    )


def test_a_recording_that_is_closed_while_the_capture_process_is_away_is_rebuilt(rig: FaultRig) -> None:
    camera, daemon, client = rig.recording_daemon()
    strike(rig, client, "s1.1")
    camera.kill()
    os.kill(daemon.capture, signal.SIGKILL)
    wait_until(lambda: "the recording was interrupted" in daemon.complaints, 5.0, 0.01)
    start = time.monotonic()
    report = client.call("recording.close")
    took_s = time.monotonic() - start
    assert report["files"] == [str(rig.recording)]
    assert report["frames"] == Frames.of(rig.recording).arrived
    assert not Path(f"{rig.recording}.part").exists()
    rig.camera()
    works_again(rig, daemon)
    add_row(
        "camera and capture process killed, then the session ends",
        "everything after the kill; the file is rebuilt before the answer to `recording.close`",
        f"closed after {took_s:.1f} s",
    )


def test_camera_and_capture_process_killed(rig: FaultRig) -> None:
    """The capture process is restarted when a camera answers again; meanwhile the striker is safe."""
    camera = rig.camera()
    daemon = rig.daemon()
    client = rig.client(daemon)
    rig.cocked(client)
    camera.kill()
    os.kill(daemon.capture, signal.SIGKILL)
    wait_until(
        lambda: "the capture process does not start: no camera answers" in daemon.complaints, 20.0, 0.05
    )
    rig.camera()
    back_s = wait_until(lambda: "it was started again" in daemon.complaints, 20.0, 0.05)
    assert len(daemon.complaints.splitlines()) == 2, daemon.complaints
    works_again(rig, daemon)
    rig.cocked(client)
    capture = daemon.capture
    os.kill(capture, signal.SIGKILL)
    wait_until(lambda: daemon.capture not in {0, capture}, 5.0)
    daemon.process.send_signal(signal.SIGTERM)
    off_s = wait_until(lambda: not rig.torque, 5.0)
    assert off_s < 0.5
    assert daemon.process.wait(30) == 0, daemon.complaints
    add_row(
        "camera and capture process killed, the camera later started again",
        f"as for each of the two alone; SIGTERM meanwhile takes the torque off after {milliseconds(off_s)}",
        f"{back_s:.1f} s after the camera's start",
    )


def test_sigterm_while_the_capture_process_hangs(rig: FaultRig) -> None:
    _, daemon, client = rig.recording_daemon()
    strike(rig, client, "s1.1")
    os.kill(daemon.capture, signal.SIGSTOP)
    start = time.monotonic()
    daemon.process.send_signal(signal.SIGTERM)
    off_s = wait_until(lambda: not rig.torque, 5.0)
    assert daemon.process.wait(30) == 0, daemon.complaints
    end_s = time.monotonic() - start
    assert off_s < 0.5
    assert Frames.of(rig.recording).arrived > 100
    add_row(
        "capture process hangs (SIGSTOP), then SIGTERM",
        f"everything after the hang: torque off after {milliseconds(off_s)}, its file is rebuilt",
        f"ended after {end_s:.1f} s",
    )


def test_the_daemon_hangs(rig: FaultRig) -> None:
    """The hung daemon's socket still accepts connections: a client reports the hang in one line.

    When the daemon continues, everything continues.
    """
    _, daemon, client = rig.recording_daemon()
    daemon.process.send_signal(signal.SIGSTOP)
    start = time.monotonic()
    try:
        with (
            daemon.client() as other,
            pytest.raises(DaemonSilent, match=rf"process {daemon.pid}.* it hangs: end it with `kill -9"),
        ):
            other.call("status")
        told_s = time.monotonic() - start
    finally:
        daemon.process.send_signal(signal.SIGCONT)
    report = client.call("recording.close")
    assert report["lost"] == 0
    assert abs(Frames.of(rig.recording).unaccounted) < 1.0
    works_again(rig, daemon)
    add_row(
        "the daemon hangs (SIGSTOP), later continues",
        f"nothing: the capture process keeps recording; after {told_s:.1f} s a client reports which process "
        "to end",
        "as soon as it continues",
    )
