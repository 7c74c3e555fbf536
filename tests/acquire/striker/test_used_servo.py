"""Servos that a former user has changed, of other models, and whose supply fails in a swing."""

from __future__ import annotations

import math
import time
from pathlib import Path

import pytest

from acquire.errors import StrikerError, StrikerFault, StrikerNotFound
from acquire.striker.base import StrikerState
from acquire.striker.motion import SLOW_RAD_S
from acquire.virtual.dynamixel_servo import HardwareError
from schemas.servo_models import SERVO_MODELS, UNSUITED, ModelName, unsuited_text
from tests.acquire.striker.conftest import Heard
from tests.acquire.striker.plant import Plant

CLEARED = [
    {"Drive Mode": 4},
    {"Drive Mode": 8},
    {"Drive Mode": 1},
    {"Drive Mode": 13, "Homing Offset": -700},
    {"Homing Offset": 500},
    {"Startup Configuration": 3},
    {"Secondary(Shadow) ID": 7},
    {"PWM Limit": 100},
]

BETWEEN = ("XM430-W350", "XH430-W210", "XM540-W150", "XL330-M288", "XC330-M288", "XC330-T181")
"""models that differ from another one of their series, with the same units and limits, by the gear alone"""


def fastest_rad_s(plant: Plant, since_ns: int) -> float:
    """Largest angular speed of the arm since a time [rad/s]."""
    return max(abs(omega) for when, _, omega in plant.history if when >= since_ns)


@pytest.mark.parametrize("memory", CLEARED, ids=str)
def test_a_used_servo_moves_as_ordered(tmp_path: Path, heard: Heard, memory: dict[str, int]) -> None:
    with Plant(tmp_path, memory=memory) as plant:
        config = plant.config()
        if memory.get("Drive Mode", 0) & 1 or "Homing Offset" in memory:
            # Its positions change: nothing moves before a person was told once.
            striker = heard.striker(config)
            with pytest.raises(StrikerError, match="positions have changed: check the arm's angle"):
                striker.open()
            striker.close()
        began_ns = time.monotonic_ns()
        with heard.opened(config) as striker:
            striker.home()
            assert striker.state is StrikerState.HOMED
            assert plant.angle == pytest.approx(config.cocked_angle_rad, abs=0.01)
            assert fastest_rad_s(plant, began_ns) < 1.4 * SLOW_RAD_S
            for name in memory:
                assert plant.servo.registers[name] in {0, 255, 885}


def test_an_old_firmware_is_refused_with_its_remedy(tmp_path: Path, heard: Heard) -> None:
    with Plant(tmp_path, memory={"Firmware Version": 37, "Drive Mode": 4}) as plant:
        striker = heard.striker(plant.config())
        with pytest.raises(StrikerError, match=r"firmware 37 has no bus watchdog.*DYNAMIXEL Wizard"):
            striker.open()
        assert plant.servo.registers["Drive Mode"] == 4  # nothing was written
        striker.close()


@pytest.mark.parametrize(
    "model", [pytest.param(name, marks=[pytest.mark.slow] * (name in BETWEEN)) for name in SERVO_MODELS]
)
def test_every_model_strikes(tmp_path: Path, heard: Heard, model: ModelName) -> None:
    with Plant(tmp_path, model=model) as plant:
        config = plant.config(current_limit_a=min(1.0, SERVO_MODELS[model].most_current_a))
        speed = 0.5 * config.tip_speeds().fastest_m_s
        with heard.opened(config) as striker:
            striker.home()
            striker.arm()
            striker.cock()
            outcome = striker.strike("s1", speed)
            assert striker.state is StrikerState.DISARMED
    assert outcome.contact_time_ns is not None
    assert outcome.tip_speed_m_s == pytest.approx(speed, rel=0.1)


def test_a_slow_model_allows_slow_strikes_only(tmp_path: Path) -> None:
    with Plant(tmp_path, model="XM430-W350") as plant:
        assert plant.config().tip_speeds().fastest_m_s == pytest.approx(0.578, abs=0.001)
        weak = plant.config(supply_v=11.1).tip_speeds()
        assert weak.fastest_m_s == pytest.approx(0.578 * 11.1 / 12, abs=0.001)


def test_another_model_than_in_the_rig_file_is_refused(tmp_path: Path, heard: Heard) -> None:
    with Plant(tmp_path, model="XM430-W350") as plant:
        striker = heard.striker(plant.config(model="XM430-W210"))
        with pytest.raises(StrikerNotFound, match='write model = "XM430-W350" in its section'):
            striker.open()
        striker.close()


def test_unsuited_models_are_named_with_the_reason() -> None:
    assert "XL430-W250, which has no current limit; use one of XM430-W210" in unsuited_text(1060)
    assert "model number is 9999, which is not known" in unsuited_text(9999)
    assert not {model.number for model in SERVO_MODELS.values()} & set(UNSUITED)


def test_the_supply_fails_in_a_swing(tmp_path: Path, heard: Heard) -> None:
    """A brown-out restarts the servo: torque, gains and watchdog are gone, and it answers again soon."""
    with Plant(tmp_path) as plant, heard.opened(plant.config()) as striker:
        striker.home()
        striker.arm()
        striker.cock()
        ordered = plant.config().tip_speeds().fastest_m_s * 0.5 / plant.config().arm_length_m
        plant.act_when(lambda angle: angle > -0.3, plant.servo._reboot)
        with pytest.raises(StrikerFault, match="restarted"):
            striker.strike("s1", ordered * plant.config().arm_length_m)
        assert striker.state is StrikerState.FAULT
        assert fastest_rad_s(plant, plant.happened[0]) < 1.1 * ordered
        striker.home()  # from the fault, as the next session does
        assert striker.state is StrikerState.HOMED
        assert plant.servo.registers["Position P Gain"] > 800


def test_an_arm_in_motion_is_braked_before_a_faulty_servo_loses_its_torque(
    tmp_path: Path, heard: Heard
) -> None:
    with Plant(tmp_path) as plant, heard.opened(plant.config()) as striker:
        striker.home()
        striker.arm()
        striker.cock()
        plant.act_when(
            lambda angle: angle > -0.3, lambda _now_ns: plant.servo.fail(HardwareError.INPUT_VOLTAGE)
        )
        with pytest.raises(StrikerFault, match="input voltage"):
            striker.strike("s1", 0.3)
        time.sleep(0.2)
        moving = [when for when, _, omega in plant.history if abs(omega) > 0.15]
        assert max(moving) - plant.happened[0] < 100_000_000 + 1e6 * plant.delay_ms(plant.happened[0])
        assert plant.servo.registers["Torque Enable"] == 0


def test_a_wrong_supply_voltage_is_named(tmp_path: Path, heard: Heard) -> None:
    with Plant(tmp_path) as plant, heard.opened(plant.config()) as striker:
        striker.home()
        plant.servo.registers["Present Input Voltage"] = 72
        plant.servo.fail(HardwareError.INPUT_VOLTAGE)
        with pytest.raises(StrikerFault, match="input voltage; check the supply"):
            striker.arm()
        assert plant.servo.registers["Torque Enable"] == 0
        at = plant.angle
        time.sleep(0.1)
        assert math.isclose(plant.angle, at, abs_tol=0.2)
