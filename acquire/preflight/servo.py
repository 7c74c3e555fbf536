"""Is the servo there, fed, cool and healthy? Only reads: a check moves nothing and wears no EEPROM."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from acquire.errors import StrikerError
from acquire.preflight.check import Check, Measured, failed, failed_as, not_checked, passed

if TYPE_CHECKING:
    from acquire.clock.clock import Clock
    from acquire.config import StrikerConfig

LOWEST_V, HIGHEST_V = 10.0, 14.8
"""the vendor's range for XM430"""
WARM_MARGIN_C = 10
"""below the limit at which the servo lets go: a session must not end that way"""
SERVO_LINES = ("servo", "servo supply", "servo temperature", "servo health")


@dataclass(frozen=True)
class ServoState:
    """What the servo's registers say."""

    model: int
    voltage_v: float
    temperature_c: int
    hardware_error: str | None
    """in words"""


ReadServo = Callable[["StrikerConfig"], ServoState]


def read_servo(config: StrikerConfig, clock: Clock) -> ServoState:
    """Ask the servo.

    Raises:
        StrikerError: no port, no servo, one that has no table here, or no answer.
    """
    try:
        from acquire.striker.bus import ServoBus
        from acquire.striker.control_table import MODEL_FILES, MODEL_NAMES, control_table
        from acquire.striker.servo import hardware_error_text
    except ImportError as error:
        raise StrikerError(f"{config.port}: the servo's library is missing ({error}): install percuss[rig]") from None

    bus = ServoBus(config.port, config.baud_rate, config.id, clock)
    model = bus.open()
    try:
        if model not in MODEL_FILES:
            known = ", ".join(MODEL_NAMES.values())
            raise StrikerError(f"{config.port}: the servo is of model {model}, which has no tested current limit: use {known}")
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
    """The servo's lines."""
    if config.kind == "manual":
        return [passed("servo", "none: a hand strikes")]
    try:
        state = read(config)
    except StrikerError as error:
        first = failed_as("servo", error)
        return [first, *(not_checked(name, "the servo does not answer") for name in SERVO_LINES[1:])]
    return [_model(config, state), _supply(state), _temperature(config, state), _health(state)]


def check_held_servo(config: StrikerConfig, state: str, health: dict[str, Any] | None, trouble: str = "") -> list[Check]:
    """The servo's lines while a daemon holds it.

    Args:
        config: the rig file's section.
        state: the striker's.
        health: what the daemon last read of the servo, as in its status; None: nothing yet, or its port is lost.
        trouble: why the striker is in its fault.
    """
    if config.kind == "manual":
        return [passed("servo", "none: a hand strikes")]
    first = passed("servo", f"held by the daemon, {state}")
    if state == "fault":
        first = failed("servo", f"the daemon's striker is in a fault: {trouble}", "put that right; the next session homes it")
    if health is None:
        return [first, *(not_checked(name, "the daemon holds the servo and has not read it") for name in SERVO_LINES[1:])]
    known = ServoState(
        int(health["model"]),
        float(health["voltage_v"]),
        int(health["temperature_c"]),
        health["hardware_error"] and str(health["hardware_error"]),
    )
    return [first, _supply(known), _temperature(config, known), _health(known)]


def _model(config: StrikerConfig, state: ServoState) -> Check:
    from acquire.striker.control_table import MODEL_NAMES

    return passed("servo", f"{MODEL_NAMES.get(state.model, state.model)}, id {config.id}, answers at {config.baud_rate} bit/s")


def _supply(state: ServoState) -> Check:
    found = f"{state.voltage_v:.1f} V ({LOWEST_V:g} to {HIGHEST_V:g} V)"
    if state.voltage_v < LOWEST_V:
        return failed(
            "servo supply", found, "use a 12 V supply of 3 A or more; is the cut-off switch on?", Measured(state.voltage_v, LOWEST_V, "V")
        )
    measured = Measured(state.voltage_v, HIGHEST_V, "V")
    return (
        failed("servo supply", found, "use a 12 V supply", measured)
        if state.voltage_v > HIGHEST_V
        else passed("servo supply", found, measured)
    )


def _temperature(config: StrikerConfig, state: ServoState) -> Check:
    limit = config.temperature_limit_c - WARM_MARGIN_C
    measured = Measured(state.temperature_c, limit, "degC")
    found = f"{state.temperature_c} C, at {config.temperature_limit_c} C it lets go"
    if state.temperature_c > limit:
        return failed("servo temperature", found, "let it cool with the power cut; check that the arm moves freely", measured)
    return passed("servo temperature", found, measured)


def _health(state: ServoState) -> Check:
    if state.hardware_error is not None:
        return failed("servo health", state.hardware_error, "put right what it names; homing restarts the servo")
    return passed("servo health", "no hardware error")
