"""Virtual striker board with an arm and a wall, stepped at 1 kHz in a thread.

The wall stands at angle 0; the arm rebounds from it with half its speed. Not modelled: the object.
"""

from __future__ import annotations

import select
import threading
import time
from pathlib import Path

from acquire.virtual.serial_board import DRAWN_BACK_RAD, SerialBoard
from acquire.virtual.striker_firmware import FASTEST_MM_S, SLOWEST_MM_S
from schemas.rig import StrikerConfig

INERTIA, LENGTH = 0.0025, 0.12
RESTITUTION = 0.5
TOUCH_NS = 3_000_000
SPEED_RANGE = (SLOWEST_MM_S / 1000, FASTEST_MM_S / 1000)


class BoardBench:
    """Board and arm that run from `__enter__` to `__exit__`; no wall unless `wall` is True."""

    def __init__(self, folder: Path, seed: int = 0) -> None:
        self.angle, self.omega = DRAWN_BACK_RAD, 0.0
        self.wall = True
        self.touches: list[int] = []
        """true times of the contacts (host monotonic) [ns]"""
        self.board = SerialBoard(
            lambda: (self.angle, self.omega), INERTIA, time.monotonic_ns, folder / "ttyBoard", seed
        )
        self.silent = threading.Event()
        """while set, the board does not reply, as one that hangs"""
        self.held = threading.Event()
        """while set, the arm is held in front, as one that nobody draws back"""
        self.serving = threading.Lock()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="board-bench")

    def __enter__(self) -> BoardBench:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        self.board.close()

    def config(self, **changes: object) -> StrikerConfig:
        known = {"kind": "serial", "port": str(self.board.port_path), "speed_range_m_s": SPEED_RANGE}
        return StrikerConfig.model_validate(known | changes)

    def state(self) -> str:
        return self.board.firmware.state

    def _run(self) -> None:
        next_ns = time.monotonic_ns()
        while not self._end.is_set():
            now_ns = time.monotonic_ns()
            if now_ns < next_ns:
                self._serve((next_ns - now_ns) * 1e-9)
                continue
            with self.serving:
                self._step(next_ns)
            next_ns += 1_000_000

    def _serve(self, seconds: float) -> None:
        if self.silent.is_set() or not self.board.plugged_in:
            time.sleep(seconds)
            return
        if select.select([self.board.fd], [], [], seconds)[0]:
            with self.serving:
                if self.board.plugged_in and not self.silent.is_set():
                    self.board.service(time.monotonic_ns())

    def _step(self, time_ns: int) -> None:
        self.omega += self.board.torque(self.angle, self.omega, time_ns) / INERTIA * 1e-3
        if self.held.is_set():
            self.angle, self.omega = -0.1, 0.0
        if self.wall and self.angle + self.omega * 1e-3 > 0:
            self.omega *= -RESTITUTION
            self.touches.append(time_ns)
        self.angle += self.omega * 1e-3
        if self.touches and time_ns - self.touches[-1] == TOUCH_NS:
            self.board.touch(self.touches[-1])
