"""Checks of the servo: answer, supply voltage, temperature, hardware error.

The servo is only read: nothing moves, and nothing is written to its EEPROM.
"""

from __future__ import annotations

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
from schemas.software import extra_command

if TYPE_CHECKING:
    from acquire.clock.clock import Clock
    from schemas.rig import StrikerConfig

MIN_SUPPLY_V, MAX_SUPPLY_V = 10.0, 14.8
"""range of the supply voltage [V] (the vendor's, for XM430)"""
TEMPERATURE_MARGIN_C = 10
"""required margin [deg C] below the limit at which the servo switches its torque off, so that no session ends
that way"""
SERVO_LINES = ("servo", "servo supply", "servo temperature", "servo health")
"""names of the servo's checks, in order"""


@dataclass(frozen=True)
class ServoState:
    """Model number, supply voltage [V], temperature [°C] and hardware error read from the servo."""

    model: int
    voltage_v: float
    temperature_c: int
    hardware_error: str | None
    """description of the hardware error; None if there is none"""


ReadServo = Callable[["StrikerConfig"], ServoState]


def read_servo(config: StrikerConfig, clock: Clock) -> ServoState:
    """Read model number, supply voltage [V], temperature [deg C] and hardware error over the servo's bus.

    The hardware error is a text; None if there is none. The serial port is opened and closed again.

    Args:
        config: the rig file's settings of the striker.
        clock: clock of the host, for the bus.

    Raises:
        StrikerError: no port, no servo, an unknown model, no answer, or the servo's library is missing.
    """
    try:
        from acquire.striker.bus import ServoBus
        from acquire.striker.control_table import MODEL_FILES, MODEL_NAMES, control_table
        from acquire.striker.servo import hardware_error_text
    except ImportError as error:
        raise StrikerError(
            f"{config.port}: the servo's library is missing ({error}): {extra_command('rig')}"
        ) from None

    bus = ServoBus(config.port, config.baud_rate, config.id, clock)
    model = bus.open()
    try:
        if model not in MODEL_FILES:
            known = ", ".join(MODEL_NAMES.values())
            raise StrikerError(
                f"{config.port}: the servo's model is {model}, which has no tested current limit: use {known}"
            )
        table = control_table(model)
        return ServoState(
            model=model,
            voltage_v=bus.read(table["Present Input Voltage"]) * 0.1,
            temperature_c=bus.read(table["Present Temperature"]),
            hardware_error=hardware_error_text(bus.read(table["Hardware Error Status"])),
        )
    finally:
        bus.close()


def check_servo(read: ReadServo, config: StrikerConfig) -> list[Check]:
    """Check a servo that no daemon holds: its answer, supply voltage, temperature and hardware error.

    Args:
        read: function that reads the servo.
        config: the rig file's settings of the striker.

    Returns:
        Four checks: answer and model, supply voltage, temperature, hardware error. If the servo does not
        answer, the first fails and the others are not made.
    """
    try:
        state = read(config)
    except StrikerError as error:
        first = failed_by_error("servo", error)
        return _not_read(first, "the servo does not answer")
    return [_model(config, state), _supply(state), _temperature(config, state), _health(state)]


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
        Four checks: state of the striker (in place of the servo's answer), supply voltage, temperature,
        hardware error; only the first is made without a reading.
    """
    first = passed_check("servo", f"held by the daemon, {state}")
    if state == "fault":
        remedy = "correct the fault; the next session homes the striker"
        first = failed_check("servo", f"the daemon's striker is in a fault: {trouble}", remedy)
    if health is None:
        return _not_read(first, "the daemon holds the servo and has not read it")
    known = ServoState(
        int(health["model"]),
        float(health["voltage_v"]),
        int(health["temperature_c"]),
        health["hardware_error"] and str(health["hardware_error"]),
    )
    return [first, _supply(known), _temperature(config, known), _health(known)]


def _not_read(first: Check, reason: str) -> list[Check]:
    return [first, *(skipped_check(name, reason) for name in SERVO_LINES[1:])]


def _model(config: StrikerConfig, state: ServoState) -> Check:
    from acquire.striker.control_table import MODEL_NAMES

    name = MODEL_NAMES.get(state.model, state.model)
    return passed_check("servo", f"{name}, id {config.id}, answers at {config.baud_rate} bit/s")


def _supply(state: ServoState) -> Check:
    found = f"{state.voltage_v:.1f} V ({MIN_SUPPLY_V:g} to {MAX_SUPPLY_V:g} V)"
    if state.voltage_v < MIN_SUPPLY_V:
        remedy = "use a 12 V supply of 3 A or more; check that the cut-off switch is on"
        return failed_check("servo supply", found, remedy, Measured(state.voltage_v, MIN_SUPPLY_V, "V"))
    measured = Measured(state.voltage_v, MAX_SUPPLY_V, "V")
    if state.voltage_v > MAX_SUPPLY_V:
        return failed_check("servo supply", found, "use a 12 V supply", measured)
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
