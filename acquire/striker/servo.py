"""Servo of the striker's arm; one file, because limits, goals, gains and watchdog share its registers.

Values are in SI units. An arm angle is 0 at the impact point, where the arm hangs, and positive towards the
object. Names of registers are the vendor's.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

from acquire.errors import StrikerError, StrikerFault, StrikerLost
from acquire.striker.base import ServoHealth
from acquire.striker.bus import Block, MonotonicClock, ServoBus, attempts
from acquire.striker.control_table import Register, control_table
from acquire.striker.deadman import DeadManSwitch
from acquire.striker.gains import damping_gain, position_gains
from acquire.striker.sample import (
    ACCELERATION_UNIT_RAD_S2,
    TICK_RAD,
    TICK_WRAP,
    VELOCITY_UNIT_RAD_S,
    Sample,
)
from acquire.striker.servo_memory import (
    SAFE_MEMORY,
    checked_model,
    firmware_problem,
    positions_problem,
    read_memory,
    write_memory,
)
from schemas.servo_models import SERVO_MODELS

if TYPE_CHECKING:
    from collections.abc import Callable

    from schemas.rig import StrikerConfig

CURRENT_BASED_POSITION = 5
"""value of Operating Mode: position control with a current limit"""
SHUTDOWN = 52
"""value of the Shutdown register: overheating, electrical shock and overload switch the torque off"""
WATCHDOG_UNITS = 3
"""watchdog time in units of 20 ms: a silent host stops the motor after 60 ms, and the arm rests within
100 ms; without it the servo keeps turning"""
ALL_ANSWERS = 2
"""value of Status Return Level: every request is answered"""
WATCHDOG_TRIPPED = 0xFF
"""value of Bus Watchdog after the watchdog has stopped the motor"""
BRAKE_GOAL_OFFSET_RAD = 0.1
"""distance of a brake's goal behind the arm [rad]: at POSITION_P_GAIN this demands more than any current
limit allows; should this host fall silent now, the arm comes to rest there"""
BRAKE_TIME_FACTOR = 0.87
"""braking time over the time that the current limit alone would need: drag brakes too, and an arm that runs
on a little stops sooner than one that is thrown back"""
RUN_THROUGH_RAD = 0.35
"""goal of a swing beyond the impact point [rad], so that the speed is constant there"""
_BLOCK = struct.Struct(
    "<HBBhhii"
)  # 120 Realtime Tick, Moving, Moving Status, Present PWM, Current, Velocity, 132 Position
SAMPLE_BYTES = _BLOCK.size
"""bytes of one reading, from Realtime Tick on"""

_ERROR_BITS = {
    0: "input voltage; check the supply",
    2: "overheating; let it cool",
    3: "motor encoder; the servo needs repair",
    4: "electrical shock; check the supply and the wiring",
    5: "overload; check that the arm moves freely",
}


def hardware_error_text(status: int) -> str | None:
    """Description, with remedies, of a value of the register Hardware Error Status; None if it is 0."""
    if not status:
        return None
    texts = [text for bit, text in _ERROR_BITS.items() if status >> bit & 1]
    return f"hardware error status {status}: {'; '.join(texts) or 'unknown bit'}"


class Servo:
    """Dynamixel servo that drives the striker's arm.

    Unless stated otherwise, methods that read or write registers raise StrikerLost if the servo does not
    answer or the port fails, and those that write raise StrikerError if the servo refuses the value.

    Args:
        config: section `striker` of the rig file: port, zero position, direction and limits.
        clock: host monotonic time.
    """

    def __init__(self, config: StrikerConfig, clock: MonotonicClock) -> None:
        self._config, self._clock = config, clock
        self._bus = ServoBus(config.port, config.baud_rate, config.id, clock)
        self._table: dict[str, Register] = {}
        self._dead_man: DeadManSwitch | None = None
        self._model = SERVO_MODELS[config.model]

    # --- open and close

    def open(self) -> None:
        """Open the port, check model and firmware, write the limits and read them back.

        What the servo remembers of a former use is cleared. If that gives its positions another meaning, it
        is said once, as an error, because the rig file's zero position may have been measured before.

        Also starts the dead man's switch, a process that switches the torque off when this one dies. On an
        error the port is closed again.

        Raises:
            StrikerNotFound: no such port, port in use, no servo, or another model than in the rig file.
            StrikerError: the firmware has no bus watchdog, a limit reads back differently, the dead man's
                switch does not start, or positions have another meaning from now on.
            StrikerLost: the servo does not answer.
        """
        number = self._bus.open()
        try:
            self._table = control_table(checked_model(self._config, number))
            # A former program may have switched answers to writing off.
            self._bus.write_unanswered(self._table["Status Return Level"], ALL_ANSWERS)
            memory = read_memory(self._bus, self._table)
            if problem := firmware_problem(memory):
                raise StrikerError(f"{self._config.port}: {problem}")
            # Torque stays on over a restart of this program, and so does a tripped watchdog.
            self._bus.write(self._table["Bus Watchdog"], 0)
            write_memory(self._bus, self._table, self._limits(), memory)
            if problem := positions_problem(memory):
                raise StrikerError(f"{self._config.port}: {problem}")
            self.keep_dead_man_switch()
        except Exception:
            self._bus.close()
            raise

    def close(self) -> None:
        """Release the port, and end the process that would switch the torque off if this one dies.

        The torque stays as it is. Always safe.
        """
        dead_man, self._dead_man = self._dead_man, None
        if dead_man is not None:
            dead_man.dismiss()
        self._bus.close()

    def keep_dead_man_switch(self) -> None:
        """Start the dead man's switch if it does not run.

        It is a process that switches the torque off when this one dies.

        Raises:
            StrikerError: its process does not start, or the port is closed.
        """
        if self._dead_man is not None and not self._dead_man.alive:
            self._dead_man.dismiss()
            self._dead_man = None
        if self._dead_man is None:
            torque_off = self._bus.unanswered_packet(self._table["Torque Enable"], 0)
            self._dead_man = DeadManSwitch(self._bus.descriptor, torque_off)

    @property
    def is_open(self) -> bool:
        """True from a successful `open` to `close`, even if the port fails in between."""
        return self._bus.is_open

    def _limits(self) -> dict[str, int]:
        config = self._config
        ends = sorted(self.ticks(angle) for angle in (config.cocked_angle_rad - 0.3, RUN_THROUGH_RAD + 0.15))
        return {
            "Return Delay Time": 0,
            "Operating Mode": CURRENT_BASED_POSITION,
            "Temperature Limit": config.temperature_limit_c,
            "Current Limit": round(config.current_limit_a / self._model.current_unit_a),
            "Velocity Limit": round(config.velocity_limit_rad_s / VELOCITY_UNIT_RAD_S),
            "Max Position Limit": min(4095, ends[1]),
            "Min Position Limit": max(0, ends[0]),
            "Shutdown": SHUTDOWN,
            **SAFE_MEMORY,
        }

    # --- state

    def ticks(self, angle: float) -> int:
        """Position register's value (4096 per turn) at an arm angle [rad] from the impact point."""
        return self._config.zero_position + self._config.direction * round(angle / TICK_RAD)

    def sample(self, interrupted: Callable[[], bool] = lambda: False) -> Sample | None:
        """Read the arm's angle, angular velocity, motor current and the servo's clock at one instant.

        The angle [rad] is 0 at the impact point and grows towards the object, with velocity in rad/s and
        current in A; the clock counts ms and wraps at 32768.

        Args:
            interrupted: called while waiting; True ends the wait for the answer.

        Returns:
            These values with the host's monotonic times [ns] before and after the reading; None if the answer
            is lost, the wait was interrupted, the servo refused the reading, or the values are impossible.

        Raises:
            StrikerFault: the servo reports a hardware error.
            StrikerLost: the port failed or is closed.
        """
        first = self._table["Realtime Tick"].address
        block: Block | None = self._bus.read_block(first, _BLOCK.size, interrupted)
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
            sign * current * self._model.current_unit_a,
        )

    def require_sample(self) -> Sample:
        """Read the arm's angle [rad], velocity [rad/s] and motor current [A], with the times of the reading.

        The angle is 0 at the impact point and positive towards the object. A failed reading is repeated for
        half a second, at least three readings in all.

        Returns:
            The first reading that succeeds.

        Raises:
            StrikerFault: the servo reports a hardware error.
            StrikerLost: no reading succeeds, or the port failed or is closed.
        """
        for _ in attempts(self._clock):
            sample = self.sample()
            if sample is not None:
                return sample
        raise StrikerLost(f"{self._config.port}: the servo no longer answers; check its power and cable")

    def health(self) -> ServoHealth:
        """Read and return supply voltage [V], temperature [deg C] and hardware error of the servo.

        Raises:
            StrikerLost: the servo does not answer.
        """
        voltage = self._bus.read(self._table["Present Input Voltage"])
        temperature = self._bus.read(self._table["Present Temperature"])
        return ServoHealth(
            self._clock.monotonic_ns(), self._model.number, voltage * 0.1, temperature, self.hardware_error()
        )

    def hardware_error(self) -> str | None:
        """Read the servo's hardware error and return a description of it; None if the servo reports none.

        Raises:
            StrikerLost: the servo does not answer.
        """
        return hardware_error_text(self._bus.read(self._table["Hardware Error Status"]))

    def raise_hardware_error(self) -> None:
        """Read the servo's hardware error, and raise StrikerFault if there is one.

        Raises:
            StrikerFault: the servo reports a hardware error.
            StrikerLost: the servo does not answer.
        """
        text = self.hardware_error()
        if text is not None:
            raise StrikerFault(f"{self._config.port}: the servo reports {text}, then home it")

    def clear_hardware_error(self) -> bool:
        """Reboot the servo after a hardware error, or if the arm was turned by more than half a turn.

        The turn is counted from the impact point.

        Returns:
            True if the servo was rebooted, False if there was no reason to.

        Raises:
            StrikerFault: the error persists after the reboot.
            StrikerLost: the servo does not answer.
        """
        position = self._bus.read(self._table["Present Position"])
        # Mode 5 counts turns; only a reboot brings the reading back into one turn.
        turned = abs(position - self._config.zero_position) > 2048
        if self.hardware_error() is None and not turned:
            return False
        self._bus.reboot(timeout_s=2.0)
        self.raise_hardware_error()
        return True

    # --- motion

    def torque_on(self) -> None:
        """Switch the torque on: hold the arm where it is, with this module's gains and the current limit.

        A tripped bus watchdog is cleared.

        Raises:
            StrikerError: the servo refuses it.
            StrikerLost: the servo does not answer.
        """
        self._bus.write(self._table["Bus Watchdog"], 0)
        self._bus.write(*self._gains(*position_gains(self._model)))  # RAM: lost with every reboot
        self._bus.write(self._table["Goal Current"], self._limits()["Current Limit"])
        self._bus.write(self._table["Torque Enable"], 1)

    def torque_off(self) -> None:
        """Switch the torque off; the arm moves freely.

        Raises:
            StrikerError: the servo refuses it.
            StrikerLost: the servo does not answer.
        """
        self._bus.write(self._table["Torque Enable"], 0)

    def has_torque(self) -> bool:
        """True if the torque is on, as the servo reports now; it is off after a restart.

        Raises:
            StrikerLost: the servo does not answer.
        """
        return self._bus.read(self._table["Torque Enable"]) == 1

    def start_watchdog(self) -> None:
        """Start the servo's bus watchdog: from now on, 60 ms of silence on the bus stop the motor.

        A tripped watchdog is cleared first.

        Raises:
            StrikerError: the servo refuses it.
            StrikerLost: the servo does not answer.
        """
        self._bus.write(self._table["Bus Watchdog"], 0)  # clears a tripped watchdog, else goals are refused
        self._bus.write(self._table["Bus Watchdog"], WATCHDOG_UNITS)

    def watchdog_tripped(self) -> bool:
        """True if the servo's bus watchdog has stopped the arm, as the servo reports now.

        Raises:
            StrikerLost: the servo does not answer.
        """
        return self._bus.read(self._table["Bus Watchdog"]) == WATCHDOG_TRIPPED

    def stop_watchdog(self) -> None:
        """Switch the servo's bus watchdog off: the servo then holds its position although the bus is silent.

        Raises:
            StrikerError: the servo refuses it.
            StrikerLost: the servo does not answer.
        """
        self._bus.write(self._table["Bus Watchdog"], 0)

    def move_to(self, angle: float, velocity: float, acceleration: float) -> None:
        """Start to move to an arm angle; returns as soon as the servo has confirmed the order.

        If the servo's bus watchdog stopped the arm because this host paused, it is cleared and the order
        repeated. Profile Acceleration, Profile Velocity and Goal Position are neighbours and written at once,
        so that a retraction costs one transaction. The goal is checked here, because the servo's position
        limits do not bind in mode 5 (current-based position).

        Args:
            angle: arm angle to reach [rad].
            velocity: largest velocity [rad/s]; 0 means as fast as the current limit allows.
            acceleration: acceleration [rad/s2]; 0 means as much as the current limit allows.

        Raises:
            StrikerError: the angle is outside the striker's limits, or the servo refuses the order.
            StrikerLost: the servo does not answer.
        """
        goal, value = self._goal(angle, velocity, acceleration)
        try:
            self._bus.write(goal, value)
        except StrikerError:
            if not self.watchdog_tripped():
                raise
            self.start_watchdog()
            self._bus.write(goal, value)

    def _goal(self, angle: float, velocity: float, acceleration: float) -> tuple[Register, int]:
        ticks = self.ticks(angle)
        limits = self._limits()
        if not limits["Min Position Limit"] <= ticks <= limits["Max Position Limit"]:
            raise StrikerError(
                f"the arm angle {angle:.3f} rad is outside the limits of this striker; "
                "check cocked_angle_rad and zero_position"
            )
        speed = (
            min(limits["Velocity Limit"], max(1, round(velocity / VELOCITY_UNIT_RAD_S))) if velocity else 0
        )
        rate = max(1, round(acceleration / ACCELERATION_UNIT_RAD_S2)) if acceleration else 0
        first = self._table["Profile Acceleration"]
        value = int.from_bytes(struct.pack("<IIi", rate, speed, ticks), "little")
        return Register(f"Profile and Goal Position ({angle:.3f} rad)", first.address, 12), value

    # --- stopping

    def brake(self, angle: float, velocity: float) -> float:
        """Start to brake the moving arm with full current, and return the expected time to rest [s].

        Does not wait for an answer. The servo cannot brake harder in current-based position mode: its current
        is limited by Goal Current, which is the current limit itself.

        Args:
            angle: present arm angle [rad].
            velocity: present angular velocity of the arm [rad/s].

        Raises:
            StrikerLost: the port failed or is closed.
        """
        self.stay(angle - math.copysign(BRAKE_GOAL_OFFSET_RAD, velocity))
        return BRAKE_TIME_FACTOR * abs(velocity) / self._config.full_acceleration_rad_s2

    def stay(self, angle: float) -> None:
        """Order the arm to an angle [rad] at once, without a profile; an earlier motion ends.

        Does not wait for an answer. An angle outside the arm's range is moved to its end.

        Raises:
            StrikerLost: the port failed or is closed.
        """
        low, high = self._config.cocked_angle_rad - 0.29, RUN_THROUGH_RAD + 0.14
        self._bus.write_unanswered(*self._goal(min(high, max(low, angle)), 0.0, 0.0))

    def damp(self) -> None:
        """Set the servo's gains so that it only damps the arm's motion and no longer controls the position.

        Does not wait for an answer.

        Raises:
            StrikerLost: the port failed or is closed.
        """
        self._bus.write_unanswered(*self._gains(0, damping_gain(self._model)))

    def hold(self) -> None:
        """Hold the arm where it is, with this module's position gain.

        Raises:
            StrikerFault: the servo reports a hardware error.
            StrikerError: the arm is outside the striker's limits, or the servo refuses an order.
            StrikerLost: the servo does not answer.
        """
        self.move_to(self.require_sample().position_rad, 0.0, 0.0)
        self._bus.write(*self._gains(*position_gains(self._model)))

    def _gains(self, proportional: int, derivative: int) -> tuple[Register, int]:
        first = self._table["Position D Gain"]
        value = int.from_bytes(struct.pack("<HHH", derivative, 0, proportional), "little")
        return Register("Position D, I and P Gain", first.address, 6), value
