"""Faults of the servo and its cable, on the striker alone: quick enough for every run.

Rows of docs/reference/faults.md.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerFault, StrikerLost, StrikerNotFound
from acquire.striker.base import StrikerState
from acquire.striker.dynamixel import DynamixelStriker
from acquire.virtual.dynamixel_servo import HardwareError
from schemas.proto import percuss_pb2 as pb
from tests.acquire.striker.plant import Plant
from tests.system.fault_rig import add_row

SLOW_M_S = 0.15


@pytest.fixture
def plant(tmp_path: Path) -> Iterator[Plant]:
    with Plant(tmp_path, gap=0.0) as plant:
        yield plant


@pytest.fixture
def events() -> list[pb.StrikerEvent]:
    return []


@pytest.fixture
def striker(plant: Plant, events: list[pb.StrikerEvent]) -> Iterator[DynamixelStriker]:
    striker = DynamixelStriker(plant.config(), lambda _: None, events.append, lambda _: None, SystemClock())
    yield striker
    striker.close()


def cocked(striker: DynamixelStriker) -> None:
    striker.open()
    striker.home()
    striker.arm()
    striker.cock()


def in_mid_swing(plant: Plant, act) -> list[int]:
    """Call `act` from a thread during the next swing, if one begins within 3 s.

    Returns:
        List to which the thread appends the host monotonic time after the call [ns].
    """
    done: list[int] = []

    def wait_and_act() -> None:
        end = time.monotonic() + 3.0
        while not (plant.omega > 1.0 and plant.angle > -0.5):
            if time.monotonic() > end:
                return
            time.sleep(0.001)
        act()
        done.append(time.monotonic_ns())

    threading.Thread(target=wait_and_act).start()
    return done


def moved_after_s(plant: Plant, since_ns: int) -> float:
    return (
        max((t - since_ns for t, _, omega in plant.history if t > since_ns and abs(omega) > 0.1), default=0)
        * 1e-9
    )


def again_s(striker: DynamixelStriker) -> float:
    start = time.monotonic()
    striker.home()
    assert striker.state is StrikerState.HOMED
    striker.arm()
    return time.monotonic() - start


def test_unplugged_in_mid_swing_and_back(
    plant: Plant, striker: DynamixelStriker, events: list[pb.StrikerEvent]
) -> None:
    cocked(striker)
    done = in_mid_swing(plant, plant.unplug)
    with pytest.raises(StrikerLost):
        striker.strike("s", SLOW_M_S)
    assert striker.state is StrikerState.FAULT
    assert events[-1].kind == pb.StrikerEvent.FAULT
    time.sleep(0.25)
    moved_s = moved_after_s(plant, done[0])
    assert moved_s < 0.2
    assert plant.angle < -0.1  # it did not swing through
    with pytest.raises(StrikerNotFound, match="check the cable"):
        striker.home()
    assert striker.state is StrikerState.FAULT
    plant.plug_in()
    back_s = again_s(striker)
    assert back_s < 3.0
    add_row(
        "servo's adapter unplugged in mid-swing, and plugged in again",
        f"this strike; the arm stands after {1e3 * moved_s:.0f} ms (bus watchdog)",
        f"{back_s:.1f} s after the next `home`",
    )


def test_alert_in_mid_swing(plant: Plant, striker: DynamixelStriker) -> None:
    cocked(striker)
    done = in_mid_swing(plant, lambda: plant.servo.fail(HardwareError.INPUT_VOLTAGE))
    with pytest.raises(StrikerFault, match="input voltage"):
        striker.strike("s", SLOW_M_S)
    off_s = (time.monotonic_ns() - done[0]) * 1e-9
    assert off_s < 0.1
    assert plant.servo.registers["Torque Enable"] == 0
    back_s = again_s(striker)
    assert back_s < 4.0
    add_row(
        "servo reports ALERT in mid-swing",
        f"this strike; torque off after {1e3 * off_s:.0f} ms",
        f"{back_s:.1f} s: `home` reboots it",
    )


def test_wrong_baud_rate(plant: Plant) -> None:
    striker = DynamixelStriker(
        plant.config(baud_rate=57_600), lambda _: None, lambda _: None, lambda _: None, SystemClock()
    )
    start = time.monotonic()
    with pytest.raises(
        StrikerNotFound,
        match="no servo with id 1 answers at 57600 bit/s; check its power, and `id` and `baud_rate`",
    ) as raised:
        striker.open()
    told_s = time.monotonic() - start
    assert told_s < 1.0
    assert "\n" not in str(raised.value)
    striker.close()
    add_row(
        "wrong baud rate in the rig file",
        f"nothing: refused in one line after {told_s:.1f} s",
        "at the next start with the right one",
    )


def test_a_second_program_on_the_serial_port(plant: Plant, striker: DynamixelStriker) -> None:
    cocked(striker)
    other = DynamixelStriker(plant.config(), lambda _: None, lambda _: None, lambda _: None, SystemClock())
    start = time.monotonic()
    with pytest.raises(StrikerNotFound, match="in use by another program; `fuser"):
        other.open()
    told_s = time.monotonic() - start
    other.close()
    assert striker.strike("s", 0.3).contacts == 1  # the first did not notice
    add_row(
        "second program on the serial port",
        f"nothing: refused in one line after {told_s:.2f} s; the first keeps running",
        "at once",
    )


@pytest.mark.parametrize("hours", [1.0, -1.0])
def test_wall_clock_steps_in_mid_swing(
    plant: Plant, striker: DynamixelStriker, monkeypatch: pytest.MonkeyPatch, hours: float
) -> None:
    cocked(striker)
    real, shift = time.time, [0.0]
    monkeypatch.setattr(time, "time", lambda: real() + shift[0])
    monkeypatch.setattr(time, "time_ns", lambda: int((real() + shift[0]) * 1e9))

    def step() -> None:
        shift[0] = 3600 * hours

    for _ in range(3):
        try:
            done = in_mid_swing(plant, step)
            outcome = striker.strike("s", 0.3)
            break
        except StrikerLost:  # a busy host let the virtual servo miss its answers
            shift[0] = 0.0
            plant.restore(gap=0.0)
            again_s(striker)
            striker.cock()
    assert done
    assert outcome.contacts == 1
    assert outcome.contact_time_ns is not None
    assert abs(outcome.contact_time_ns - plant.touches[0].time_ns) < 5e6
