"""Virtual servo without a thread: the test is its clock, its arm and its host."""

from __future__ import annotations

import os
import struct
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest

from acquire.striker.control_table import control_table
from acquire.virtual.dynamixel_motor import TICK_RAD, VELOCITY_UNIT_RAD_S
from acquire.virtual.dynamixel_protocol import ALERT, Instruction, Parser, StatusError, encode
from acquire.virtual.dynamixel_servo import DynamixelServo, HardwareError, WireTime
from schemas.servo_models import SERVO_MODELS

TABLE = control_table("XM430-W210")
MODEL = SERVO_MODELS["XM430-W210"]
INERTIA = 0.0025


class Bench:
    """Servo with an arm, and the host's end of its bus."""

    def __init__(self, folder: Path, wire: WireTime | None = None) -> None:
        self.now_ns = 10**12
        self.angle = self.omega = 0.0
        self.servo = DynamixelServo(
            lambda: (self.angle, self.omega), lambda: self.now_ns, folder / "tty", seed=3, wire=wire
        )
        self.host = os.open(self.servo.port_path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.set_speed(termios.B1000000)
        self.parser = Parser()

    def set_speed(self, speed: int) -> None:
        mode = termios.tcgetattr(self.host)
        mode[4] = mode[5] = speed
        termios.tcsetattr(self.host, termios.TCSANOW, mode)

    def send(self, packet: bytes) -> list[tuple[int, bytes]]:
        """Send a packet to the servo; return error field and data of each of its answers."""
        os.write(self.host, packet)
        self.servo.service(self.now_ns)
        return self.receive()

    def receive(self) -> list[tuple[int, bytes]]:
        try:
            data = os.read(self.host, 4096)
        except BlockingIOError:
            return []
        return [(p.parameters[0], p.parameters[1:]) for p in self.parser.feed(data)]

    def read(self, name: str) -> int:
        register = TABLE[name]
        ((error, data),) = self.send(
            encode(1, Instruction.READ, struct.pack("<HH", register.address, register.size))
        )
        assert error & ~ALERT == 0
        return register.decode(data)

    def write(self, name: str, value: int) -> int:
        register = TABLE[name]
        ((error, _),) = self.send(
            encode(1, Instruction.WRITE, struct.pack("<H", register.address) + register.encode(value))
        )
        return error

    def set(self, **values: int) -> None:
        for name, value in values.items():
            assert self.write(name.replace("_", " "), value) == 0, name

    def run(self, seconds: float, talking: bool = True) -> None:
        for k in range(round(seconds * 1000)):
            torque = self.servo.torque(self.angle, self.omega, self.now_ns)
            self.omega += torque / INERTIA * 1e-3
            self.angle += self.omega * 1e-3
            self.now_ns += 1_000_000
            if talking and k % 20 == 0:
                self.send(encode(1, Instruction.PING, b""))


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    yield bench
    os.close(bench.host)
    bench.servo.close()


def test_ping_returns_model_and_firmware(bench: Bench) -> None:
    assert bench.send(encode(1, Instruction.PING, b"")) == [(0, struct.pack("<HB", 1030, 47))]
    assert bench.send(encode(0xFE, Instruction.PING, b"")) == [(0, struct.pack("<HB", 1030, 47))]
    assert bench.send(encode(2, Instruction.PING, b"")) == []


def test_servo_is_silent_at_another_baud_rate(bench: Bench) -> None:
    bench.set_speed(termios.B57600)
    assert bench.send(encode(1, Instruction.PING, b"")) == []
    bench.set_speed(termios.B1000000)
    assert len(bench.send(encode(1, Instruction.PING, b""))) == 1


def test_refused_writes_return_the_error_code(bench: Bench) -> None:
    assert bench.write("Present Position", 1) == StatusError.ACCESS
    assert bench.write("Operating Mode", 2) == StatusError.RANGE
    assert bench.write("Goal Position", 5000) == StatusError.LIMIT  # mode 3
    assert bench.send(encode(1, Instruction.WRITE, struct.pack("<HB", 116, 5))) == [(StatusError.LENGTH, b"")]
    assert bench.send(encode(1, Instruction.READ, struct.pack("<HH", 600, 2))) == [(StatusError.ACCESS, b"")]
    assert bench.send(encode(1, 0x77, b"")) == [(StatusError.INSTRUCTION, b"")]
    broken = bytearray(encode(1, Instruction.PING, b""))
    broken[-1] ^= 1
    assert bench.send(bytes(broken)) == [(StatusError.CRC, b"")]
    bench.set(Torque_Enable=1)
    assert bench.write("Operating Mode", 5) == StatusError.ACCESS


def test_a_sync_write_without_address_and_size_is_ignored(bench: Bench) -> None:
    assert bench.send(encode(0xFE, Instruction.SYNC_WRITE, b"\x41\x00\x01")) == []
    assert bench.read("LED") == 0


def test_a_sync_write_is_executed_and_not_answered(bench: Bench) -> None:
    assert bench.send(encode(0xFE, Instruction.SYNC_WRITE, struct.pack("<HHBB", 65, 1, 1, 1))) == []
    assert bench.read("LED") == 1


def test_velocity_mode_reaches_its_goal_and_the_watchdog_stops_it(bench: Bench) -> None:
    bench.set(Operating_Mode=1, Torque_Enable=1, Bus_Watchdog=5, Goal_Velocity=100)
    bench.run(0.5)
    assert bench.omega == pytest.approx(100 * VELOCITY_UNIT_RAD_S, rel=0.02)
    assert abs(bench.read("Present Velocity") - 100) <= 2
    bench.run(0.3, talking=False)
    assert abs(bench.omega) < 0.05
    assert bench.servo.registers["Bus Watchdog"] == 0xFF
    assert bench.write("Goal Velocity", 50) == StatusError.RANGE
    bench.set(Bus_Watchdog=0, Goal_Velocity=50)
    bench.run(0.3)
    assert bench.omega == pytest.approx(50 * VELOCITY_UNIT_RAD_S, rel=0.03)


def test_without_a_watchdog_it_keeps_turning(bench: Bench) -> None:
    bench.set(Operating_Mode=1, Torque_Enable=1, Goal_Velocity=100)
    bench.run(0.5, talking=False)
    assert bench.omega > 2.0


def test_position_modes_follow_their_profile(bench: Bench) -> None:
    bench.set(
        Operating_Mode=5,
        Torque_Enable=1,
        Profile_Velocity=50,
        Profile_Acceleration=5,
        Goal_Position=2048 + 652,
    )
    fastest = 0.0
    for _ in range(30):
        bench.run(0.05)
        fastest = max(fastest, bench.omega)
    assert fastest == pytest.approx(50 * VELOCITY_UNIT_RAD_S, rel=0.03)
    assert bench.angle == pytest.approx(652 * TICK_RAD, abs=5 * TICK_RAD)
    assert abs(bench.read("Present Position") - 2700) <= 5


def test_current_and_speed_are_limited(bench: Bench) -> None:
    bench.set(Operating_Mode=5, Goal_Current=200, Torque_Enable=1, Goal_Position=2048 + 1500)
    torque = bench.servo.torque(0.0, 0.0, bench.now_ns)
    assert torque == pytest.approx(200 * MODEL.current_unit_a * MODEL.torque_per_ampere, rel=0.01)
    bench.set(Torque_Enable=0)
    bench.set(Operating_Mode=16, Torque_Enable=1, Goal_PWM=885)
    bench.run(0.3)
    assert 0.9 * MODEL.no_load_rad_s < bench.omega < MODEL.no_load_rad_s


def test_drag_without_torque_brakes_but_does_not_reverse(bench: Bench) -> None:
    bench.omega = 3.0
    lowest = 3.0
    for _ in range(800):
        bench.run(0.001)
        lowest = min(lowest, bench.omega)
    assert 0 <= lowest < 0.01


def test_a_hardware_error_alerts_and_a_reboot_clears_it(bench: Bench) -> None:
    bench.set(Torque_Enable=1)
    bench.servo.fail(HardwareError.OVERLOAD)
    assert bench.read("Torque Enable") == 0
    assert bench.write("Torque Enable", 1) == ALERT | StatusError.RESULT
    bench.send(encode(1, Instruction.REBOOT, b""))
    assert bench.send(encode(1, Instruction.PING, b"")) == []  # still booting
    bench.now_ns += 200_000_000
    assert bench.read("Hardware Error Status") == 0
    assert bench.read("Realtime Tick") < 100


def test_temperature_above_the_limit_switches_the_torque_off(bench: Bench) -> None:
    bench.set(Temperature_Limit=60, Torque_Enable=1)
    bench.servo.registers["Present Temperature"] = 61
    bench.run(0.002)
    assert bench.read("Hardware Error Status") == 1 << HardwareError.OVERHEATING
    assert bench.read("Torque Enable") == 0


def test_tick_counts_milliseconds_with_drift(bench: Bench) -> None:
    first = bench.read("Realtime Tick")
    bench.now_ns += 20_000_000_000
    assert (bench.read("Realtime Tick") - first) % 32768 == pytest.approx(20_000, abs=2)


def test_position_between_two_steps_is_interpolated(bench: Bench) -> None:
    bench.set(Operating_Mode=1, Torque_Enable=1, Goal_Velocity=330)
    bench.run(0.5)
    bench.servo.torque(bench.angle, bench.omega, bench.now_ns)
    start, begin_ns = bench.angle, bench.now_ns
    bench.angle += bench.omega * 1e-3
    for late_ns in (
        400_000,
        900_000,
        1_700_000,
    ):  # within the step, and after it while the next is not taken yet
        bench.now_ns = begin_ns + late_ns
        expected = (start + bench.omega * late_ns * 1e-9) / TICK_RAD + 2048
        assert bench.read("Present Position") == pytest.approx(expected, abs=1.2)


def test_wire_time_delays_the_answer(tmp_path: Path) -> None:
    bench = Bench(tmp_path, WireTime(adapter_ns=1_000_000))
    try:
        assert bench.send(encode(1, Instruction.PING, b"")) == []
        due = bench.servo.next_answer_ns
        assert due is not None
        assert (
            due - bench.now_ns == 1_000_000 + 500_000 + (10 + 14) * 10_000
        )  # adapter, Return Delay Time 250, 24 bytes at 1 Mbit/s
        bench.now_ns = due
        bench.servo.service(bench.now_ns)
        assert len(bench.receive()) == 1
    finally:
        os.close(bench.host)
        bench.servo.close()
