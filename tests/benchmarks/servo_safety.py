"""Faults of servos, with and without the striker's precautions: how fast the arm moves, and how long.

Each case is run twice on the simulated arm: with the striker as it is, and without the part of it that is
meant for the case. The motion is that of the simulated arm, not the servo's report.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

from rich.console import Console
from rich.table import Table

from acquire.errors import StrikerError
from acquire.striker import motion, servo
from acquire.striker.dynamixel import DynamixelStriker
from acquire.striker.motion import SLOW_RAD_S
from acquire.virtual.dynamixel_servo import HardwareError
from tests.acquire.striker.conftest import Heard
from tests.acquire.striker.plant import ARM_LENGTH, Plant

MOVING_RAD_S = 0.15
"""angular speed above which the arm counts as moving [rad/s]"""
TIP_SPEED_M_S = 0.3
AFTER_S = 1.0
"""time for which the arm is watched after a fault [s]"""


@dataclass(frozen=True)
class Row:
    """Motion of the arm in one case."""

    case: str
    precautions: bool
    fastest_rad_s: float
    """largest angular speed"""
    ordered_rad_s: float
    moving_ms: float | None
    """time until the arm rested after the fault; None if there was no fault in motion"""
    text: str
    """what the striker said"""


@contextlib.contextmanager
def without_precautions() -> Iterator[None]:
    """Check neither memory, firmware nor restarts, wait 100 ms for the bus, and brake no faulty servo."""
    with (
        mock.patch.object(servo, "WATCHDOG_UNITS", 5),
        mock.patch.object(servo, "SAFE_MEMORY", {}),
        mock.patch.object(servo, "positions_problem", return_value=""),
        mock.patch.object(servo, "firmware_problem", return_value=""),
        mock.patch.object(motion, "MAX_UNWATCHED_NS", 0),
        mock.patch.object(motion.ArmMotion, "brake"),
    ):
        yield


def measure(
    case: str, memory: dict[str, int], act: Callable[[Plant, DynamixelStriker], float], ordered: float
) -> Iterator[Row]:
    """Rows of one case, without the precautions and with them.

    Args:
        case: its name.
        memory: what the servo remembers.
        act: moves the arm; returns the monotonic time of the fault [s], or 0 without one.
        ordered: largest angular speed that is ordered [rad/s].
    """
    for precautions in (False, True):
        how = contextlib.nullcontext() if precautions else without_precautions()
        with TemporaryDirectory() as folder, how, Plant(Path(folder), memory=memory) as plant:
            striker = Heard().striker(plant.config())
            said, fault_s = "", 0.0
            try:
                with contextlib.suppress(StrikerError):
                    striker.open()  # says once that positions have changed
                striker.close()
                striker.open()
                fault_s = act(plant, striker)
            except StrikerError as error:
                said = str(error).partition(": ")[2]
                fault_s = plant.happened[0] * 1e-9 if plant.happened else 0.0
            if fault_s:
                time.sleep(AFTER_S)
            fastest = max((abs(omega) for _, _, omega in plant.history), default=0.0)
            moving = [
                when for when, _, omega in plant.history if abs(omega) > MOVING_RAD_S and when > fault_s * 1e9
            ]
            striker.close()
            still_ms = (max(moving, default=round(fault_s * 1e9)) * 1e-6 - fault_s * 1e3) if fault_s else None
            yield Row(case, precautions, fastest, ordered, still_ms, said)


def home(_plant: Plant, striker: DynamixelStriker) -> float:
    """Home the arm."""
    striker.home()
    return 0.0


def _cocked(striker: DynamixelStriker) -> None:
    striker.home()
    striker.arm()
    striker.cock()


def strike_frozen(plant: Plant, striker: DynamixelStriker) -> float:
    """Strike, and lose every request from the middle of the swing on: the bus watchdog trips."""
    _cocked(striker)
    plant.act_when(
        lambda _angle: plant.omega > 0.8 * TIP_SPEED_M_S / ARM_LENGTH, lambda _now_ns: plant.frozen.set()
    )
    with contextlib.suppress(StrikerError):
        striker.strike("s1", TIP_SPEED_M_S)
    return plant.happened[0] * 1e-9


def strike_undervolted(plant: Plant, striker: DynamixelStriker) -> float:
    """Strike, and let the servo report a wrong supply voltage in the middle of the swing."""
    _cocked(striker)
    plant.act_when(
        lambda _angle: plant.omega > 0.8 * TIP_SPEED_M_S / ARM_LENGTH,
        lambda _now_ns: plant.servo.fail(HardwareError.INPUT_VOLTAGE),
    )
    striker.strike("s1", TIP_SPEED_M_S)
    return plant.happened[0] * 1e-9


def strike_restarted(plant: Plant, striker: DynamixelStriker) -> float:
    """Strike, and restart the servo in the middle of the swing, as a supply that drops does."""
    _cocked(striker)
    plant.act_when(lambda _angle: plant.omega > 0.8 * TIP_SPEED_M_S / ARM_LENGTH, plant.servo._reboot)
    striker.strike("s1", TIP_SPEED_M_S)
    return plant.happened[0] * 1e-9


CASES = (
    ("Drive Mode 4", {"Drive Mode": 4}, home, SLOW_RAD_S),
    ("Drive Mode 1", {"Drive Mode": 1}, home, SLOW_RAD_S),
    ("Homing Offset 500", {"Homing Offset": 500}, home, SLOW_RAD_S),
    ("firmware 37", {"Firmware Version": 37}, home, SLOW_RAD_S),
    ("watchdog trips", {}, strike_frozen, TIP_SPEED_M_S / ARM_LENGTH),
    ("watchdog trips, offset 500", {"Homing Offset": 500}, strike_frozen, TIP_SPEED_M_S / ARM_LENGTH),
    ("wrong voltage in the swing", {}, strike_undervolted, TIP_SPEED_M_S / ARM_LENGTH),
    ("restart in the swing", {}, strike_restarted, TIP_SPEED_M_S / ARM_LENGTH),
)


def main() -> None:
    """Print a table of all cases."""
    table = Table("case", "precautions", "fastest [rad/s]", "ordered", "moving after [ms]", "said")
    for case in CASES:
        for row in measure(*case):
            still = "" if row.moving_ms is None else f"{row.moving_ms:.0f}"
            table.add_row(
                row.case,
                "yes" if row.precautions else "no",
                f"{row.fastest_rad_s:.2f}",
                f"{row.ordered_rad_s:.2f}",
                still,
                row.text,
            )
    Console(width=170).print(table)


if __name__ == "__main__":
    main()
