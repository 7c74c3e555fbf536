"""Servos through all that the rig does with them: discover, check, home, strike, stop, session.

Each model is simulated with the vendor's control table, an adapter that takes a millisecond per answer, and
one arm of 2.5 g m²; used ones and those that cannot serve are among them.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerError
from acquire.preflight.check import Outcome
from acquire.preflight.servo import check_servo, read_servo
from acquire.striker import discovery
from acquire.striker.discovery import discover_servos
from acquire.striker.dynamixel import DynamixelStriker
from acquire.virtual.device_kinds import DeviceKinds
from schemas.servo_models import SERVO_MODELS, ModelName
from tests.acquire.striker.conftest import Heard
from tests.acquire.striker.plant import Plant
from tests.acquire.striker.test_discovery import old_servo
from tests.benchmarks.device_sessions import session_cell

STILL_RAD_S = 0.15
"""angular speed below which the arm counts as resting [rad/s]"""
USED: tuple[tuple[str, Mapping[str, int]], ...] = (
    ("Drive Mode 4", {"Drive Mode": 4}),
    ("offset 500", {"Homing Offset": 500}),
    ("firmware 37", {"Firmware Version": 37}),
)
STEPS = ("discover", "check", "home", "strike", "stop", "session")


def servo_rows() -> Iterator[tuple[str, Callable[[], dict[str, str]]]]:
    """Rows of a table: name of a servo, and a function that finds out what each of STEPS gives.

    A step that fails is the last of its row, with the reason.
    """
    for model in SERVO_MODELS:
        yield model, partial(_row_and_session, model)
    for name, memory in USED:
        yield f"XM430-W210, {name}", partial(_row, "XM430-W210", memory)
    yield "AX-12 (protocol 1)", _old


def _row_and_session(model: ModelName) -> dict[str, str]:
    return _row(model, {}) | {"session": session_cell(DeviceKinds(servo=model))}


def _row(model: ModelName, memory: Mapping[str, int]) -> dict[str, str]:
    found: dict[str, str] = {}
    with TemporaryDirectory() as folder, Plant(Path(folder), gap=0.0, model=model, memory=memory) as plant:
        limit_a = min(1.0, SERVO_MODELS[model].most_current_a)
        config = plant.config(current_limit_a=limit_a)
        found["discover"] = _discovered(config.port)
        checks = check_servo(lambda each: read_servo(each, SystemClock()), config)
        failed = [f"{each.name}: {each.found}" for each in checks if each.outcome is Outcome.FAIL]
        found["check"] = "; ".join(failed) or "pass"
        striker = Heard().striker(config)
        try:
            try:
                striker.open()
            except StrikerError as error:
                found["home"] = f"refused once: {_reason(error)}"
                striker.close()
                striker.open()
            striker.home()
            found["home"] = f"{found.get('home', '')} homed".strip()
            found["strike"] = _struck(striker, config.tip_speeds().fastest_m_s)
            found["stop"] = _stopped(plant, striker, config.tip_speeds().fastest_m_s)
        except StrikerError as error:
            step = (
                "home"
                if "homed" not in found.get("home", "")
                else "strike"
                if "strike" not in found
                else "stop"
            )
            found[step] = f"refused: {_reason(error)}"
        finally:
            striker.close()
    return found


def _discovered(port: str) -> str:
    with (
        mock.patch.object(discovery, "BAUD_RATES", (1_000_000,)),
        mock.patch.object(discovery, "OLD_IDS", (1, 2)),
    ):
        servos = list(discover_servos([port], lambda _: None))
    return "; ".join(servo.remedy or servo.name for servo in servos) or "nothing answers"


def _struck(striker: DynamixelStriker, fastest_m_s: float) -> str:
    for verb in (striker.arm, striker.cock):
        verb()
    outcome = striker.strike("s1", 0.5 * fastest_m_s)
    if outcome.contact_time_ns is None:
        return "no contact"
    return f"{outcome.tip_speed_m_s:.2f} of {0.5 * fastest_m_s:.2f} m/s"


def _stopped(plant: Plant, striker: DynamixelStriker, fastest_m_s: float) -> str:
    """Stop in the middle of a swing: time until the arm rests."""
    plant.restore(gap=0.0)
    for verb in (striker.home, striker.arm, striker.cock):
        verb()
    pressed: list[int] = []

    def press() -> None:
        while plant.omega < 0.25 * fastest_m_s / 0.12:
            time.sleep(0.0005)
        pressed.append(time.monotonic_ns())
        striker.stop()

    thread = threading.Thread(target=press)
    thread.start()
    with contextlib.suppress(StrikerError):
        striker.strike("s2", 0.5 * fastest_m_s)
    thread.join()
    time.sleep(0.3)
    moving = [when for when, _, omega in plant.history if abs(omega) > STILL_RAD_S]
    return f"rests after {max(0.0, (max(moving) - pressed[0]) * 1e-6):.0f} ms"


def _old() -> dict[str, str]:
    with old_servo(12, 2) as port:
        return {"discover": _discovered(port)}


def _reason(error: StrikerError) -> str:
    return str(error).partition(": ")[2]
