"""Dead man's switch: the torque goes off after the striker's process was killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerNotFound
from acquire.striker.bus import ServoBus
from acquire.striker.control_table import control_table
from acquire.striker.deadman import DeadManSwitch
from tests.acquire.striker.conftest import wait_for
from tests.acquire.striker.lateness import Lateness
from tests.acquire.striker.plant import Plant

OWNER = """
import sys
from acquire.clock.clock import SystemClock
from acquire.striker.bus import ServoBus
from acquire.striker.control_table import control_table
from acquire.striker.deadman import DeadManSwitch
bus = ServoBus(sys.argv[1], 1_000_000, 1, SystemClock())
bus.open()
torque = control_table("XM430-W210")["Torque Enable"]
bus.write(torque, 1)
dead_man = DeadManSwitch(bus.descriptor, bus.unanswered_packet(torque, 0))
print("there", flush=True)
sys.stdin.read()
"""


def test_torque_is_off_within_200_ms_after_the_owner_is_killed(plant: Plant) -> None:
    """The owner is a process that holds the servo alone.

    tests/system/test_striker_faults.py kills the striker and the daemon, in every state.
    """
    command = [sys.executable, "-c", OWNER, str(plant.servo.port_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline() == "there\n"
        assert plant.servo.registers["Torque Enable"] == 1
        with Lateness() as lateness:
            owner.kill()
            killed = time.monotonic()
            assert wait_for(lambda: plant.servo.registers["Torque Enable"] == 0, 3.0, pause_s=0.001)
            off_s = time.monotonic() - killed
        assert off_s < 0.2 + 5 * lateness.worst_s
    assert wait_for(
        lambda: port_is_free(ServoBus(str(plant.servo.port_path), 1_000_000, 1, SystemClock())), 2.0
    )


def port_is_free(bus: ServoBus) -> bool:
    """True if the servo's port can be opened: no process holds it, such as the dead man's switch."""
    try:
        bus.open()
    except StrikerNotFound:
        return False
    bus.close()
    return True


def test_dismissed_switch_does_nothing_and_ignores_signals(plant: Plant) -> None:
    bus = ServoBus(str(plant.servo.port_path), 1_000_000, 1, SystemClock())
    bus.open()
    table = control_table("XM430-W210")
    try:
        bus.write(table["Torque Enable"], 1)
        dead_man = DeadManSwitch(bus.descriptor, bus.unanswered_packet(table["Torque Enable"], 0))
        time.sleep(0.1)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            os.kill(dead_man.pid, number)
        time.sleep(0.1)
        assert Path(f"/proc/{dead_man.pid}").exists()
        dead_man.dismiss()
        assert not Path(f"/proc/{dead_man.pid}").exists()
        time.sleep(0.2)
        assert bus.read(table["Torque Enable"]) == 1
        bus.write(table["Torque Enable"], 0)
    finally:
        bus.close()
