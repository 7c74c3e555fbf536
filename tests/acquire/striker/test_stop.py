"""A stop ends any motion within 20 ms, also on a faulty bus, and holds the arm where it came to rest."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from acquire.errors import StrikerRefused
from acquire.striker.base import StrikerState
from acquire.striker.dynamixel import DynamixelStriker
from tests.acquire.striker.conftest import Heard, home_arm_and_cock, wait_for
from tests.acquire.striker.lateness import Lateness
from tests.acquire.striker.plant import ARM_LENGTH, Plant

LIMIT_S = 0.02
STILL_RAD_S = 0.3
"""speed below which the arm counts as still [rad/s]: 36 mm/s at the tip, from which it stops within 2 mm"""


def frame_lost(plant: Plant) -> None:
    plant.frames_to_lose = 1


def answers_late(plant: Plant) -> None:
    plant.answers_come_late(0.008)
    time.sleep(0.012)


def moving_s(plant: Plant, since_ns: int, rad_s: float = STILL_RAD_S) -> float:
    return (
        max((t - since_ns for t, _, omega in plant.history if t > since_ns and abs(omega) > rad_s), default=0)
        * 1e-9
    )


def stop_when(
    striker: DynamixelStriker, condition: Callable[[], bool], before: Callable[[], None] = lambda: None
) -> list[int]:
    """Start a thread that stops the striker once `condition` holds, at most 3 s from now.

    Returns:
        List to which the thread appends the host monotonic time of the stop [ns]; empty until then.
    """
    when: list[int] = []

    def act() -> None:
        if wait_for(condition, 3.0, pause_s=0.0005):
            before()
            when.append(time.monotonic_ns())
            striker.stop()

    threading.Thread(target=act, name="stop").start()
    return when


def stopped_in_the_swing(
    plant: Plant, heard: Heard, speed: float, trouble: Callable[[Plant], None]
) -> tuple[float, float]:
    """Stop a swing at `speed` [m/s] near its full velocity, after `trouble` was caused on the bus.

    Returns:
        Time for which the arm still moved [s], and worst delay of a thread of this host meanwhile [s].
    """
    with heard.opened(plant.config()) as striker:
        home_arm_and_cock(striker)
        with Lateness() as lateness:
            when = stop_when(striker, lambda: plant.omega > 0.9 * speed / ARM_LENGTH, lambda: trouble(plant))
            with pytest.raises(StrikerRefused, match="stopped on request"):
                striker.strike("s", speed)
            plant.answers_come_late(0.0)
            time.sleep(0.05)
        moved_s = moving_s(plant, when[0])
        assert striker.state is StrikerState.DISARMED
        assert plant.servo.registers["Torque Enable"] == 1
        assert plant.servo.registers["Position P Gain"] > 0
        assert plant.servo.registers["Position D Gain"] == 0
        assert abs(plant.omega) < 0.1
        with pytest.raises(StrikerRefused, match="home"):
            striker.arm()
        striker.home()
        assert "STOPPED" in heard.kinds()
        return moved_s, lateness.worst_s


@pytest.mark.parametrize(
    "trouble",
    [lambda _: None, frame_lost, answers_late],
    ids=["a good bus", "a frame lost", "answers 8 ms late"],
)
@pytest.mark.parametrize("speed", [0.3, 0.5, 0.7])
def test_a_swing_ends_within_20_ms(
    plant: Plant, heard: Any, speed: float, trouble: Callable[[Plant], None]
) -> None:
    moved_s, late_s = stopped_in_the_swing(plant, heard, speed, trouble)
    assert moved_s < LIMIT_S + 3 * late_s


@pytest.mark.parametrize("motion", ["homing", "cocking", "turned back", "catch"])
def test_every_motion_ends_within_20_ms(plant: Plant, heard: Any, motion: str) -> None:
    with heard.opened(plant.config()) as striker:
        under_way = {
            "homing": lambda: plant.omega < -0.2,
            "cocking": lambda: (
                striker.state is StrikerState.COCKING
            ),  # parked there already, it need not move
            "turned back": lambda: plant.omega < -2.0,
            "catch": lambda: plant.omega < -0.5 and plant.angle < -0.3,
        }
        if motion != "homing":
            striker.home()
            striker.arm()
        if motion in {"turned back", "catch"}:
            striker.cock()
        with Lateness() as lateness:
            when = stop_when(striker, under_way[motion])
            with pytest.raises(StrikerRefused, match="stopped on request"):
                {"homing": striker.home, "cocking": striker.cock}.get(
                    motion, lambda: striker.strike("s", 0.3)
                )()
            time.sleep(0.05)
        assert moving_s(plant, when[0]) < LIMIT_S + 3 * lateness.worst_s
        assert striker.state is StrikerState.DISARMED
        assert abs(plant.omega) < 0.1
        striker.home()


def test_stop_at_rest_causes_no_motion(plant: Plant, heard: Any) -> None:
    with heard.opened(plant.config()) as striker:
        striker.stop()
        assert striker.state is StrikerState.DISARMED
        striker.home()
        for verbs in ((), (striker.arm,), (striker.arm, striker.cock)):
            for verb in verbs:
                verb()
            begun_ns = time.monotonic_ns()
            striker.stop()
            assert striker.state in {StrikerState.HOMED, StrikerState.DISARMED}
            assert moving_s(plant, begun_ns, 0.1) == 0.0
