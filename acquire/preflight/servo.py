"""Checks of the servo: answer, memory, rate of reading, supply voltage, temperature, hardware error.

The servo is only read: nothing moves, and nothing is written to its EEPROM.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from acquire.errors import StrikerError
from acquire.preflight.check import (
    Check,
    Measured,
    failed_by_error,
    failed_check,
    passed_check,
    skipped_check,
)
from schemas.servo_models import SERVO_MODELS
from schemas.software import extra_command

if TYPE_CHECKING:
    from acquire.clock.clock import Clock
    from schemas.rig import StrikerConfig
    from schemas.servo_models import ModelName

LEAST_READS_PER_S = 250.0
"""rate of reading below which a contact cannot be timed [1/s]: 16 ms of latency, as USB adapters have it
unless it is set to 1 ms, leave 60"""
RATE_READS = 100
"""readings over which the rate is measured"""
CONTACT_SD_S = 2.4e-4
"""standard deviation of a contact's time at 1000 readings a second [s]"""
LEAST_SUPPLY_SHARE = 0.95
"""share of the rig file's supply voltage below which the servo may not reach a plan's speeds: its speed is
proportional to the voltage"""
TEMPERATURE_MARGIN_C = 10
"""required margin [deg C] below the limit at which the servo switches its torque off, so that no session ends
that way"""
SERVO_LINES = (
    "servo",
    "servo memory",
    "servo rate",
    "servo supply",
    "servo temperature",
    "servo health",
    "servo calibration",
)
"""names of the servo's checks, in order"""


@dataclass(frozen=True)
class ServoState:
    """What was read from the servo."""

    model: ModelName
    voltage_v: float
    temperature_c: int
    hardware_error: str | None
    """description of the hardware error; None if there is none"""
    angle_rad: float = 0.0
    """angle of the arm from the impact point"""
    reads_per_s: float | None = None
    """rate at which samples of a swing can be read; None if it was not measured"""
    dangers: tuple[str, ...] = ()
    """what the servo remembers that would move the arm otherwise than ordered, in words"""
    firmware_problem: str = ""
    """text on a firmware that is too old, with the remedy; empty if it is not"""


ReadServo = Callable[["StrikerConfig"], ServoState]


def read_servo(config: StrikerConfig, clock: Clock) -> ServoState:
    """Read the servo over its bus. The serial port is opened and closed again.

    Args:
        config: the rig file's settings of the striker.
        clock: clock of the host, for the bus.

    Raises:
        StrikerError: no port, no servo, another model than in the rig file, no answer, or the servo's library
            is missing.
    """
    try:
        from acquire.striker.bus import ServoBus
        from acquire.striker.control_table import control_table
        from acquire.striker.sample import TICK_RAD
        from acquire.striker.servo import SAMPLE_BYTES, hardware_error_text
        from acquire.striker.servo_memory import checked_model, dangers, firmware_problem, read_memory
    except ImportError as error:
        raise StrikerError(
            f"{config.port}: the servo's library is missing ({error}): {extra_command('rig')}"
        ) from None

    bus = ServoBus(config.port, config.baud_rate, config.id, clock)
    number = bus.open()
    try:
        model = checked_model(config, number)
        table = control_table(model)
        memory = read_memory(bus, table)
        ticks = bus.read(table["Present Position"]) - config.zero_position
        first, began_ns = table["Realtime Tick"].address, clock.monotonic_ns()
        read = sum(bus.read_block(first, SAMPLE_BYTES) is not None for _ in range(RATE_READS))
        return ServoState(
            model=model,
            voltage_v=bus.read(table["Present Input Voltage"]) * 0.1,
            temperature_c=bus.read(table["Present Temperature"]),
            hardware_error=hardware_error_text(bus.read(table["Hardware Error Status"])),
            angle_rad=config.direction * ticks * TICK_RAD,
            reads_per_s=1e9 * read / (clock.monotonic_ns() - began_ns),
            dangers=tuple(dangers(memory)),
            firmware_problem=firmware_problem(memory),
        )
    finally:
        bus.close()


def check_servo(read: ReadServo, config: StrikerConfig) -> list[Check]:
    """Check a servo that no daemon holds: answer, memory, rate of reading, supply, temperature, health.

    Args:
        read: function that reads the servo.
        config: the rig file's settings of the striker.

    Returns:
        The checks SERVO_LINES. If the servo does not answer, the first fails and the others are not made.
    """
    try:
        state = read(config)
    except StrikerError as error:
        first = failed_by_error("servo", error)
        return _not_read(first, "the servo does not answer")
    return [
        _model(config, state),
        _memory(state),
        _rate(state),
        _supply(config, state),
        _temperature(config, state),
        _health(state),
        _calibration(config),
    ]


def check_held_servo(
    config: StrikerConfig, state: str, health: dict[str, Any] | None, trouble: str = ""
) -> list[Check]:
    """Check a servo that a daemon holds, by the daemon's last reading of it.

    Args:
        config: the rig file's settings of the striker.
        state: state of the daemon's striker, for example "homed" or "fault".
        health: last reading of the servo in the daemon's status; None if there is none or the port was lost.
        trouble: reason of the striker's fault, if it is in one.

    Returns:
        State of the striker (in place of the servo's answer), supply voltage, temperature, hardware error and
        calibration; only the first is made without a reading. The daemon cleared the servo's memory when it
        began.
    """
    first = passed_check("servo", f"held by the daemon, {state}")
    if state == "fault":
        remedy = "correct the fault; the next session homes the striker"
        first = failed_check("servo", f"the daemon's striker is in a fault: {trouble}", remedy)
    if health is None:
        return _not_read(first, "the daemon holds the servo and has not read it")
    known = ServoState(
        config.model,
        float(health["voltage_v"]),
        int(health["temperature_c"]),
        health["hardware_error"] and str(health["hardware_error"]),
    )
    return [first, _supply(config, known), _temperature(config, known), _health(known), _calibration(config)]


def _not_read(first: Check, reason: str) -> list[Check]:
    return [first, *(skipped_check(name, reason) for name in SERVO_LINES[1:])]


def _model(config: StrikerConfig, state: ServoState) -> Check:
    at = (
        f"id {config.id}, answers at {config.baud_rate} bit/s, arm at {math.degrees(state.angle_rad):.1f} deg"
    )
    if state.firmware_problem:
        return failed_check("servo", f"{state.model}, {at}", state.firmware_problem)
    return passed_check("servo", f"{state.model}, {at}")


def _memory(state: ServoState) -> Check:
    if not state.dangers:
        return passed_check("servo memory", "nothing that would move the arm otherwise than ordered")
    return failed_check(
        "servo memory",
        "; ".join(state.dangers),
        "start the daemon once (`acquire run`), which clears it; then check the arm's angle in this list: it "
        "must be 0 where the arm hangs",
    )


def _rate(state: ServoState) -> Check:
    if state.reads_per_s is None:
        return skipped_check("servo rate", "it was not measured")
    rate = state.reads_per_s
    error_ms = contact_time_sd_s(rate) * 1e3
    measured = Measured(rate, LEAST_READS_PER_S, "1/s")
    if rate < LEAST_READS_PER_S:
        return failed_check(
            "servo rate",
            f"{rate:.0f} readings/s: too few to time a contact",
            "set the adapter's latency timer to 1 ms and the bus to 1 Mbit/s or more (docs: Hardware)",
            measured,
        )
    return passed_check(
        "servo rate", f"{rate:.0f} readings/s: contact times to about {error_ms:.2f} ms", measured
    )


def contact_time_sd_s(reads_per_s: float) -> float:
    """Typical standard deviation of the time of a contact [s] at a rate of reading [1/s].

    It grows with the interval between readings; measured on the virtual servo (`make bench-read-rate`):
    0.30 ms at 814 readings a second, 0.47 at 486, 0.67 at 323, 0.94 at 243.
    """
    return CONTACT_SD_S * 1000.0 / reads_per_s


def _calibration(config: StrikerConfig) -> Check:
    if "effective_mass_kg" in config.model_fields_set:
        found = f"effective mass {config.effective_mass_kg:g} ± {config.effective_mass_sd_kg:g} kg"
        return passed_check("servo calibration", found)
    return failed_check(
        "servo calibration",
        f"effective mass not measured: {config.effective_mass_kg:g} ± {config.effective_mass_sd_kg:g} kg "
        "is assumed",
        "measure it once per rig: `acquire strike --calibrate RIG.toml`",
    )


def _supply(config: StrikerConfig, state: ServoState) -> Check:
    model = SERVO_MODELS[state.model]
    low_v, high_v = model.supply_v
    found = f"{state.voltage_v:.1f} V ({low_v:g} to {high_v:g} V)"
    if state.voltage_v < low_v:
        remedy = f"use a supply of {model.nominal_v:g} V and 3 A or more; check that the cut-off switch is on"
        return failed_check("servo supply", found, remedy, Measured(state.voltage_v, low_v, "V"))
    counted_v = config.supply_v or model.nominal_v
    if state.voltage_v < LEAST_SUPPLY_SHARE * counted_v:
        found = f"{state.voltage_v:.1f} V, but plans count on {counted_v:g} V"
        remedy = (
            f"raise it, or write supply_v = {state.voltage_v:.1f} in the rig file's [striker] and plan again"
        )
        return failed_check("servo supply", found, remedy, Measured(state.voltage_v, counted_v, "V"))
    measured = Measured(state.voltage_v, high_v, "V")
    if state.voltage_v > high_v:
        return failed_check("servo supply", found, f"use a supply of {model.nominal_v:g} V", measured)
    return passed_check("servo supply", found, measured)


def _temperature(config: StrikerConfig, state: ServoState) -> Check:
    limit = config.temperature_limit_c - TEMPERATURE_MARGIN_C
    measured = Measured(state.temperature_c, limit, "degC")
    found = f"{state.temperature_c} C; the torque is switched off at {config.temperature_limit_c} C"
    if state.temperature_c > limit:
        remedy = "let it cool with the power off; check that the arm moves freely"
        return failed_check("servo temperature", found, remedy, measured)
    return passed_check("servo temperature", found, measured)


def _health(state: ServoState) -> Check:
    if state.hardware_error is not None:
        return failed_check(
            "servo health", state.hardware_error, "correct the named fault; homing restarts the servo"
        )
    return passed_check("servo health", "no hardware error")
