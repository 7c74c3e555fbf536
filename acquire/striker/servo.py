"""The arm's servo in SI units and arm angles: limits, gains, samples, moves. Register names are the vendor's."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from acquire.errors import StrikerError, StrikerFault, StrikerLost, StrikerNotFound
from acquire.striker.bus import Block, MonotonicClock, ServoBus
from acquire.striker.control_table import MODEL_FILES, MODEL_NAMES, Register, control_table

if TYPE_CHECKING:
    from acquire.config import StrikerConfig

TICK_RAD = 2 * math.pi / 4096
VELOCITY_UNIT_RAD_S = 0.229 * 2 * math.pi / 60
ACCELERATION_UNIT_RAD_S2 = 214.577 * 2 * math.pi / 3600
CURRENT_UNIT_A = 2.69e-3
CURRENT_BASED_POSITION = 5
SHUTDOWN = 52
"""overheating, electrical shock, overload take the torque off"""
WATCHDOG_UNITS = 5
"""of 20 ms: a killed host stops the motor after 100 ms; without it the servo keeps turning"""
WATCHDOG_TRIPPED = 0xFF
POSITION_P_GAIN = 1600
"""twice the default: the arm's weight then shifts it by 2 ticks, and it follows a swing within 10 ms"""
TICK_WRAP = 32768
RUN_THROUGH_RAD = 0.35
"""a swing aims this far beyond the impact point, so that it is at constant speed there"""
_BLOCK = struct.Struct("<HBBhhii")  # 120 Realtime Tick, Moving, Moving Status, Present PWM, Current, Velocity, 132 Position

_ERROR_BITS = {
    0: "input voltage; check the supply",
    2: "overheating; let it cool",
    3: "motor encoder; the servo needs repair",
    4: "electrical shock; check the supply and the wiring",
    5: "overload; check that the arm moves freely",
}


def hardware_error_text(status: int) -> str | None:
    """What a value of Hardware Error Status says, in words; None when all is well."""
    if not status:
        return None
    texts = [text for bit, text in _ERROR_BITS.items() if status >> bit & 1]
    return f"hardware error status {status}: {'; '.join(texts) or 'unknown bit'}"


@dataclass(frozen=True, slots=True)
class Sample:
    """One read of the servo, in arm angles: 0 = impact point, + towards the object."""

    host_before_ns: int
    host_after_ns: int
    tick_ms: int
    position_rad: float
    velocity_rad_s: float
    current_a: float

    @property
    def time_ns(self) -> int:
        """Middle of the read, host monotonic."""
        return (self.host_before_ns + self.host_after_ns) // 2


class Servo:
    """One Dynamixel that drives the arm.

    Args:
        config: port, zero, direction and limits.
        clock: host monotonic time.
    """

    def __init__(self, config: StrikerConfig, clock: MonotonicClock) -> None:
        self._config = config
        self._bus = ServoBus(config.port, config.baud_rate, config.id, clock)
        self._table: dict[str, Register] = {}

    # --- open and close ---------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Take the port, check the model, write the limits and read them back.

        Raises:
            StrikerNotFound: no such port, port in use, no servo, or one that cannot limit its current.
            StrikerError: a limit reads back differently.
        """
        model = self._bus.open()
        try:
            if model not in MODEL_FILES:
                known = ", ".join(MODEL_NAMES.values())
                raise StrikerNotFound(f"{self._config.port}: the servo is of model {model}, which has no tested current limit; use {known}")
            self._table = control_table(model)
            self._bus.write(self._table["Bus Watchdog"], 0)  # torque stays on over a restart, and so does a watchdog that tripped
            self._write_limits()
        except Exception:
            self._bus.close()
            raise

    def close(self) -> None:
        """Release the port. Always safe."""
        self._bus.close()

    @property
    def is_open(self) -> bool:
        """Whether the port is ours."""
        return self._bus.is_open

    def _limits(self) -> dict[str, int]:
        config = self._config
        ends = sorted(self.ticks(angle) for angle in (config.cocked_angle_rad - 0.3, RUN_THROUGH_RAD + 0.15))
        return {
            "Return Delay Time": 0,
            "Operating Mode": CURRENT_BASED_POSITION,
            "Temperature Limit": min(100, config.temperature_limit_c),
            "Current Limit": min(1193, round(config.current_limit_a / CURRENT_UNIT_A)),
            "Velocity Limit": min(1023, round(config.velocity_limit_rad_s / VELOCITY_UNIT_RAD_S)),
            "Max Position Limit": min(4095, ends[1]),
            "Min Position Limit": max(0, ends[0]),
            "Shutdown": SHUTDOWN,
        }

    def _write_limits(self) -> None:
        """EEPROM: only what differs (it wears), with torque off (it is locked otherwise), and read back."""
        wrong = {name: value for name, value in self._limits().items() if self._bus.read(self._table[name]) != value}
        if wrong:
            self._bus.write(self._table["Torque Enable"], 0)
        for name, value in wrong.items():
            self._bus.write(self._table[name], value)
            back = self._bus.read(self._table[name])
            if back != value:
                raise StrikerError(f"{self._config.port}: {name} was set to {value} and reads back {back}; the servo cannot be trusted")

    # --- state ------------------------------------------------------------------------------------------------------

    def ticks(self, angle: float) -> int:
        """Position register of an arm angle [rad]."""
        return self._config.zero_position + self._config.direction * round(angle / TICK_RAD)

    def sample(self) -> Sample | None:
        """Read tick, current, velocity and position at one instant; None when the answer is lost or makes no sense.

        Raises:
            StrikerFault: the servo reports a hardware error.
            StrikerLost: the port failed.
        """
        first = self._table["Realtime Tick"].address
        block: Block | None = self._bus.read_block(first, _BLOCK.size)
        if block is None:
            return None
        if block.alert:
            self.raise_hardware_error()
        tick, _, _, _, current, velocity, position = _BLOCK.unpack(block.data)
        if abs(position) > 1 << 20 or abs(velocity) > 1023 or tick >= TICK_WRAP:
            return None
        sign = self._config.direction
        return Sample(
            block.host_before_ns,
            block.host_after_ns,
            tick,
            sign * (position - self._config.zero_position) * TICK_RAD,
            sign * velocity * VELOCITY_UNIT_RAD_S,
            sign * current * CURRENT_UNIT_A,
        )

    def require_sample(self) -> Sample:
        """As `sample`, asked again.

        Raises:
            StrikerLost: the servo does not answer.
        """
        for _ in range(3):
            sample = self.sample()
            if sample is not None:
                return sample
        raise StrikerLost(f"{self._config.port}: the servo has fallen silent; check its power and cable")

    def hardware_error(self) -> str | None:
        """What Hardware Error Status says, in words; None when all is well."""
        return hardware_error_text(self._bus.read(self._table["Hardware Error Status"]))

    def raise_hardware_error(self) -> None:
        """Raises StrikerFault when there is a hardware error."""
        text = self.hardware_error()
        if text is not None:
            raise StrikerFault(f"{self._config.port}: the servo reports {text}, then home it")

    def clear_hardware_error(self) -> bool:
        """Reboot if there is an error, or if the arm was turned by more than half a turn; whether it was rebooted.

        Raises:
            StrikerFault: the error came back.
        """
        position = self._bus.read(self._table["Present Position"])
        # Mode 5 counts turns; only a reboot brings the reading back to one turn.
        turned = abs(position - self._config.zero_position) > 2048
        if self.hardware_error() is None and not turned:
            return False
        self._bus.reboot(timeout_s=2.0)
        self.raise_hardware_error()
        return True

    # --- motion -----------------------------------------------------------------------------------------------------

    def torque_on(self) -> None:
        """Hold the arm where it is, with our gains and current cap."""
        self._bus.write(self._table["Bus Watchdog"], 0)
        self._bus.write(self._table["Position P Gain"], POSITION_P_GAIN)  # RAM: lost with every reboot
        self._bus.write(self._table["Position D Gain"], 0)
        self._bus.write(self._table["Goal Current"], self._limits()["Current Limit"])
        self._bus.write(self._table["Torque Enable"], 1)

    def torque_off(self) -> None:
        """Let go."""
        self._bus.write(self._table["Torque Enable"], 0)

    def guard(self) -> None:
        """Start the bus watchdog: from now on, silence stops the motor."""
        self._bus.write(self._table["Bus Watchdog"], 0)  # clears one that tripped, else goals are refused
        self._bus.write(self._table["Bus Watchdog"], WATCHDOG_UNITS)

    def tripped(self) -> bool:
        """Whether the watchdog has stopped the arm."""
        return self._bus.read(self._table["Bus Watchdog"]) == WATCHDOG_TRIPPED

    def unguard(self) -> None:
        """End the bus watchdog: the servo holds its place in silence."""
        self._bus.write(self._table["Bus Watchdog"], 0)

    def go(self, angle: float, velocity: float, acceleration: float) -> None:
        """Move to an arm angle [rad]; profile velocity [rad/s] and acceleration [rad/s2], 0 = as fast as the current cap allows.

        Where the watchdog stopped the arm because this host stood still, it is cleared and the order given again.
        One write: Profile Acceleration, Profile Velocity and Goal Position are neighbours, so that a retraction costs one transaction.
        The goal is checked here, because the servo's position limits do not bind in mode 5.
        """
        ticks = self.ticks(angle)
        limits = self._limits()
        if not limits["Min Position Limit"] <= ticks <= limits["Max Position Limit"]:
            raise StrikerError(
                f"the arm angle {angle:.3f} rad is outside the limits of this striker; check cocked_angle_rad and zero_position"
            )
        speed = min(limits["Velocity Limit"], max(1, round(velocity / VELOCITY_UNIT_RAD_S))) if velocity else 0
        rate = max(1, round(acceleration / ACCELERATION_UNIT_RAD_S2)) if acceleration else 0
        first = self._table["Profile Acceleration"]
        value = int.from_bytes(struct.pack("<IIi", rate, speed, ticks), "little")
        goal = Register(f"Profile and Goal Position ({angle:.3f} rad)", first.address, 12)
        try:
            self._bus.write(goal, value)
        except StrikerError:
            if not self.tripped():
                raise
            self.guard()
            self._bus.write(goal, value)
