"""Late answers of a servo: none of them is taken for the answer to a later request."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
import tty
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerLost, StrikerNotFound
from acquire.striker.bus import Block, ServoBus
from acquire.virtual.dynamixel_protocol import Parser, encode

TORQUE = SimpleNamespace(address=64, size=1, name="Torque Enable", encode=lambda value: bytes([value]))


ATTEMPTS = 20
"""largest number of requests until one is answered in time; on a busy computer the servo's thread may be late
by itself"""


class LateServo:
    """Fake servo whose next `late_reads` answers to reads come late, or that answers no write.

    Models no registers: a read gives its own address.
    """

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(self.slave)
        self.late_reads = 0
        self.late_s = 0.06
        self.deaf_to_writes = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self.master)
        os.close(self.slave)

    def _run(self) -> None:
        parser = Parser()
        while not self._stop.is_set():
            if select.select([self.master], [], [], 0.02)[0]:
                for packet in parser.feed(os.read(self.master, 1024)):
                    self._answer(int(packet.instruction), packet.parameters)

    def _answer(self, instruction: int, parameters: bytes) -> None:
        if instruction == 1:
            os.write(self.master, encode(1, 0x55, bytes([0]) + (1030).to_bytes(2, "little") + b"\x2d"))
        elif instruction == 2:
            answer = encode(
                1, 0x55, bytes([0]) + bytes([parameters[0]]) * int.from_bytes(parameters[2:4], "little")
            )
            if self.late_reads:
                self.late_reads -= 1
                time.sleep(self.late_s)  # all later answers are late too: a servo answers in order
            os.write(self.master, answer)
        elif not self.deaf_to_writes:
            os.write(self.master, encode(1, 0x55, bytes([0])))


def in_time(request: Callable[[], object]) -> object:
    """Answer to a request, made again up to `ATTEMPTS` times if it is not answered in time."""
    for _ in range(ATTEMPTS - 1):
        with contextlib.suppress(StrikerLost, StrikerNotFound):
            return request()
    return request()


def answered(bus: ServoBus, address: int) -> Block:
    """Block of four bytes, read until it is answered in time, up to `ATTEMPTS` times."""
    block = next(filter(None, (bus.read_block(address, 4) for _ in range(ATTEMPTS))), None)
    assert block is not None
    return block


@pytest.fixture
def servo():
    one = LateServo()
    yield one
    one.close()


@pytest.fixture
def bus(servo):
    one = ServoBus(os.ttyname(servo.slave), 1_000_000, 1, SystemClock())
    assert in_time(one.open) == 1030
    yield one
    one.close()


def test_late_read_does_not_confirm_a_write(servo, bus):
    servo.late_reads = 1
    assert bus.read_block(126, 10) is None
    servo.deaf_to_writes = True
    with pytest.raises(StrikerLost, match="Torque Enable"):
        bus.write(TORQUE, 0)


@pytest.mark.parametrize("late_s", [0.02, 0.05, 0.055, 0.06, 0.065, 0.1, 0.15, 0.3])
def test_late_answer_is_not_taken_for_the_next_read(servo, bus, late_s):
    servo.late_reads, servo.late_s = 1, late_s
    blocks = {address: bus.read_block(address, 4) for address in (126, 64, 70, 76, 82, 88, 94, 100)}
    blocks[106] = answered(bus, 106)
    for address, block in blocks.items():
        assert block is None or block.data == bytes([address]) * 4


def test_bus_works_after_a_late_answer(servo, bus):
    servo.late_reads = 1
    assert bus.read_block(126, 10) is None
    in_time(lambda: bus.write(TORQUE, 0))
    assert answered(bus, 116).data == bytes([116]) * 4
