"""`acquire stop` in every state of striker and session.

It answers in time, nothing moves afterwards, and homing permits motion again.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from acquire.cli import main as acquire
from acquire.daemon.client import DaemonClient
from acquire.errors import StrikerStopped
from tests.acquire.striker.lateness import Lateness
from tests.loopback import loopback
from tests.system.fault_rig import OTHER_ADDRESS, Daemon, FaultRig, fault_rig, wait_until
from tests.system.test_striker_faults import STATES, reach

pytestmark = [pytest.mark.slow, pytest.mark.timeout(90)]
ANSWER_S, MOTION_S = 0.5, 0.2
OWN_ADDRESS = loopback(126)
"""address of the camera of a rig that runs beside this module's two rigs, whose cameras have fault_rig's
addresses"""
MANUAL_STATES = ("disarmed", "homed", "armed", "settled", "released")


@pytest.fixture(scope="module")
def servo_rig() -> Iterator[tuple[FaultRig, Daemon]]:
    with fault_rig() as rig:
        rig.camera()
        yield rig, rig.daemon()


@pytest.fixture(scope="module")
def manual_rig() -> Iterator[tuple[FaultRig, Daemon]]:
    with fault_rig() as rig:
        rig.camera(OTHER_ADDRESS)
        yield rig, rig.daemon(rig.rig_file("m", OTHER_ADDRESS, 'kind = "manual"'))


def stop(daemon: Daemon) -> float:
    """Run `acquire stop`; returns its duration minus the delays of this computer [s]."""
    with Lateness() as lateness:
        start = time.monotonic()
        done = CliRunner().invoke(acquire, ["stop", "--rig", str(daemon.rig_file)])
        took_s = time.monotonic() - start
    assert (done.exit_code, done.output) == (0, "striker stopped\n"), done.output
    return took_s - 5 * lateness.worst_s


def session(rig: FaultRig, client: DaemonClient, what: str) -> None:
    """Open a recording, or a recording with a window, or neither."""
    if what != "no session":
        rig.open_recording(client, rig.folder / f"r{time.monotonic_ns()}.mcap")
    if what == "in a window":
        client.call("window.open")


def end_session(client: DaemonClient, what: str) -> Path | None:
    """End the session; its recording is complete in spite of the stop."""
    if what == "in a window":
        assert client.call("window.close")["frames"] > 0
    return Path(client.call("recording.close")["path"]) if what != "no session" else None


@pytest.mark.parametrize("what", ["no session", "recording", "in a window"])
@pytest.mark.parametrize("state", STATES)
def test_a_servo_is_stopped(servo_rig: tuple[FaultRig, Daemon], state: str, what: str) -> None:
    rig, daemon = servo_rig
    client, looks_on = rig.client(daemon), rig.client(daemon)
    session(rig, client, what)
    reach(rig, daemon, client, state)
    with Lateness() as lateness:
        sent_ns = time.monotonic_ns()
        assert stop(daemon) < ANSWER_S
        time.sleep(0.4)
    moved_s = rig.still_after_s(sent_ns)
    assert moved_s < MOTION_S + 5 * lateness.worst_s
    assert abs(rig.plant.omega) < 0.1
    assert looks_on.call("status")["striker"] == (
        "fault" if state == "fault" else "homed" if state == "homed" else "disarmed"
    )
    rig.wait_for_background()
    with pytest.raises(StrikerStopped, match="stopped on request: home it"):
        client.call("striker.arm")
    with pytest.raises(StrikerStopped):
        client.call("striker.home", after_stop=False)
    rig.plant.restore(gap=0.0)
    client.call("striker.home")
    client.call("striker.arm")
    stop(daemon)
    path = end_session(client, what)
    assert path is None or path.exists()


@pytest.mark.parametrize("what", ["no session", "in a window"])
@pytest.mark.parametrize("state", MANUAL_STATES)
def test_a_manual_striker_is_stopped(manual_rig: tuple[FaultRig, Daemon], state: str, what: str) -> None:
    """The program cannot stop a hand: it ends the wait for the strike, and the permission to strike."""
    rig, daemon = manual_rig
    client, looks_on = rig.client(daemon), rig.client(daemon)
    session(rig, client, what)
    for verb in {"disarmed": (), "homed": ("home",), "armed": ("home", "arm")}.get(
        state, ("home", "arm", "cock")
    ):
        client.call(f"striker.{verb}")
    if state == "released":
        rig.strike_in_background(client, 0.2)
        wait_until(lambda: looks_on.call("status")["striker"] == "released", 3.0)
    assert stop(daemon) < ANSWER_S
    wait_until(lambda: looks_on.call("status")["striker"] in {"disarmed", "homed"}, 1.0)
    rig.wait_for_background()
    with pytest.raises(StrikerStopped, match="stopped on request: home it"):
        client.call("striker.arm")
    client.call("striker.home")
    end_session(client, what)


def test_a_hung_capture_process_does_not_delay_a_stop(servo_rig: tuple[FaultRig, Daemon]) -> None:
    rig, daemon = servo_rig
    client = rig.client(daemon)
    rig.open_recording(client, rig.folder / "hung.mcap")
    reach(rig, daemon, client, "cocking")
    capture = daemon.capture
    os.kill(capture, signal.SIGSTOP)
    sent_ns = time.monotonic_ns()
    assert stop(daemon) < ANSWER_S
    time.sleep(0.4)
    assert rig.still_after_s(sent_ns) < MOTION_S
    wait_until(lambda: daemon.capture not in {0, capture}, 20.0, 0.05)


def test_closing_the_terminal_ends_the_daemon_properly() -> None:
    with fault_rig() as rig:
        rig.camera(OWN_ADDRESS)
        daemon = rig.daemon(rig.rig_file(address=OWN_ADDRESS))
        client = rig.client(daemon)
        rig.open_recording(client)
        reach(rig, daemon, client, "settled")
        daemon.process.send_signal(signal.SIGHUP)
        assert daemon.process.wait(20) == 0, daemon.complaints
        assert not rig.torque
        assert rig.recording.exists()
        assert not daemon.socket.exists()
