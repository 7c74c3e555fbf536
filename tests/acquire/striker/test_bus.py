from __future__ import annotations

import os
import tty
from typing import Any

import pytest

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerError, StrikerLost, StrikerNotFound, StrikerRefused
from acquire.striker.bus import ServoBus
from acquire.striker.control_table import Register, control_table
from tests.acquire.striker.plant import Plant


@pytest.fixture
def bus(plant: Plant) -> Any:
    bus = ServoBus(str(plant.servo.port_path), 1_000_000, 1, SystemClock())
    yield bus
    bus.close()


def test_missing_port_servo_or_baud_rate_is_named(plant: Plant) -> None:
    port = str(plant.servo.port_path)
    with pytest.raises(StrikerNotFound, match="no such serial port"):
        ServoBus("/dev/ttyNOPE", 1_000_000, 1, SystemClock()).open()
    with pytest.raises(StrikerNotFound, match="no servo with id 9 answers at 1000000"):
        ServoBus(port, 1_000_000, 9, SystemClock()).open()
    with pytest.raises(StrikerNotFound, match="answers at 57600 bit/s"):
        ServoBus(port, 57600, 1, SystemClock()).open()
    with pytest.raises(StrikerNotFound, match="not a baud rate"):
        ServoBus(port, 12345, 1, SystemClock()).open()


def test_port_in_use_is_refused_until_closed(bus: ServoBus, plant: Plant) -> None:
    assert bus.open() == 1030
    other = ServoBus(bus.port, 1_000_000, 1, SystemClock())
    with pytest.raises(StrikerNotFound, match="in use by another program"):
        other.open()
    bus.close()
    assert other.open() == 1030
    other.close()


def test_registers_are_signed_and_refusals_give_the_reason(bus: ServoBus) -> None:
    bus.open()
    table = control_table("XM430-W210")
    bus.write(table["Operating Mode"], 5)
    bus.write(table["Current Limit"], 400)
    bus.write(table["Goal Position"], -500)
    assert bus.read(table["Goal Position"]) == -500
    bus.write(table["Torque Enable"], 1)
    with pytest.raises(StrikerError, match="EEPROM is locked"):
        bus.write(table["Shutdown"], 53)
    with pytest.raises(StrikerError, match="exceeds a limit"):
        bus.write(table["Goal Current"], 500)
    with pytest.raises(StrikerRefused, match="stuff"):
        bus.write(Register("anything", 116, 4), 0x00FDFFFF)
    bus.write(table["Torque Enable"], 0)


def test_unplugged_adapter_is_reported_as_lost_not_busy() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    bus = ServoBus(os.ttyname(slave), 1_000_000, 1, SystemClock())
    with pytest.raises(StrikerNotFound):
        bus.open()
    bus = ServoBus(os.ttyname(slave), 1_000_000, 1, SystemClock())
    os.close(slave)
    os.close(master)
    with pytest.raises(StrikerNotFound):
        bus.open()
    with pytest.raises(StrikerLost, match="closed"):
        bus.read(control_table("XM430-W210")["Shutdown"])
