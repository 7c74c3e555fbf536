"""Servo models that can drive the striker's arm, by the vendor's data sheets.

Source: ROBOTIS e-manual, https://emanual.robotis.com/docs/en/dxl/x/: sections "Specifications" and "Control
Table" of each model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal, get_args

ModelName = Literal[
    "XM430-W210",
    "XM430-W350",
    "XH430-W210",
    "XH430-W350",
    "XM540-W150",
    "XM540-W270",
    "XL330-M077",
    "XL330-M288",
    "XC330-M181",
    "XC330-M288",
    "XC330-T181",
    "XC330-T288",
]
"""models with current-based position control"""
DEFAULT_MODEL: Final[ModelName] = "XM430-W210"
"""model where a rig file names none"""
UNMEASURED_MASS_SD_KG: Final = 0.1
"""1 sigma of the effective mass of an arm whose rig file states none [kg]; published inertias of rotors, seen
at the horn, are 0.001 to 0.045 kg m² (ToddlerBot, BAM, mujoco_menagerie): 0.07 kg and more at 0.12 m"""
LEAST_FIRMWARE: Final = 38
"""oldest firmware with the register Bus Watchdog, which stops the arm when the computer fails"""


@dataclass(frozen=True)
class ServoModel:
    """One servo model; torque, current and speed are those at the nominal voltage."""

    number: int
    """model number, as a ping returns it"""
    no_load_rpm: float
    """speed of the horn without load [rev/min]"""
    stall_torque_n_m: float
    stall_current_a: float
    current_unit_a: float
    """unit of the current registers [A]"""
    most_current: int
    """largest value of the register Current Limit"""
    nominal_v: float
    supply_v: tuple[float, float]
    """lowest and highest supply voltage [V]"""

    @property
    def no_load_rad_s(self) -> float:
        """Speed of the horn without load [rad/s]."""
        return self.no_load_rpm * 2 * math.pi / 60

    @property
    def torque_per_ampere(self) -> float:
        """Ratio of stall torque and stall current [N m/A]."""
        return self.stall_torque_n_m / self.stall_current_a

    @property
    def most_current_a(self) -> float:
        """Largest current limit [A]."""
        return self.most_current * self.current_unit_a


_12_V: Final = (10.0, 14.8)
_5_V: Final = (3.7, 6.0)
_11_V: Final = (6.5, 12.0)
SERVO_MODELS: Final[dict[ModelName, ServoModel]] = {
    "XM430-W210": ServoModel(1030, 77, 3.0, 2.3, 2.69e-3, 1193, 12.0, _12_V),
    "XM430-W350": ServoModel(1020, 46, 4.1, 2.3, 2.69e-3, 1193, 12.0, _12_V),
    "XH430-W210": ServoModel(1010, 50, 2.5, 1.3, 2.69e-3, 648, 12.0, _12_V),
    "XH430-W350": ServoModel(1000, 30, 3.4, 1.3, 2.69e-3, 648, 12.0, _12_V),
    "XM540-W150": ServoModel(1130, 53, 7.3, 4.4, 2.69e-3, 2047, 12.0, _12_V),
    "XM540-W270": ServoModel(1120, 30, 10.6, 4.4, 2.69e-3, 2047, 12.0, _12_V),
    "XL330-M077": ServoModel(1190, 383, 0.215, 1.47, 1e-3, 1750, 5.0, _5_V),
    "XL330-M288": ServoModel(1200, 103, 0.52, 1.47, 1e-3, 1750, 5.0, _5_V),
    "XC330-M181": ServoModel(1230, 129, 0.60, 1.80, 1e-3, 1750, 5.0, _5_V),
    "XC330-M288": ServoModel(1240, 81, 0.93, 1.80, 1e-3, 1750, 5.0, _5_V),
    "XC330-T181": ServoModel(1210, 104, 0.76, 0.80, 1e-3, 910, 11.1, _11_V),
    "XC330-T288": ServoModel(1220, 65, 0.92, 0.80, 1e-3, 910, 11.1, _11_V),
}
MODEL_NAMES: Final[tuple[ModelName, ...]] = get_args(ModelName)
UNSUITED: Final = {
    12: "AX-12, which has no current limit and speaks protocol 1 only",
    18: "AX-18, which has no current limit and speaks protocol 1 only",
    29: "MX-28 with protocol 1",
    30: "MX-28, which has no current limit",
    310: "MX-64 with protocol 1",
    311: "MX-64, whose control table has no tested limits here",
    320: "MX-106 with protocol 1",
    321: "MX-106, whose control table has no tested limits here",
    350: "XL-320, which has no current limit",
    1060: "XL430-W250, which has no current limit",
    1070: "XC430-W150, which has no current limit",
    1080: "XC430-W240, which has no current limit",
    1090: "2XL430-W250, which has no current limit",
    1160: "2XC430-W250, which has no current limit",
}
"""servos that are met on such buses and cannot be used, by model number, with the reason"""


def model_of(number: int) -> ModelName | None:
    """Name of the model with a number; None if it cannot drive the striker."""
    return next((name for name, model in SERVO_MODELS.items() if model.number == number), None)


def unsuited_text(number: int) -> str:
    """Reason why a servo with this model number cannot drive the striker, with models that can."""
    known = ", ".join(MODEL_NAMES)
    if number in UNSUITED:
        return f"the servo is an {UNSUITED[number]}; use one of {known}"
    return f"the servo's model number is {number}, which is not known here; use one of {known}"
