"""Virtual Dynamixel servo behind a pseudo-terminal: protocol 2.0 in, torque on the arm out.

Not modelled: indirect addressing, homing offset in the goal limits, secondary ID, what Startup Configuration
does, the acceleration time of profiles by time, instructions that the striker never sends (group reads, bulk
and registered writes, factory reset, clear), the overshoot of a real velocity estimate, backlash, cogging,
heating (a test sets the temperature), voltage sag, noise and collisions on the bus. Of several servos on one
bus only this one answers.
"""

from __future__ import annotations

import contextlib
import math
import os
import random
import struct
import termios
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from acquire.virtual.dynamixel_motor import (
    FULL_DUTY,
    TICK_RAD,
    TORQUE_BY_GOAL,
    VELOCITY_UNIT_RAD_S,
    ZERO_TICKS,
    Motor,
    sign,
)
from acquire.virtual.dynamixel_protocol import (
    ALERT,
    BROADCAST,
    Instruction,
    Packet,
    Parser,
    StatusError,
    encode,
)
from acquire.virtual.dynamixel_registers import WATCHDOG_TRIPPED, Registers
from acquire.virtual.pty_device import PtyDevice
from schemas.servo_models import SERVO_MODELS, ModelName

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

BAUD_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""bit/s by value of the Baud Rate register"""
_SPEED_OF_TERMIOS = {
    getattr(termios, f"B{baud}"): baud for baud in BAUD_RATES if hasattr(termios, f"B{baud}")
}

WATCHDOG_UNIT_NS = 20_000_000
REBOOT_NS = 150_000_000
"""time during which a rebooting servo does not answer [ns]"""
OVERLOAD_NS = 1_000_000_000
"""time near the stall current after which the servo reports an overload [ns]"""
POSITION_NOISE_TICKS = 0.15
"""standard deviation of the position reading [ticks of 2 pi / 4096 rad]"""
CLOCK_DRIFT_MAX = 50e-6
"""largest relative rate error of the servo's clock"""
STEP_NS = 1_000_000
"""time between calls of `torque` [ns]; the plant's state is then that at the end of the step"""
EXTRAPOLATION_MAX_NS = 1_000_000
"""longest time over which the arm's position is extrapolated beyond the last step [ns]"""


class HardwareError:
    """Bit numbers of the register Hardware Error Status.

    An error whose bit is set in the register Shutdown (52 by default: bits 2, 4 and 5) also switches the
    torque off.
    """

    INPUT_VOLTAGE = 0
    OVERHEATING = 2
    ENCODER = 3
    ELECTRICAL_SHOCK = 4
    OVERLOAD = 5


@dataclass(frozen=True)
class WireTime:
    """Delay of the servo's answers on a wire, with the constant part `adapter_ns` of the USB adapter.

    The delay is the sum of the transmission time of request and answer at the baud rate, the time in the
    register Return Delay Time, and `adapter_ns` [ns].
    """

    adapter_ns: int = 1_000_000
    """constant delay of the USB adapter [ns]: some 500 readings a second are possible with this one"""


class DynamixelServo(PtyDevice):
    """Virtual servo, owned by the loop that also steps the physics.

    Call `service` as soon as `fd`, the pseudo-terminal's descriptor, is readable: the host takes the middle
    of its read as the sample's time, so an answer that waits for the next physics step makes that time wrong
    by up to half the wait. Call `torque` once per physics step.

    Args:
        plant: function that returns position [rad] and velocity [rad/s] of the arm after the last physics
            step; 0 rad = 2048 ticks, positive towards more ticks.
        clock_ns: the world's clock (CLOCK_MONOTONIC) [ns], read once at power-up.
        link_path: symbolic link to create for the pty; an existing one is replaced.
        seed: seed of noise and clock drift.
        baud_rate: baud rate stored in the EEPROM.
        wire: delay of the answers; None to answer at once.
        model: name of the servo's model.
        memory: values of registers that a former user changed, and the firmware's version.
    """

    def __init__(
        self,
        plant: Callable[[], tuple[float, float]],
        clock_ns: Callable[[], int],
        link_path: Path,
        seed: int = 0,
        baud_rate: int = 1_000_000,
        wire: WireTime | None = WireTime(),
        model: ModelName = "XM430-W210",
        memory: Mapping[str, int] | None = None,
    ) -> None:
        self._plant = plant
        self._random = random.Random(seed)  # noqa: S311 - noise, not a secret
        self._drift = 1.0 + self._random.uniform(-CLOCK_DRIFT_MAX, CLOCK_DRIFT_MAX)
        self._wire = wire
        self._model = SERVO_MODELS[model]
        self.registers = Registers(1, BAUD_RATES.index(baud_rate), model, memory)
        self.registers.reboot()
        self._motor = Motor(self._model)
        self._parser = Parser()
        self._answers: deque[tuple[int, bytes]] = deque()
        now_ns = clock_ns()
        self._boot_ns = now_ns - self._random.randrange(32_768_000_000)  # powered for some time already
        self._online_ns = now_ns
        self._received_ns = now_ns
        self._stepped_ns, self._arm = now_ns, plant()
        self._overload_since_ns: int | None = None
        self._measure(now_ns)
        self.registers["Goal Position"] = self.registers["Present Position"]
        super().__init__(link_path)

    def on_unplugged(self) -> None:
        """Drop waiting answers; registers and motion are not affected."""
        self._answers.clear()

    # --- arm

    def torque(self, position_rad: float, velocity_rad_s: float, now_ns: int) -> float:
        """Torque on the arm [N m] for the physics step that begins now; only drag while the torque is off.

        Also trips the bus watchdog after silence on the bus, and raises a hardware error on overheating or
        overload.

        Args:
            position_rad: angle of the arm at `now_ns` [rad].
            velocity_rad_s: angular velocity of the arm at `now_ns` [rad/s].
            now_ns: world time [ns] at which the step begins, with this position and velocity.
        """
        dt = min(0.005, max(0.0, (now_ns - self._stepped_ns) * 1e-9)) or 0.001
        self._stepped_ns, self._arm = now_ns, (position_rad, velocity_rad_s)
        watchdog = self.registers["Bus Watchdog"]
        guarded = 0 < watchdog < WATCHDOG_TRIPPED and self.registers["Torque Enable"]
        if guarded and now_ns - self._received_ns > watchdog * WATCHDOG_UNIT_NS:
            self.registers["Bus Watchdog"] = WATCHDOG_TRIPPED
        torque = self._motor.step(self.registers, position_rad, velocity_rad_s, dt)
        self._protect(now_ns)
        return torque

    def _protect(self, now_ns: int) -> None:
        if self.registers["Present Temperature"] > self.registers["Temperature Limit"]:
            self.fail(HardwareError.OVERHEATING)
        if abs(self._motor.current) < 0.9 * self._model.stall_current_a:
            self._overload_since_ns = None
        elif self._overload_since_ns is None:
            self._overload_since_ns = now_ns
        elif now_ns - self._overload_since_ns > OVERLOAD_NS:
            self.fail(HardwareError.OVERLOAD)

    def fail(self, bit: int) -> None:
        """Raise a hardware error: every answer carries ALERT (0x80 in its error byte) until a reboot.

        The torque goes off if the bit is set in the register Shutdown.

        Args:
            bit: bit number in the register Hardware Error Status, a constant of HardwareError.
        """
        self.registers["Hardware Error Status"] |= 1 << bit
        if self.registers["Shutdown"] >> bit & 1:
            self.registers["Torque Enable"] = 0

    def _position_ticks(self, position: float) -> int:
        offset = self.registers["Homing Offset"]
        noise = self._random.gauss(0.0, POSITION_NOISE_TICKS)
        ticks = sign(self.registers) * position / TICK_RAD + ZERO_TICKS + offset + noise
        return round(ticks) % 4096 if self.registers["Operating Mode"] == 3 else round(ticks)

    def _position(self, now_ns: int) -> float:
        """Angle of the arm [rad] at the world time `now_ns`, interpolated within the last physics step.

        After the step's end it is extrapolated, by 1 ms at most.
        """
        (before, _), (after, velocity) = self._arm, self._plant()
        late_ns = min(EXTRAPOLATION_MAX_NS, now_ns - self._stepped_ns - STEP_NS)
        if late_ns >= 0:
            return after + velocity * late_ns * 1e-9
        return before + (after - before) * max(0, now_ns - self._stepped_ns) / STEP_NS

    def _measure(self, now_ns: int) -> None:
        """Set the registers that report measurements to their values at the world time `now_ns`.

        They are Realtime Tick, Position Trajectory, Moving, and Present Position, Velocity, Current and PWM.
        """
        position = self._position(now_ns)
        registers = self.registers
        registers["Realtime Tick"] = int((now_ns - self._boot_ns) * self._drift / 1e6) & 0x7FFF
        registers["Present Position"] = self._position_ticks(position)
        way, model = sign(registers), self._model
        duty = max(-1.0, min(1.0, self._motor.current / model.stall_current_a))
        registers["Present Velocity"] = way * round(self._motor.velocity / VELOCITY_UNIT_RAD_S)
        registers["Present Current"] = way * round(self._motor.current / model.current_unit_a)
        registers["Present PWM"] = way * round(FULL_DUTY * duty)
        registers["Position Trajectory"] = way * round(self._motor.reference / TICK_RAD) + ZERO_TICKS
        registers["Moving"] = int(abs(registers["Present Velocity"]) > registers["Moving Threshold"])

    # --- bus

    def service(self, now_ns: int) -> None:
        """Read received packets, execute them and send the answers that are due. Never blocks.

        Call only while the servo is plugged in. An answer that no client reads may be lost.

        Args:
            now_ns: host monotonic time [ns].
        """
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self.fd, 4096):
                self._receive(data, now_ns)
        while self._answers and self._answers[0][0] <= now_ns:
            with contextlib.suppress(BlockingIOError):  # no reader: the bytes are lost, as on a wire
                os.write(self.fd, self._answers.popleft()[1])

    @property
    def next_answer_ns(self) -> int | None:
        """Host monotonic time [ns] at which the next delayed answer is due; None if no answer waits.

        A servo made without delay (`wire` None) sends every answer within `service`, so that none waits.
        """
        return self._answers[0][0] if self._answers else None

    def _receive(self, data: bytes, now_ns: int) -> None:
        baud = BAUD_RATES[self.registers["Baud Rate"]]
        if _SPEED_OF_TERMIOS.get(termios.tcgetattr(self.fd)[5]) != baud or now_ns < self._online_ns:
            return  # noise at another speed, or still booting
        for packet in self._parser.feed(data):
            self._received_ns = now_ns
            answer = self._handle(packet, now_ns)
            if answer:
                due_ns = now_ns
                if self._wire is not None:
                    transmission_ns = (len(data) + len(answer)) * 10**10 // baud
                    due_ns += (
                        self._wire.adapter_ns + self.registers["Return Delay Time"] * 2000 + transmission_ns
                    )
                self._answers.append((due_ns, answer))

    def _handle(self, packet: Packet, now_ns: int) -> bytes:
        """Execute a packet received at `now_ns` (host monotonic), and return the bytes of the servo's answer.

        Empty if the servo does not answer: to a sync write, a packet for another servo, an answer of another
        servo, a packet for all servos other than an intact ping, or as the register Status Return Level
        demands.
        """
        if packet.instruction == Instruction.SYNC_WRITE:
            if packet.intact and len(packet.parameters) >= 4:
                self._sync_write(packet.parameters)
            return b""
        if packet.id not in {self.registers["ID"], BROADCAST} or packet.instruction == Instruction.STATUS:
            return b""
        if not packet.intact:
            return self._status(StatusError.CRC) if packet.id != BROADCAST else b""
        return self._handle_single(packet, now_ns)

    def _handle_single(self, packet: Packet, now_ns: int) -> bytes:
        own_id = self.registers["ID"]
        self._measure(now_ns)
        if packet.instruction == Instruction.PING:
            identity = struct.pack("<HB", self._model.number, self.registers["Firmware Version"])
            return self._status(StatusError.NONE, identity, level=0)
        if packet.instruction == Instruction.READ and packet.id == own_id and len(packet.parameters) == 4:
            error, data = self.registers.read(*struct.unpack("<HH", packet.parameters))
            return self._status(error, data, level=1)
        error = self._execute(packet)
        answer = self._status(error, servo_id=own_id) if packet.id != BROADCAST else b""
        if packet.instruction == Instruction.REBOOT:
            self._reboot(now_ns)
        return answer

    def _execute(self, packet: Packet) -> StatusError:
        parameters = packet.parameters
        if packet.instruction == Instruction.WRITE and len(parameters) > 2:
            return self._write(int.from_bytes(parameters[:2], "little"), parameters[2:])
        return StatusError.NONE if packet.instruction == Instruction.REBOOT else StatusError.INSTRUCTION

    def _sync_write(self, parameters: bytes) -> None:
        address, size = struct.unpack_from("<HH", parameters)
        for k in range(4, len(parameters) - size, size + 1):
            if parameters[k] == self.registers["ID"]:
                self._write(address, parameters[k + 1 : k + 1 + size])

    def _alert(self) -> int:
        return ALERT if self.registers["Hardware Error Status"] else 0

    def _status(
        self, error: StatusError, data: bytes = b"", *, level: int = 2, servo_id: int | None = None
    ) -> bytes:
        if self.registers["Status Return Level"] < level:
            return b""
        sender = self.registers["ID"] if servo_id is None else servo_id
        return encode(sender, Instruction.STATUS, bytes([error | self._alert()]) + data)

    def _write(self, address: int, data: bytes) -> StatusError:
        was_on = self.registers["Torque Enable"]
        error, names = self.registers.write(address, data)
        if "Operating Mode" in names:
            self.registers["Goal Current"] = self.registers["Current Limit"]
        if "Goal Position" in names and self.registers["Drive Mode"] & TORQUE_BY_GOAL and not was_on:
            self.registers["Torque Enable"] = 1
            self._motor.hold(self._plant()[0])
        if "Torque Enable" in names and self.registers["Torque Enable"] and not was_on:
            position, _ = self._plant()
            self._motor.hold(position)
            ticks = math.floor(sign(self.registers) * position / TICK_RAD + 0.5) + ZERO_TICKS
            self.registers["Goal Position"] = ticks + self.registers["Homing Offset"]
        return error

    def _reboot(self, now_ns: int) -> None:
        self.registers.reboot()
        self._motor = Motor(self._model)
        self._boot_ns = self._online_ns = now_ns + REBOOT_NS
        self._measure(now_ns)
        self.registers["Goal Position"] = self.registers["Present Position"]
