"""The striker board through all that the rig does with it: check, home, strike, stop, session.

The board is the virtual one with its arm and a wall, over a pseudo-terminal; `acquire discover` does not
search for boards.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerError
from acquire.preflight.board import check_board, read_board
from acquire.preflight.check import Outcome
from acquire.striker.base import Striker
from acquire.striker.kinds import make_striker
from acquire.virtual.device_kinds import DeviceKinds
from schemas.rig import StrikerConfig
from tests.acquire.striker.board_bench import LENGTH, BoardBench
from tests.benchmarks.device_sessions import session_cell

STILL_RAD_S = 0.15
"""angular speed below which the arm counts as resting [rad/s]"""
LOOK_S = 0.001
"""time between two looks at the arm [s]"""
WATCH_S = 1.5
"""time for which the arm is watched after a stop [s]"""


def board_rows() -> Iterator[tuple[str, Callable[[], dict[str, str]]]]:
    """Rows of a table: name of a board, and a function that finds out what each step gives.

    The step that fails is the last.
    """
    yield "striker board, with a contact sensor", partial(_row_and_session, "contact")
    yield "striker board, without a sensor", partial(_bench_row, "none")


def _row_and_session(senses: str) -> dict[str, str]:
    return _bench_row(senses) | {"session": session_cell(DeviceKinds(striker="serial"))}


def _bench_row(senses: str) -> dict[str, str]:
    with TemporaryDirectory() as folder, BoardBench(Path(folder)) as bench:
        bench.board.firmware.senses = senses
        return _row(bench)


def _row(bench: BoardBench) -> dict[str, str]:
    config = bench.config()
    check = check_board(lambda each: read_board(each, SystemClock()), config)
    found = {"check": "pass" if check.outcome is Outcome.PASS else f"{check.name}: {check.found}"}
    striker = _striker(config)
    step = "home"
    try:
        striker.open()
        striker.home()
        found["home"] = "homed"
        step = "strike"
        found["strike"] = _struck(bench, striker)
        step = "stop"
        found["stop"] = _stopped(bench, striker)
    except StrikerError as error:
        found[step] = f"refused: {error}"
    finally:
        striker.close()
    return found


def _striker(config: StrikerConfig) -> Striker:
    return make_striker(config, lambda _: None, lambda _: None, lambda _: None, SystemClock())


def _struck(bench: BoardBench, striker: Striker) -> str:
    """Speed at the wall, and error of the contact's time against the true one."""
    striker.arm()
    striker.cock()
    fastest: list[float] = []
    ended = threading.Event()

    def watch() -> None:
        while not ended.is_set():
            fastest.append(bench.omega)
            time.sleep(LOOK_S)

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        outcome = striker.strike("s1", 0.3)
    finally:
        ended.set()
        thread.join()
    speed = f"{max(fastest) * LENGTH:.2f} of 0.30 m/s"
    if outcome.contact_time_ns is None:
        return f"{speed}, contact not timed"
    return f"{speed}, contact {1e-6 * (outcome.contact_time_ns - bench.touches[0]):+.2f} ms off"


def _stopped(bench: BoardBench, striker: Striker) -> str:
    """Stop in the middle of a swing without a wall: time until the arm rests."""
    bench.wall = False
    for verb in (striker.home, striker.arm, striker.cock):
        verb()
    pressed: list[float] = []

    def press() -> None:
        while bench.omega * LENGTH < 0.1:
            time.sleep(LOOK_S)
        pressed.append(time.monotonic())
        striker.stop()

    thread = threading.Thread(target=press)
    thread.start()
    with contextlib.suppress(StrikerError):
        striker.strike("s2", 0.3)
    thread.join()
    rested = pressed[0]
    while time.monotonic() < pressed[0] + WATCH_S:
        if abs(bench.omega) > STILL_RAD_S:
            rested = time.monotonic()
        time.sleep(LOOK_S)
    return f"rests after {1e3 * (rested - pressed[0]):.0f} ms"
