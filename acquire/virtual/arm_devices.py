"""Virtual devices that can move the arm, by the kind of striker in the rig file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from acquire.virtual.dynamixel_servo import DynamixelServo
from acquire.virtual.serial_board import SerialBoard
from schemas.servo_models import DEFAULT_MODEL, ModelName

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from acquire.virtual.world import World

ArmDevice = DynamixelServo | SerialBoard


@dataclass(frozen=True)
class ArmSetting:
    """What a device that moves the arm is given beside the world."""

    arm_inertia_kg_m2: float
    """moment of inertia of the arm about its hinge [kg m²]"""
    folder: Path
    """folder of the device's port"""
    seed: int
    """seed of the device's noise"""
    servo: ModelName = DEFAULT_MODEL
    """model of a servo"""


def _servo(world: World, clock_ns: Callable[[], int], setting: ArmSetting) -> DynamixelServo:
    port = setting.folder / "ttyDXL"
    return DynamixelServo(world.arm, clock_ns, port, seed=setting.seed, model=setting.servo)


def _board(world: World, clock_ns: Callable[[], int], setting: ArmSetting) -> SerialBoard:
    port = setting.folder / "ttyBoard"
    return SerialBoard(world.arm, setting.arm_inertia_kg_m2, clock_ns, port, setting.seed)


ARM_DEVICES: dict[str, Callable[[World, Callable[[], int], ArmSetting], ArmDevice]] = {
    "dynamixel": _servo,
    "serial": _board,
}
"""constructor of the device that moves the arm, by the kind of striker in the rig file"""
