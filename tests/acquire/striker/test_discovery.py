"""Search for servos on a serial port: protocol 2 and the older protocol 1."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from acquire.errors import StrikerError
from acquire.striker import discovery
from acquire.striker.discovery import FoundServo, discover_servos
from tests.acquire.striker.plant import Plant

ONE_RATE = (1_000_000,)


@contextmanager
def old_servo(number: int, servo_id: int) -> Iterator[str]:
    """Servo of protocol 1 on a pseudo-terminal: answers pings and readings of its model number.

    Yields:
        Path of its port.
    """
    host, servo = os.openpty()
    tty.setraw(servo)
    ended = threading.Event()

    def answer() -> None:
        waiting = b""
        while not ended.is_set():
            try:
                waiting += os.read(host, 64)
            except OSError:
                return
            while len(waiting) >= 6:
                packet = waiting[: 4 + waiting[3]]
                sound = packet[:2] == b"\xff\xff" and ~sum(packet[2:]) & 0xFF == 0
                waiting = waiting[len(packet) if sound else 1 :]
                if not sound or packet[2] != servo_id:
                    continue
                data = number.to_bytes(2, "little") if packet[4] == 2 else b""
                body = bytes([servo_id, 2 + len(data), 0]) + data
                os.write(host, b"\xff\xff" + body + bytes([~sum(body) & 0xFF]))

    thread = threading.Thread(target=answer, name="old-servo", daemon=True)
    thread.start()
    try:
        yield os.ttyname(servo)
    finally:
        ended.set()
        os.close(servo)
        thread.join()
        os.close(host)


def test_a_servo_is_found_with_its_rig_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "BAUD_RATES", ONE_RATE)
    monkeypatch.setattr(discovery, "OLD_BAUD_RATES", ())
    with Plant(tmp_path, model="XL330-M288", memory={"Firmware Version": 36}) as plant:
        asked: list[str] = []
        [found] = discover_servos([str(plant.servo.port_path)], asked.append)
    assert asked == [f"{plant.servo.port_path} at 1000000 bit/s"]
    assert (found.name, found.id, found.protocol) == ("XL330-M288", 1, 2)
    assert found.remedy == "firmware 36: update it to 38 or later with DYNAMIXEL Wizard 2.0"
    assert 'model = "XL330-M288"' in found.rig_lines()


def test_an_ax_12_is_told_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "BAUD_RATES", ONE_RATE)
    monkeypatch.setattr(discovery, "OLD_IDS", range(1, 4))
    with old_servo(12, 2) as port:
        [found] = discover_servos([port], lambda _: None)
    assert found == FoundServo(port, 1_000_000, 2, 12, None, 1)
    assert found.remedy.startswith("the servo is an AX-12, which has no current limit")


def test_a_port_that_is_missing_is_named() -> None:
    with pytest.raises(StrikerError, match="/dev/ttyNone: no such serial port"):
        list(discover_servos(["/dev/ttyNone"], lambda _: None))
