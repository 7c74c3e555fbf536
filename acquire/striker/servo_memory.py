"""What a servo remembers: settings in its EEPROM, which a former user may have changed.

Source: ROBOTIS e-manual, Drive Mode (10), Homing Offset (20), Startup Configuration (60), Bus Watchdog (98);
DynamixelSDK issue 584 (a tripped watchdog with a homing offset goes on moving the motor).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from acquire.errors import StrikerError, StrikerNotFound
from acquire.striker.control_table import STARTUP_CONFIGURATION, Register
from schemas.servo_models import LEAST_FIRMWARE, model_of, unsuited_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from acquire.striker.bus import ServoBus
    from schemas.rig import StrikerConfig
    from schemas.servo_models import ModelName

REVERSED, PROFILE_IN_MS, TORQUE_BY_GOAL = 0x01, 0x04, 0x08
"""bits of Drive Mode: positions count the other way; Profile Velocity is a time; a goal switches the torque
on"""
NO_SECOND_ID: Final = 255
SAFE_MEMORY: Final = {
    "Drive Mode": 0,
    "Homing Offset": 0,
    "Secondary(Shadow) ID": NO_SECOND_ID,
    "PWM Limit": 885,
}
"""values that the striker needs, by register, beside the rig file's limits"""


def read_memory(bus: ServoBus, table: Mapping[str, Register]) -> dict[str, int]:
    """Values of the registers that make a used servo dangerous, by name; missing registers are left out.

    Args:
        bus: open bus of the servo.
        table: its control table.

    Raises:
        StrikerLost: the servo does not answer.
    """
    names = ("Firmware Version", *SAFE_MEMORY)
    memory = {name: bus.read(table[name]) for name in names}
    startup = bus.read_if_present(STARTUP_CONFIGURATION)
    return memory if startup is None else memory | {STARTUP_CONFIGURATION.name: startup}


def firmware_problem(memory: Mapping[str, int]) -> str:
    """Text on a firmware without a bus watchdog, with the remedy; empty if the firmware has one."""
    firmware = memory["Firmware Version"]
    if firmware >= LEAST_FIRMWARE:
        return ""
    return (
        f"firmware {firmware} has no bus watchdog, which stops the arm if this computer fails: update it to "
        f"{LEAST_FIRMWARE} or later with DYNAMIXEL Wizard 2.0"
    )


def dangers(memory: Mapping[str, int]) -> list[str]:
    """What the servo remembers that would move the arm otherwise than ordered, in words; empty if nothing."""
    mode, startup = memory["Drive Mode"], memory.get(STARTUP_CONFIGURATION.name, 0)
    texts = [
        (mode & PROFILE_IN_MS, f"Drive Mode {mode} (speeds are taken for times in ms)"),
        (mode & REVERSED, f"Drive Mode {mode} (positions count the other way)"),
        (mode & TORQUE_BY_GOAL, f"Drive Mode {mode} (a goal switches the torque on)"),
        (memory["Homing Offset"], f"Homing Offset {memory['Homing Offset']} (positions are shifted)"),
        (startup, f"Startup Configuration {startup} (torque or goals return at power-up)"),
    ]
    if memory["Secondary(Shadow) ID"] < NO_SECOND_ID - 2:
        texts.append((1, f"Secondary ID {memory['Secondary(Shadow) ID']} (it obeys another id too)"))
    return [text for remembered, text in texts if remembered]


def positions_problem(memory: Mapping[str, int]) -> str:
    """Text on a memory that, once cleared, gives positions another meaning; empty if it does not.

    It is said once, after the memory was cleared.
    """
    if not (memory["Drive Mode"] & REVERSED or memory["Homing Offset"]):
        return ""
    return (
        f"the servo remembered {', '.join(dangers(memory))}; this is cleared now, so its positions have "
        "changed: check the arm's angle with `acquire check`, correct zero_position and direction in the rig "
        "file, then start again"
    )


def checked_model(config: StrikerConfig, number: int) -> ModelName:
    """Name of the model with a number.

    Raises:
        StrikerNotFound: it is not that of the rig file.
    """
    name = model_of(number)
    if name is None:
        raise StrikerNotFound(f"{config.port}: {unsuited_text(number)}")
    if name != config.model:
        raise StrikerNotFound(
            f"{config.port}: the servo is an {name}, the rig file says {config.model}: write "
            f'model = "{name}" in its section [striker], and plan again'
        )
    return name


def write_memory(
    bus: ServoBus, table: Mapping[str, Register], wanted: Mapping[str, int], memory: Mapping[str, int]
) -> None:
    """Write settings to the servo's EEPROM, clear its Startup Configuration, and read all back.

    Only differing values are written, because EEPROM wears; the torque is switched off for that, else EEPROM
    is locked.

    Args:
        bus: open bus of the servo.
        table: its control table.
        wanted: values by register.
        memory: what the servo remembers.

    Raises:
        StrikerError: a value reads back differently, or the servo refuses it.
        StrikerLost: the servo does not answer.
    """
    wrong = [(table[name], value) for name, value in wanted.items() if bus.read(table[name]) != value]
    if memory.get(STARTUP_CONFIGURATION.name):
        wrong.append((STARTUP_CONFIGURATION, 0))
    if wrong:
        bus.write(table["Torque Enable"], 0)
    for register, value in wrong:
        bus.write(register, value)
        back = bus.read(register)
        if back != value:
            raise StrikerError(
                f"{bus.port}: {register.name} was set to {value} and reads back {back}; replace the servo"
            )
