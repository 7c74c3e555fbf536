"""A session with a striker that a microcontroller fires, through the daemon and its real serial port."""

from __future__ import annotations

import json
import math
import threading
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from acquire.clock.clock import SystemClock
from acquire.daemon.client import DaemonClient
from acquire.errors import StrikerFault, StrikerStopped
from acquire.striker.board_lines import BoardState
from acquire.striker.board_link import BoardLink
from acquire.virtual.truth import merge_truth
from analyze.cli import main as analyze
from analyze.reading.recording import open_recording
from analyze.reading.truth import read_truth
from tests.system.session_rig import session_rig

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


def test_a_session_of_three_strikes_from_the_first_to_the_answer() -> None:
    with session_rig("serial") as rig:
        report = rig.session(lambda text, _done, _total: rig.said.append(text))
        assert not report.aborted, rig.said
        assert report.lost == 0
        with DaemonClient(rig.daemon.socket) as client:
            assert client.call("status")["striker"] == "disarmed"
        merge_truth(report.path, Path(rig.world().truth()))
        truth = read_truth(report.path)
        with open_recording(report.path) as recording:
            assert recording.manifest.striker["kind"] == "serial"
            good = [record for record in recording.strikes if record.verdict_code == "good"]
            assert len(good) >= 3, rig.said
            for record in recording.strikes:
                off_ns = min(abs(record.contact_time_ns - time) for time in truth.contact_time_ns.tolist())
                assert off_ns < 3 * record.contact_time_sd_ns < 3e6
                assert record.tip_speed_m_s == 0  # not measured, and not stated
        done = CliRunner().invoke(analyze, ["estimate", str(report.path), "--json"], catch_exceptions=False)
        assert done.exit_code == 0, done.stderr
        answer = json.loads(done.stdout)
        assert math.dist(answer["centre_of_mass"]["value"], truth.body.com_object) < 0.002


def test_a_board_that_is_unplugged_in_a_session_is_waited_for() -> None:
    """The session goes on when it is plugged in again."""
    with session_rig("serial") as rig:
        world = rig.world()
        unplugged = False

        def hear(text: str, _done: int, _total: int) -> None:
            nonlocal unplugged
            rig.said.append(text)
            if "arming" in text and not unplugged:
                unplugged = True
                world.servo("unplug")
            elif "waiting for the striker" in text:
                world.servo("plug in")

        report = rig.session(hear)
        assert not report.aborted, rig.said
        assert report.strikes >= 3
        assert any("waiting for the striker" in text for text in rig.said), rig.said


def test_a_killed_daemon_leaves_a_board_that_cannot_fire() -> None:
    """Half a second after kill -9 the board has disarmed itself, and the arm has not moved."""
    with session_rig("serial") as rig:
        world = rig.world()
        with DaemonClient(rig.daemon.socket) as client:
            for order in ("home", "arm", "cock"):
                client.call(f"striker.{order}")
            before = world.state()["arm_angle"]
            rig.daemon.process.kill()
            rig.daemon.process.wait()
        time.sleep(0.5)
        link = BoardLink(str(rig.folder / "ttyBoard"), 1_000_000, SystemClock())
        link.open()
        try:
            assert link.status("state").state is BoardState.SAFE
            with pytest.raises(StrikerFault, match="not-armed"):
                link.fire(300)
        finally:
            link.close()
        assert abs(world.state()["arm_angle"] - before) < 0.01


def test_a_stop_in_a_strike_reaches_the_board_while_another_client_waits() -> None:
    with session_rig("serial") as rig:
        world, raised = rig.world(), []
        with DaemonClient(rig.daemon.socket) as client, DaemonClient(rig.daemon.socket) as other:
            for order in ("home", "arm", "cock"):
                client.call(f"striker.{order}")

            def strike() -> None:
                try:
                    client.call("striker.strike", strike_id="s", tip_speed_m_s=0.1)
                except StrikerStopped as error:
                    raised.append(error)

            thread = threading.Thread(target=strike)
            thread.start()
            deadline = time.monotonic() + 2
            while world.state()["arm_velocity"] < 0.3 and time.monotonic() < deadline:
                time.sleep(0.005)
            asked = time.monotonic()
            other.call("striker.stop")
            while world.state()["arm_velocity"] > 0 and time.monotonic() < deadline:
                time.sleep(0.002)
            stopped_s = time.monotonic() - asked
            thread.join()
        assert raised
        assert stopped_s < 0.1
        assert world.state()["arm_angle"] < 0
