"""Virtual striker board behind a pseudo-terminal, with an arm that it launches and that springs back.

The arm is held drawn back. When the board fires, a drive brings it to the ordered speed within a per cent
and lets it coast before the object; after the contact, or some time without one, it is drawn back again. Not
modelled: a solenoid's or spring's own curve of force, play, a board that is slow to reply, noise on the line.
"""

from __future__ import annotations

import contextlib
import enum
import os
import random
from typing import TYPE_CHECKING

from acquire.virtual.pty_device import PtyDevice
from acquire.virtual.station import ARM_LENGTH_M
from acquire.virtual.striker_firmware import StrikerFirmware

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

DRAWN_BACK_RAD = -0.5
"""angle at which the arm is held [rad]"""
COAST_RAD = -0.08
"""angle from which on the drive is off [rad]"""
RETURN_NS = 1_000_000_000
"""time after the firing at which the arm is drawn back although it met nothing [ns]"""
SPEED_SD = 0.005
"""relative standard deviation of the speed from strike to strike"""
SENSOR_DELAY_NS = 300_000
"""largest delay of the contact sensor [ns]"""
MAX_TORQUE_N_M = 1.3
RETURN_RAD_S = 25.0
"""natural frequency with which the arm is drawn back, critically damped [rad/s]"""
DRIVE_S = 0.008
"""time constant with which the drive brings the arm to its speed [s]"""


class _Motion(enum.Enum):
    """What acts on the arm: the hold and return spring, the drive, or nothing."""

    HELD = "held"
    DRIVEN = "driven"
    COASTING = "coasting"


class SerialBoard(PtyDevice):
    """Virtual board and arm, owned by the loop that also steps the physics.

    Call `service` as soon as `fd`, the pseudo-terminal's descriptor, is readable, `torque` once per physics
    step, and `touch` at every contact.

    Args:
        plant: function that returns position [rad] and velocity [rad/s] of the arm.
        inertia_kg_m2: moment of inertia of the arm about its hinge, for which the drive is adjusted.
        clock_ns: the world's clock (CLOCK_MONOTONIC) [ns].
        link_path: symbolic link to create for the pty; an existing one is replaced.
        seed: seed of the board's clock, the speeds and the sensor's delays.
    """

    next_answer_ns: int | None = None
    """always None: no reply is delayed"""

    def __init__(
        self,
        plant: Callable[[], tuple[float, float]],
        inertia_kg_m2: float,
        clock_ns: Callable[[], int],
        link_path: Path,
        seed: int = 0,
    ) -> None:
        self._plant, self._inertia, self._clock_ns = plant, inertia_kg_m2, clock_ns
        self._random = random.Random(seed)  # noqa: S311 - noise, not a secret
        self._motion, self._target_rad_s, self._fired_ns = _Motion.HELD, 0.0, 0
        self._time_ns = clock_ns()
        self.firmware = StrikerFirmware(seed, self._time_ns, self._fire, self._end_drive, self._is_drawn_back)
        super().__init__(link_path)

    def on_unplugged(self) -> None:
        """Reset the board, which has lost its power."""
        self.firmware.reset(self._time_ns)

    def fail(self, _bit: int = 0) -> None:
        """Put the board into the fault `overload`, whatever bit is given; its `stop` ends it."""
        self.firmware.fail("overload")

    def service(self, now_ns: int) -> None:
        """Read received requests, carry them out and send the replies. Never blocks.

        Args:
            now_ns: host monotonic time of the call [ns]; requests that arrive during it are later.
        """
        self._time_ns = now_ns
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self.fd, 4096):
                self._time_ns = self._clock_ns()
                if replies := self.firmware.receive(data, self._time_ns):
                    os.write(self.fd, replies)

    def torque(self, position_rad: float, velocity_rad_s: float, now_ns: int) -> float:
        """Torque on the arm [N m] for the physics step that begins now.

        Args:
            position_rad: angle of the arm [rad].
            velocity_rad_s: angular velocity of the arm [rad/s].
            now_ns: world time [ns].
        """
        self._time_ns = now_ns
        self.firmware.keep_interlocks(now_ns)
        if self._motion is _Motion.DRIVEN and position_rad > COAST_RAD:
            self._motion = _Motion.COASTING
        if self._motion is not _Motion.HELD and now_ns - self._fired_ns > RETURN_NS:
            self._motion = _Motion.HELD
        acceleration = 0.0
        if self._motion is _Motion.DRIVEN:
            acceleration = (self._target_rad_s - velocity_rad_s) / DRIVE_S
        elif self._motion is _Motion.HELD:
            acceleration = (
                RETURN_RAD_S**2 * (DRAWN_BACK_RAD - position_rad) - 2 * RETURN_RAD_S * velocity_rad_s
            )
        return max(-MAX_TORQUE_N_M, min(MAX_TORQUE_N_M, self._inertia * acceleration))

    def touch(self, time_ns: int) -> None:
        """Signal a contact of the tip that began at `time_ns` (host monotonic) and has ended."""
        if self._motion is not _Motion.HELD:
            self._motion = _Motion.HELD
            self.firmware.touch(time_ns + self._random.randrange(SENSOR_DELAY_NS))
        else:
            self.firmware.touch(time_ns)

    def _fire(self, speed_mm_s: int) -> None:
        speed = 1e-3 * speed_mm_s * (1 + self._random.gauss(0.0, SPEED_SD))
        self._target_rad_s = speed / ARM_LENGTH_M
        self._motion, self._fired_ns = _Motion.DRIVEN, self._time_ns

    def _end_drive(self) -> None:
        self._motion = _Motion.HELD

    def _is_drawn_back(self) -> bool:
        return abs(self._plant()[0] - DRAWN_BACK_RAD) < 0.05
