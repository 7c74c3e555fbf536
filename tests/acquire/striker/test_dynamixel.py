"""The striker over a real pty with the real SDK, against an arm and a box that are stepped at 1 kHz."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from acquire.errors import StrikerError, StrikerFault, StrikerLost, StrikerRefused
from acquire.striker.base import StrikerState
from acquire.virtual.dynamixel_servo import HardwareError
from tests.acquire.striker.conftest import Heard, home_arm_and_cock, wait_for
from tests.acquire.striker.plant import ARM_LENGTH, Plant

ARM_STEP_MS = 1.0
"""step of the simulated arm [ms]"""
WELL_READ_MS = 2.2
"""longest time [ms] from the beginning of one read to the end of the next at the nominal rate: 1.4 ms plus
the duration of a read"""


def bracket_ms(heard: Heard, time_ns: int) -> float:
    """Longest time, near a contact, from the beginning of one read to the end of the next [ms]."""
    near = [s for s in heard.samples if -10_000_000 < s.host_before_ns - time_ns < 10_000_000]
    gaps = [later.host_after_ns - earlier.host_before_ns for earlier, later in pairwise(near)]
    return 1e-6 * max(gaps, default=20_000_000)


def test_strike_has_one_contact_at_the_commanded_speed_and_true_time(plant: Plant, heard: Any) -> None:
    rng = random.Random(1)
    with heard.opened(plant.config()) as striker:
        striker.home()
        assert striker.state is StrikerState.HOMED
        error_ms, allowed_ms = [], []
        for number, speed in enumerate((0.25, 0.3, 0.36, 0.45)):
            plant.restore(gap=rng.uniform(-0.0007, 0.0007))
            striker.arm()
            striker.cock()
            outcome = striker.strike(f"s{number}", speed)
            assert striker.state is StrikerState.DISARMED
            assert len(plant.touches) == 1
            assert outcome.contacts == 1
            truth = plant.touches[0]
            assert outcome.tip_speed_m_s == pytest.approx(truth.tip_speed, rel=0.03)
            assert outcome.tip_speed_m_s == pytest.approx(speed, rel=0.03)
            assert outcome.contact_time_ns is not None
            error_ms.append((outcome.contact_time_ns - truth.time_ns) * 1e-6)
            sd_ms = outcome.contact_time_sd_ns * 1e-6
            gap_ms, delay_ms = bracket_ms(heard, truth.time_ns), plant.delay_ms(truth.time_ns)
            if outcome.impulse_n_s is not None:
                assert abs(outcome.impulse_n_s - truth.impulse) < 4 * outcome.impulse_sd_n_s
            allowed_ms.append(max(ARM_STEP_MS, sd_ms, gap_ms - WELL_READ_MS, delay_ms))
        # This arm moves in steps of 1 ms, in the striker's own interpreter, and shows contacts 0.2 to 0.7 ms
        # early: only gross errors are seen here. To 0.3 ms they are tested in simulated time
        # (test_contact.py) and between two processes (`make bench-striker`: -0.03 ± 0.21 ms). So is the
        # stated sd: it grows with every late read of a swing, and on a busy host some always are.
        assert np.sqrt(np.mean(np.square(error_ms))) < np.sqrt(np.mean(np.square(allowed_ms)))
        cycle = ["ARMED", "COCKED", "RELEASED", "CONTACT", "CAUGHT", "VERIFIED", "DISARMED"]
        assert heard.kinds() == ["HOMED", *cycle * 4]
        assert {event.strike_id for event in heard.events} == {"", "s0", "s1", "s2", "s3"}
        assert abs(plant.angle - plant.config().cocked_angle_rad) < 0.01  # parked, torque on


def test_samples_and_clock_bounds_contain_the_true_values(plant: Plant, heard: Any) -> None:
    plant.restore(gap=0.0)
    with heard.opened(plant.config()) as striker:
        home_arm_and_cock(striker)
        outcome = striker.strike("s", 0.3)
        time.sleep(1.1)
    history = np.array(plant.history)
    middle = np.array([(s.host_before_ns + s.host_after_ns) / 2 for s in heard.samples])
    position = np.array([s.position_rad for s in heard.samples])
    true = np.interp(middle, history[:, 0], history[:, 1])
    width = np.array([s.host_after_ns - s.host_before_ns for s in heard.samples]) * 1e-9
    speed = np.interp(middle, history[:, 0], np.abs(history[:, 2]))
    within = np.abs(position - true) < 0.003 + speed * (0.5 * width + 0.002)
    assert within.mean() > 0.9  # the others: reads during which the plant lagged on a busy host
    # a swing is read at 1 kHz, less on a busy host
    swing = (middle > outcome.released_ns) & (middle < outcome.contact_time_ns)
    assert 200 < swing.sum() / ((outcome.contact_time_ns - outcome.released_ns) * 1e-9) < 1100
    # device minus host time is one offset within its bounds (1 ms of tick), but for 50 ppm
    low = max(c.device_time_ns - c.host_after_ns for c in heard.clocks)
    high = min(c.device_time_ns + 1_000_000 - c.host_before_ns for c in heard.clocks)
    assert low < high + 300_000
    assert len(heard.clocks) >= 4


def test_arm_turns_back_without_an_object(plant: Plant, heard: Any) -> None:
    with heard.opened(plant.config()) as striker:
        home_arm_and_cock(striker)
        plant.history.clear()
        outcome = striker.strike("s", 0.36)
        reached = max(angle for _, angle, _ in plant.history) * ARM_LENGTH
        assert reached < 0.012  # 2 mm beyond angle 0, plus the braking distance
        assert outcome.contact_time_sd_ns > 1e6
        assert outcome.impulse_n_s is None


def test_interlocks(plant: Plant, heard: Any) -> None:
    with heard.opened(plant.config(arming_expires_s=0.5)) as striker:
        with pytest.raises(StrikerRefused, match="home"):
            striker.arm()
        striker.home()
        with pytest.raises(StrikerRefused, match="arm and cock it first"):
            striker.strike("s", 0.3)
        with pytest.raises(StrikerRefused, match="arm it first"):
            striker.cock()
        striker.arm()
        striker.cock()
        with pytest.raises(StrikerRefused, match="outside"):
            striker.strike("s", 3.0)
        assert wait_for(lambda: striker.state is StrikerState.DISARMED, 1.0)  # expired
        with pytest.raises(StrikerRefused):
            striker.strike("s", 0.3)
        striker.arm()
        striker.stop()
        assert striker.state is StrikerState.DISARMED
        assert not any(kind == "RELEASED" for kind in heard.kinds())


def test_alert_is_a_fault_and_switches_the_torque_off(plant: Plant, heard: Any) -> None:
    with heard.opened(plant.config()) as striker:
        striker.home()
        plant.servo.fail(HardwareError.INPUT_VOLTAGE)  # not in Shutdown: the servo itself goes on
        assert wait_for(lambda: heard.kinds()[-1] == "FAULT", 2.0)
        assert striker.state is StrikerState.FAULT
        assert plant.servo.registers["Torque Enable"] == 0
        assert "input voltage" in heard.events[-1].text
        with pytest.raises(StrikerRefused, match="home it"):
            striker.arm()
        striker.home()  # reboots
        assert striker.state is StrikerState.HOMED
        striker.arm()
        striker.cock()
        plant.servo.fail(HardwareError.OVERLOAD)
        with pytest.raises(StrikerFault, match="overload"):
            striker.strike("s", 0.3)
        assert striker.state is StrikerState.FAULT


def test_silence_during_a_swing_is_a_fault_and_the_watchdog_stops_the_arm(plant: Plant, heard: Any) -> None:
    with heard.opened(plant.config()) as striker:
        home_arm_and_cock(striker)
        threading.Timer(0.06, plant.frozen.set).start()  # the cable breaks; the servo itself lives on
        with pytest.raises(StrikerLost, match="stopped answering"):
            striker.strike("s", 0.1)
        assert striker.state is StrikerState.FAULT
        time.sleep(0.15)
        assert abs(plant.omega) < 0.1
        assert plant.angle < -0.1
        plant.frozen.clear()
        time.sleep(0.05)
        striker.home()
        assert striker.state is StrikerState.HOMED


def test_retraction_continues_after_a_host_pause(plant: Plant, heard: Any) -> None:
    with heard.opened(plant.config()) as striker:
        home_arm_and_cock(striker)

        def stand_still(sample: Any) -> None:
            heard.samples.append(sample)
            if striker.state is StrikerState.CONTACT and not stood_still:
                stood_still.append(time.sleep(0.2))

        stood_still: list[None] = []
        striker._sample_sink = stand_still
        striker.strike("s", 0.3)
        assert stood_still
        assert abs(plant.angle - plant.config().cocked_angle_rad) < 0.01
        assert striker.state is StrikerState.DISARMED


def test_limits_are_written_to_eeprom_and_not_rewritten_by_a_second_open(plant: Plant, heard: Any) -> None:
    striker = heard.striker(plant.config(current_limit_a=0.8, temperature_limit_c=65))
    striker.open()
    registers = plant.servo.registers
    assert registers["Operating Mode"] == 5
    assert registers["Current Limit"] == round(0.8 / 2.69e-3)
    assert registers["Temperature Limit"] == 65
    assert registers["Shutdown"] == 52
    striker.home()
    striker.close()
    assert registers["Torque Enable"] == 0
    registers["Torque Enable"] = 1  # a daemon was killed: torque and nothing else left
    again = heard.striker(plant.config(current_limit_a=0.8, temperature_limit_c=65))
    again.open()
    assert (
        registers["Torque Enable"] == 1
    )  # nothing differs, so the torque stays on and the arm does not fall
    again.close()


def test_blocked_arm_is_a_fault(plant: Plant, heard: Any) -> None:
    with heard.opened(plant.config(current_limit_a=0.005, arming_expires_s=1.0)) as striker:
        with pytest.raises(StrikerError, match="moves freely"):
            striker.home()
        assert striker.state is StrikerState.FAULT


def test_dead_man_process_is_restarted_when_killed(plant: Plant, heard: Any) -> None:
    """No other process would switch the torque off when this one dies."""
    with heard.opened(plant.config()) as striker:
        first = striker._servo._dead_man
        os.kill(first.pid, signal.SIGKILL)
        assert wait_for(lambda: (now := striker._servo._dead_man) not in {None, first} and now.alive, 5.0)
        assert striker.state is StrikerState.DISARMED
