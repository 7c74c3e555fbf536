"""Control table of the virtual servo: defaults, ranges and access rules (vendor's e-manual)."""

from __future__ import annotations

from collections.abc import Mapping

from acquire.striker.control_table import EEPROM_END, STARTUP_CONFIGURATION, control_table
from acquire.virtual.dynamixel_protocol import StatusError
from schemas.servo_models import LEAST_FIRMWARE, SERVO_MODELS, ModelName

WATCHDOG_TRIPPED = 0xFF
STARTUP_FIRMWARE = 45
"""oldest firmware with the register Startup Configuration"""

# name: (default, smallest, largest); registers that are not listed start at 0 and accept any value.
_SPECIFICATION: dict[str, tuple[int, int, int]] = {
    "ID": (1, 0, 252),
    "Baud Rate": (1, 0, 7),
    "Return Delay Time": (250, 0, 254),
    "Drive Mode": (0, 0, 13),
    "Operating Mode": (3, 0, 16),
    "Protocol Type": (2, 1, 2),
    "Secondary(Shadow) ID": (255, 0, 255),
    "Homing Offset": (0, -1044479, 1044479),
    "Moving Threshold": (10, 0, 1023),
    "Temperature Limit": (80, 0, 100),
    "PWM Limit": (885, 0, 885),
    "Velocity Limit": (330, 0, 1023),
    "Max Position Limit": (4095, 0, 4095),
    "Min Position Limit": (0, 0, 4095),
    "Shutdown": (52, 0, 63),
    "Torque Enable": (0, 0, 1),
    "LED": (0, 0, 1),
    "Status Return Level": (2, 0, 2),
    "Velocity I Gain": (1920, 0, 16383),
    "Velocity P Gain": (100, 0, 16383),
    "Position D Gain": (0, 0, 16383),
    "Position I Gain": (0, 0, 16383),
    "Position P Gain": (800, 0, 16383),
    "Bus Watchdog": (0, 0, 127),
    "Profile Velocity": (0, 0, 32767),
    "Profile Acceleration": (0, 0, 32767),
    "Goal PWM": (885, -885, 885),
    "Goal Velocity": (330, -1023, 1023),
    "Goal Position": (2048, -1048575, 1048575),
    "Present Temperature": (31, 0, 0),
}
_LIMITED_BY = {
    "Goal PWM": "PWM Limit",
    "Goal Current": "Current Limit",
    "Goal Velocity": "Velocity Limit",
    "Profile Velocity": "Velocity Limit",
}
_READ_ONLY = {
    "Model Number",
    "Model Information",
    "Firmware Version",
    "Registered Instruction",
    "Hardware Error Status",
    "Realtime Tick",
    "Moving",
    "Moving Status",
    "Velocity Trajectory",
    "Position Trajectory",
}
_GOALS = {"Goal PWM", "Goal Current", "Goal Velocity", "Goal Position"}
_OPERATING_MODES = {0, 1, 3, 4, 5, 16}


class Registers:
    """Control table of the virtual servo, accessed by name from the servo and by address from the bus.

    `registers[name]` reads or sets a value without the checks that apply to a write over the bus. Names are
    the vendor's.

    Args:
        servo_id: id of the servo on the bus.
        baud_index: value of the Baud Rate register.
        model: name of the servo's model.
        memory: values of registers that a former user changed, and the firmware's version.
    """

    def __init__(
        self, servo_id: int, baud_index: int, model: ModelName, memory: Mapping[str, int] | None = None
    ) -> None:
        known = SERVO_MODELS[model]
        low_v, high_v = (round(10 * volts) for volts in known.supply_v)
        most = known.most_current
        self._specification = _SPECIFICATION | {
            "Firmware Version": (47, 0, 255),
            "Max Voltage Limit": (high_v, low_v, high_v),
            "Min Voltage Limit": (low_v, low_v, high_v),
            "Current Limit": (most, 0, most),
            "Goal Current": (most, -most, most),
            "Present Input Voltage": (round(10 * known.nominal_v), 0, 0),
        }
        memory = {"Firmware Version": 47} | dict(memory or {})
        self._table = {
            name: register for name, register in control_table(model).items() if register.address < 168
        }
        if memory["Firmware Version"] >= STARTUP_FIRMWARE:
            self._table[STARTUP_CONFIGURATION.name] = STARTUP_CONFIGURATION
        if memory["Firmware Version"] < LEAST_FIRMWARE:
            self._hidden = {self._table["Bus Watchdog"].address}
        else:
            self._hidden = set[int]()
        self._by_address = {register.address: register for register in self._table.values()}
        self._defined = {
            register.address + k for register in self._table.values() for k in range(register.size)
        }
        self._memory = bytearray(168)
        self._values: dict[str, int] = {}
        for name in self._table:
            self[name] = self._specification.get(name, (0, 0, 0))[0]
        self["Model Number"], self["ID"], self["Baud Rate"] = known.number, servo_id, baud_index
        for name, value in memory.items():
            self[name] = value

    def __getitem__(self, name: str) -> int:
        return self._values[name]

    def __setitem__(self, name: str, value: int) -> None:
        register = self._table[name]
        encoded = register.encode(value)
        self._memory[register.address : register.address + register.size] = encoded
        self._values[name] = register.decode(encoded)

    def reboot(self) -> None:
        """Reset the registers in RAM to their defaults, as a reboot does; EEPROM is unchanged.

        Goal PWM, Goal Current and Goal Velocity are set to their limits.
        """
        for name, register in self._table.items():
            if register.address >= EEPROM_END:
                self[name] = self._specification.get(name, (0, 0, 0))[0]
        for name in ("Goal PWM", "Goal Current", "Goal Velocity"):
            self[name] = self[_LIMITED_BY[name]]

    def read(self, address: int, size: int) -> tuple[StatusError, bytes]:
        """Read `size` bytes from `address` as over the bus.

        Returns:
            StatusError.NONE and the bytes; or StatusError.ACCESS and no bytes if `size` is 0 or the first or
            last address is in no register.
        """
        ends = {address, address + size - 1}
        if size == 0 or not ends <= self._defined or ends & self._hidden:
            return StatusError.ACCESS, b""
        return StatusError.NONE, bytes(self._memory[address : address + size])

    def write(self, address: int, data: bytes) -> tuple[StatusError, list[str]]:
        """Write bytes to neighbouring registers as over the bus, all or none.

        Args:
            address: address of the first byte, where a register must begin.
            data: values of whole registers, little-endian; bytes for gaps between registers are skipped.

        Returns:
            StatusError.NONE and the names of the written registers; or the StatusError that states the reason
            of the refusal, and no names: ACCESS (no register, read only, EEPROM with torque on), LENGTH (part
            of a register), RANGE (out of range, or a goal after the bus watchdog tripped), LIMIT (beyond a
            limit register), or RESULT (torque on in spite of a hardware error).
        """
        written: list[tuple[str, int]] = []
        offset = 0
        while offset < len(data):
            register = self._by_address.get(address + offset)
            if register is None:
                if offset and address + offset not in self._defined:
                    offset += 1  # a gap between two registers
                    continue
                return StatusError.ACCESS, []
            if len(data) - offset < register.size:
                return StatusError.LENGTH, []
            value = register.decode(data[offset : offset + register.size])
            error = self._check(register.name, register.address, value)
            if error is not StatusError.NONE:
                return error, []
            written.append((register.name, value))
            offset += register.size
        for name, value in written:
            self[name] = value
        return StatusError.NONE, [name for name, _ in written]

    def _check(self, name: str, address: int, value: int) -> StatusError:
        if (
            name in _READ_ONLY
            or address in self._hidden
            or name.startswith("Present")
            or (address < EEPROM_END and self["Torque Enable"])
        ):
            return StatusError.ACCESS
        low, high = self._specification[name][1:] if name in self._specification else (-(1 << 31), 1 << 31)
        if not low <= value <= high or (name == "Operating Mode" and value not in _OPERATING_MODES):
            return StatusError.RANGE
        if self._exceeds_limit(name, value):
            return StatusError.LIMIT
        if name in _GOALS and self["Bus Watchdog"] == WATCHDOG_TRIPPED:
            return StatusError.RANGE
        if name == "Torque Enable" and value and self["Hardware Error Status"] & self["Shutdown"]:
            return StatusError.RESULT
        return StatusError.NONE

    def _exceeds_limit(self, name: str, value: int) -> bool:
        if name in _LIMITED_BY:
            return abs(value) > self[_LIMITED_BY[name]]
        # In mode 5 the position limits do not bind: the client has to check the goal.
        if name != "Goal Position" or self["Operating Mode"] != 3:
            return False
        return not self["Min Position Limit"] <= value <= self["Max Position Limit"]
