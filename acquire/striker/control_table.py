"""Control table (registers) of a Dynamixel servo, read from the files that ship with dynamixel-sdk."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from schemas.servo_models import ModelName
from schemas.software import extra_command

SIGNED = frozenset(
    {
        "Homing Offset",
        "Goal PWM",
        "Goal Current",
        "Goal Velocity",
        "Goal Position",
        "Present PWM",
        "Present Current",
        "Present Velocity",
        "Present Position",
        "Velocity Trajectory",
        "Position Trajectory",
    }
)
"""names of the registers whose value is two's complement; the vendor's files do not mark them"""

EEPROM_END = 64
"""registers below this address are EEPROM: writable only with torque off"""


@dataclass(frozen=True)
class Register:
    """One register of the servo's control table: the vendor's name, address and number of bytes."""

    name: str
    """the vendor's name"""
    address: int
    """address of its first byte"""
    size: int
    """number of bytes, little-endian"""

    @property
    def signed(self) -> bool:
        """True if the register's value is two's complement, False if it is unsigned."""
        return self.name in SIGNED

    def decode(self, data: bytes) -> int:
        """Value of the register from the first `size` bytes of `data`, which are little-endian.

        Signed registers give signed values. Needed because the SDK returns unsigned numbers only.
        """
        return int.from_bytes(data[: self.size], "little", signed=self.signed)

    def encode(self, value: int) -> bytes:
        """Bytes (`size` of them, little-endian) of a value; bits beyond the register's width are dropped."""
        return (value & ((1 << 8 * self.size) - 1)).to_bytes(self.size, "little")


STARTUP_CONFIGURATION = Register("Startup Configuration", 60, 1)
"""torque on and goals restored at power-up; newer firmware has it, the vendor's files do not list it"""


@cache
def control_table(model: ModelName) -> dict[str, Register]:
    """Mapping of the vendor's register names to the registers of a servo model.

    Registers for indirect addressing are left out.

    Args:
        model: name of the model.

    Raises:
        ModuleNotFoundError: dynamixel-sdk is not installed.
    """
    # Located, not imported: the motor class of dynamixel_easy_sdk fails on an ALERT status.
    spec = importlib.util.find_spec("dynamixel_easy_sdk")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError(f"dynamixel-sdk is not installed: {extra_command('rig')}")
    path = Path(spec.origin).parent / "control_table" / f"{model.lower().replace('-', '_')}.model"
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = (line.split("\t") for line in lines[lines.index("[control table]") + 2 :] if line.strip())
    return {
        name: Register(name, int(address), int(size))
        for address, size, name in rows
        if not name.startswith("Indirect")
    }
