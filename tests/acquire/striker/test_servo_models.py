"""Table of servo models against the vendor's own files, of which two programs have copies.

The addresses are those in `param/dxl_model` of ROBOTIS's dynamixel_hardware_interface (commit db2b903 of
2025-12-10), the same for all twelve models; those that are read come with dynamixel-sdk.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from acquire.config import RigLimits
from acquire.session.plan_fit import striker_limit_problem
from acquire.striker.control_table import control_table
from schemas.rig import StrikerConfig
from schemas.rig_limits import tip_speeds
from schemas.servo_models import SERVO_MODELS, ModelName
from tests.acquire.session.test_machine import plan, planned

ADDRESS_AND_SIZE = {
    "Model Number": (0, 2),
    "Firmware Version": (6, 1),
    "ID": (7, 1),
    "Baud Rate": (8, 1),
    "Return Delay Time": (9, 1),
    "Drive Mode": (10, 1),
    "Operating Mode": (11, 1),
    "Secondary(Shadow) ID": (12, 1),
    "Homing Offset": (20, 4),
    "Temperature Limit": (31, 1),
    "PWM Limit": (36, 2),
    "Current Limit": (38, 2),
    "Velocity Limit": (44, 4),
    "Max Position Limit": (48, 4),
    "Min Position Limit": (52, 4),
    "Shutdown": (63, 1),
    "Torque Enable": (64, 1),
    "Status Return Level": (68, 1),
    "Hardware Error Status": (70, 1),
    "Position D Gain": (80, 2),
    "Position I Gain": (82, 2),
    "Position P Gain": (84, 2),
    "Bus Watchdog": (98, 1),
    "Goal Current": (102, 2),
    "Profile Acceleration": (108, 4),
    "Profile Velocity": (112, 4),
    "Goal Position": (116, 4),
    "Realtime Tick": (120, 2),
    "Moving": (122, 1),
    "Moving Status": (123, 1),
    "Present PWM": (124, 2),
    "Present Current": (126, 2),
    "Present Velocity": (128, 4),
    "Present Position": (132, 4),
    "Present Input Voltage": (144, 2),
    "Present Temperature": (146, 1),
}


@pytest.mark.parametrize("model", SERVO_MODELS)
def test_registers_are_those_of_both_copies(model: ModelName) -> None:
    table = control_table(model)
    assert {name: (table[name].address, table[name].size) for name in ADDRESS_AND_SIZE} == ADDRESS_AND_SIZE


def test_numbers_are_those_of_the_sdk() -> None:
    spec = importlib.util.find_spec("dynamixel_easy_sdk")
    assert spec is not None
    assert spec.origin is not None
    lines = (Path(spec.origin).parent / "control_table" / "dynamixel.model").read_text(encoding="utf-8")
    files = dict(line.split("\t") for line in lines.splitlines()[1:])
    for name, model in SERVO_MODELS.items():
        assert files[str(model.number)].strip() == f"{name.lower().replace('-', '_')}.model"


def test_a_current_above_the_models_is_refused() -> None:
    with pytest.raises(ValueError, match=r"current_limit_a = 2 is above the 1\.75 A of an XL330-M288"):
        StrikerConfig(model="XL330-M288", current_limit_a=2.0)


def test_a_model_without_a_current_limit_is_refused_with_the_reason() -> None:
    with pytest.raises(ValueError, match="XL430-W250 cannot drive the striker, as it has no current limit"):
        StrikerConfig.model_validate({"model": "XL430-W250"})


def test_without_a_current_limit_a_small_model_gets_its_own() -> None:
    assert StrikerConfig(model="XC330-T181").current_limit_a == pytest.approx(0.91)
    assert StrikerConfig(model="XM540-W270").current_limit_a == 1.0


def test_a_plan_that_is_too_fast_names_what_would_do() -> None:
    slow = StrikerConfig(model="XM430-W350")
    limits = RigLimits(slow.tip_speeds(), None, [[0.0] * 4] * 4, slow.arm_length_m)
    problem = striker_limit_problem(plan(planned("s1")), limits)
    assert "may need 0.1 to 0.9 m/s, the striker swings at 0.06 to 0.578 m/s" in problem
    assert "an arm of 187 mm, or an XM430-W210" in problem
    assert tip_speeds(0.187, slow.cocked_angle_rad, SERVO_MODELS["XM430-W350"].no_load_rad_s).allow(0.9)
