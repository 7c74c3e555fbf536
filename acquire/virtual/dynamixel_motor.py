"""Motor, gear and control loop of a Dynamixel servo at its nominal voltage."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from acquire.virtual.dynamixel_registers import WATCHDOG_TRIPPED

if TYPE_CHECKING:
    from acquire.virtual.dynamixel_registers import Registers
    from schemas.servo_models import ServoModel

TICK_RAD = 2 * math.pi / 4096
VELOCITY_UNIT_RAD_S = 0.229 * 2 * math.pi / 60
ACCELERATION_UNIT_RAD_S2 = 214.577 * 2 * math.pi / 3600
ZERO_TICKS = 2048
"""position register at 0 rad"""

GEAR_VISCOUS = 0.004
"""viscous drag of the gear [N m s/rad]"""
GEAR_COULOMB = 0.04
"""Coulomb friction of the gear [N m]"""
COULOMB_SPEED = 0.05
"""speed over which Coulomb friction builds up [rad/s]: it cannot reverse an arm of more than
GEAR_COULOMB / COULOMB_SPEED * 1 ms = 0.8 g m2"""
VELOCITY_FILTER_S = 0.003
"""time constant of the servo's velocity filter [s]"""
REVERSED, PROFILE_IN_MS, TORQUE_BY_GOAL = 0x01, 0x04, 0x08
"""bits of Drive Mode (e-manual)"""
FULL_DUTY = 885
"""value of the PWM registers at full duty"""


class Motor:
    """Motor, gear and control loop of the servo; `step` is called once per millisecond.

    Angles are those of the horn, the servo's output shaft; at 0 rad the position register is 2048.

    Args:
        model: the servo's model.
    """

    def __init__(self, model: ServoModel) -> None:
        self._model = model
        self.current = 0.0
        """current through the winding [A]; positive drives towards more ticks"""
        self.velocity = 0.0
        """velocity after the servo's own filter [rad/s]"""
        self.reference = 0.0
        """current position of the trajectory [rad]"""
        self._reference_velocity = 0.0
        self._integral = 0.0
        self._watchdog_tripped = False
        self._profile_s = 0.0
        """time left until the goal is reached [s], with profiles by time"""
        self._goal = math.nan

    def hold(self, position: float) -> None:
        """Restart the goal trajectory, which the controller follows, at rest at `position` [rad].

        The controller's integral is cleared.
        """
        self.reference, self._reference_velocity, self._integral = position, 0.0, 0.0

    def step(self, registers: Registers, position: float, velocity: float, dt: float) -> float:
        """Torque at the horn (the servo's output shaft) [N m] for the step that begins now.

        Updates current, filtered velocity and, while the torque is on, the controller's state. DC motor:
        torque = stall torque * duty - (stall torque / no-load speed) * velocity, limited to that of the
        largest permitted current, minus the gear's drag. With the torque switched off only the drag remains.

        Args:
            registers: registers of the servo, which are only read here.
            position: angle of the horn [rad].
            velocity: angular velocity of the horn [rad/s].
            dt: time since the last step [s].
        """
        self.velocity += (velocity - self.velocity) * min(1.0, dt / VELOCITY_FILTER_S)
        tripped = registers["Bus Watchdog"] == WATCHDOG_TRIPPED
        if tripped and not self._watchdog_tripped:
            self.hold(position)
        if tripped and registers["Homing Offset"]:
            # The stop takes the shifted position for the goal, again and again (DynamixelSDK issue 584).
            self.reference = position + registers["Homing Offset"] * TICK_RAD
        self._watchdog_tripped = tripped
        self.current = 0.0
        if registers["Torque Enable"]:
            self.current = self._control(registers, position, velocity, dt) / self._model.torque_per_ampere
        coulomb = GEAR_COULOMB * math.tanh(velocity / COULOMB_SPEED)
        return self._model.torque_per_ampere * self.current - GEAR_VISCOUS * velocity - coulomb

    def _control(self, registers: Registers, position: float, velocity: float, dt: float) -> float:
        mode, model = registers["Operating Mode"], self._model
        stall, back_emf = model.stall_torque_n_m, model.stall_torque_n_m / model.no_load_rad_s
        cap = model.current_unit_a * (
            abs(registers["Goal Current"]) if mode in {0, 5} else registers["Current Limit"]
        )
        stopped = self._watchdog_tripped
        if mode == 0:
            goal_a = 0.0 if stopped else registers["Goal Current"] * model.current_unit_a
            duty = (goal_a * model.torque_per_ampere + back_emf * velocity) / stall
        elif mode == 16:
            duty = 0.0 if stopped else registers["Goal PWM"] / FULL_DUTY
        elif mode == 1:
            goal = 0.0 if stopped else registers["Goal Velocity"] * VELOCITY_UNIT_RAD_S
            duty = self._velocity_duty(registers, goal, dt)
        else:
            goal_ticks = registers["Goal Position"] - ZERO_TICKS - registers["Homing Offset"]
            goal = self.reference if stopped else sign(registers) * goal_ticks * TICK_RAD
            duty = self._position_duty(registers, goal, position, dt)
        limit = registers["PWM Limit"] / FULL_DUTY
        torque = stall * max(-limit, min(limit, duty)) - back_emf * velocity
        most = cap * model.torque_per_ampere
        return max(-most, min(most, torque))

    def _velocity_duty(self, registers: Registers, goal: float, dt: float) -> float:
        slope = registers["Profile Acceleration"] * ACCELERATION_UNIT_RAD_S2 * dt or math.inf
        self._reference_velocity += max(-slope, min(slope, goal - self._reference_velocity))
        error = (self._reference_velocity - self.velocity) / VELOCITY_UNIT_RAD_S
        step = registers["Velocity I Gain"] / 65536 * error * dt * 1000
        self._integral = max(-FULL_DUTY, min(FULL_DUTY, self._integral + step))
        # e-manual: P gain / 128, I gain / 65536; the back EMF is fed forward.
        feedback = (registers["Velocity P Gain"] / 128 * error + self._integral) / FULL_DUTY
        return self._reference_velocity / self._model.no_load_rad_s + feedback

    def _position_duty(self, registers: Registers, goal: float, position: float, dt: float) -> float:
        self._advance_trajectory(registers, goal, dt)
        error = (self.reference - position) / TICK_RAD
        step = registers["Position I Gain"] / 65536 * error * dt * 1000
        self._integral = max(-FULL_DUTY, min(FULL_DUTY, self._integral + step))
        damping = (
            registers["Position D Gain"] / 16 * (self._reference_velocity - self.velocity) * 0.001 / TICK_RAD
        )
        forward = registers["Feedforward 1st Gain"] / 4 * self._reference_velocity / VELOCITY_UNIT_RAD_S
        # e-manual: P gain / 128, I gain / 65536, D gain / 16, feed-forward / 4, all in PWM units.
        return (registers["Position P Gain"] / 128 * error + self._integral + damping + forward) / FULL_DUTY

    def _advance_trajectory(self, registers: Registers, goal: float, dt: float) -> None:
        """Advance the trapezoidal trajectory towards `goal` [rad] by `dt` [s].

        The registers Profile Velocity and Profile Acceleration limit it; 0 means no limit.
        """
        speed = registers["Profile Velocity"] * VELOCITY_UNIT_RAD_S
        if speed == 0:
            self.reference, self._reference_velocity = goal, 0.0
            return
        distance = goal - self.reference
        if registers["Drive Mode"] & PROFILE_IN_MS:
            self._advance_by_time(registers["Profile Velocity"] * 1e-3, goal, dt)
            return
        acceleration = registers["Profile Acceleration"] * ACCELERATION_UNIT_RAD_S2
        if acceleration:
            wanted = math.copysign(min(speed, math.sqrt(2 * acceleration * abs(distance))), distance)
            slope = acceleration * dt
            self._reference_velocity += max(-slope, min(slope, wanted - self._reference_velocity))
        else:
            self._reference_velocity = math.copysign(speed, distance)
        step = self._reference_velocity * dt
        if abs(distance) <= abs(step) and step * distance >= 0:
            self.reference, self._reference_velocity = goal, 0.0
        else:
            self.reference += step

    def _advance_by_time(self, profile_s: float, goal: float, dt: float) -> None:
        """Advance the trajectory towards `goal` [rad], reached `profile_s` [s] after it was set."""
        if goal != self._goal:
            self._goal, self._profile_s = goal, profile_s
        if self._profile_s <= dt:
            self.reference, self._reference_velocity = goal, 0.0
            return
        self._reference_velocity = (goal - self.reference) / self._profile_s
        self.reference += self._reference_velocity * dt
        self._profile_s -= dt


def sign(registers: Registers) -> int:
    """Sign of the position, velocity and current registers: -1 if the Drive Mode is reversed."""
    return -1 if registers["Drive Mode"] & REVERSED else 1
