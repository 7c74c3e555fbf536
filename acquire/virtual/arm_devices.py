"""Virtual devices that can move the arm, by the kind of striker in the rig file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquire.virtual.dynamixel_servo import DynamixelServo
from acquire.virtual.serial_board import SerialBoard

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from acquire.virtual.objects import VirtualObject
    from acquire.virtual.world import World

ArmDevice = DynamixelServo | SerialBoard


def _servo(
    world: World, _thing: VirtualObject, clock_ns: Callable[[], int], folder: Path, seed: int
) -> DynamixelServo:
    return DynamixelServo(world.arm, clock_ns, folder / "ttyDXL", seed=seed)


def _board(
    world: World, thing: VirtualObject, clock_ns: Callable[[], int], folder: Path, seed: int
) -> SerialBoard:
    return SerialBoard(world.arm, thing.arm_inertia_kg_m2, clock_ns, folder / "ttyBoard", seed)


ARM_DEVICES: dict[str, Callable[..., ArmDevice]] = {"dynamixel": _servo, "serial": _board}
"""constructor of the device that moves the arm, by the kind of striker in the rig file"""
