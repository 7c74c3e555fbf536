"""Arm and box on its edge behind the virtual servo, stepped at 1 kHz in a thread.

The physics is independent of the virtual rig's: two pendulums with a spring between them.

The contact is Hunt and Crossley's (1975): force = k depth^1.5 (1 + a rate), k such that it lasts 3 ms.
"""

from __future__ import annotations

import math
import os
import select
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from acquire.virtual.dynamixel_protocol import HEADER
from acquire.virtual.dynamixel_servo import DynamixelServo, WireTime
from schemas.rig import StrikerConfig
from schemas.servo_models import ModelName

ARM_INERTIA = 0.0025
ARM_LENGTH = 0.12
ARM_WEIGHT_MOMENT = 0.08 * 9.81 * 0.06
BOX_HEIGHT = 0.1
BOX_INERTIA = 3e-4
BOX_K = 80.0
BOX_PHI = 0.4
SUBSTEPS = 10
TOUCH_S, TOUCH_UNITS = 0.003, 3.81
"""duration of the contact, in seconds and in units of the contact's own time scale"""
DAMPING = 2.08
"""restitution 0.4, with depth and rate in units of the closing speed"""
EFFECTIVE_MASS = ARM_INERTIA / ARM_LENGTH**2


@dataclass
class Touch:
    """One contact of the tip with the box."""

    time_ns: int
    """time of first contact [ns]"""
    tip_speed: float
    impulse: float = 0.0
    open: bool = True


class Plant:
    """Arm, box and virtual servo, stepped in a thread.

    `gap` is the distance of the object's face beyond the tip at angle 0 [m]; None for no object. Unlike
    a real arm, this one is late when its thread is, by up to `latest_ns`.
    """

    latest_ns = 0
    """greatest delay of a step of any plant since a test began, see tests/conftest.py"""

    def __init__(
        self,
        folder: Path,
        gap: float | None = None,
        seed: int = 0,
        baud_rate: int = 1_000_000,
        model: ModelName = "XM430-W210",
        memory: Mapping[str, int] | None = None,
    ) -> None:
        self.angle, self.omega = -0.52, 0.0  # gear friction holds it there
        self.theta, self.theta_dot = 0.0, 0.0
        self._state_ns = 0
        self.gap = gap
        self.touches: list[Touch] = []
        self.history: list[tuple[int, float, float]] = []
        self.delays: list[tuple[int, int]] = []
        """(time, delay) of each turn of the thread [ns]"""
        self.servo = DynamixelServo(
            self._state_now,
            time.monotonic_ns,
            folder / "ttyDXL",
            seed=seed,
            baud_rate=baud_rate,
            model=model,
            memory=memory,
        )
        self.model: ModelName = model
        self._closing = 1.0
        self._end = threading.Event()
        self.frozen = threading.Event()
        self.frames_to_lose = 0
        """number of requests still to be lost before the servo receives them"""
        self._wire = threading.Lock()
        self._plugged = True
        self._held = False
        self._awaited: tuple[Callable[[float], bool], Callable[[int], object]] | None = None
        self.happened: list[int] = []
        """times at which the awaited has happened [ns]"""
        self._thread = threading.Thread(target=self._run, name="plant")

    def __enter__(self) -> Plant:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        self.unplug()

    def unplug(self) -> None:
        """Remove the adapter's port; the servo keeps its power."""
        with self._wire:
            if self._plugged:
                self._plugged = False
                self.servo.close()

    def plug_in(self) -> None:
        """Create a new port with the old name."""
        with self._wire:
            self.servo.plug_in()
            self._plugged = True

    def config(self, **changes: object) -> StrikerConfig:
        known = {
            "port": str(self.servo.port_path),
            "model": self.model,
            "effective_mass_kg": EFFECTIVE_MASS,
            "effective_mass_sd_kg": 0.01,
        }
        return StrikerConfig.model_validate(known | changes)

    def restore(self, gap: float) -> None:
        self.gap, self.theta, self.theta_dot = gap, 0.0, 0.0
        self.touches.clear()

    def delay_ms(self, time_ns: int) -> float:
        """Longest delay [ms] of the simulated arm within 10 ms of a time; servo reads may be late by it."""
        return 1e-6 * max((late for when, late in self.delays if abs(when - time_ns) < 10_000_000), default=0)

    def hold(self) -> None:
        """Hold the arm where it is from now on, as by hand."""
        self._held = True

    def _run(self) -> None:
        next_ns = time.monotonic_ns()
        while not self._end.is_set():
            now = time.monotonic_ns()
            if now < next_ns:
                with self._wire:
                    self._serve((next_ns - now) * 1e-9)
                continue
            Plant.latest_ns = max(Plant.latest_ns, now - next_ns)
            self.delays.append((next_ns, now - next_ns))
            while next_ns <= now:
                self._step(next_ns, 0.001)
                next_ns += 1_000_000
            self._state_ns = next_ns

    def _state_now(self) -> tuple[float, float]:
        """Angle [rad] and speed [rad/s] of the arm now; a step computes its end in advance."""
        ahead_s = max(0.0, (self._state_ns - time.monotonic_ns()) * 1e-9)
        return self.angle - self.omega * ahead_s, self.omega

    def _serve(self, seconds: float) -> None:
        if not self._plugged:
            time.sleep(seconds)
            return
        due_ns = self.servo.next_answer_ns
        if due_ns is not None:
            seconds = min(seconds, max(0, due_ns - time.monotonic_ns()) * 1e-9)
        heard = bool(select.select([self.servo.fd], [], [], seconds)[0])
        if self.frozen.is_set():
            return
        if heard and self.frames_to_lose:
            first, *others = os.read(self.servo.fd, 4096).split(HEADER)
            lost = min(len(others), self.frames_to_lose)
            self.frames_to_lose -= lost
            self.servo._receive(
                first + b"".join(HEADER + frame for frame in others[lost:]), time.monotonic_ns()
            )
            self.servo.service(time.monotonic_ns())
        elif heard or due_ns is not None:
            self.servo.service(time.monotonic_ns())

    def answers_come_late(self, seconds: float) -> None:
        """Delay all answers of the servo by `seconds` from now on, as an adapter does; 0 ends the delay."""
        self.servo._wire = WireTime(round(seconds * 1e9)) if seconds else None

    def act_when(self, reached: Callable[[float], bool], act: Callable[[int], object]) -> None:
        """Call `act` with the time [ns] once `reached` is true of the arm's angle [rad]; `happened` keeps it.

        A supply that drops restarts the servo (`servo._reboot`); after a cut cable it hears nothing more
        (`frozen.set`).
        """
        self._awaited, self.happened = (reached, act), []

    def _step(self, now_ns: int, dt: float) -> None:
        if self._awaited is not None and self._awaited[0](self.angle):
            _, act = self._awaited
            self._awaited = None
            self.happened.append(now_ns)
            act(now_ns)
        torque = self.servo.torque(self.angle, self.omega, now_ns)
        self.history.append((now_ns, self.angle, self.omega))
        count = 1 if self.gap is None else SUBSTEPS
        for k in range(count):
            self._substep(torque, now_ns + round(k * dt / count * 1e9), dt / count)

    def _substep(self, torque: float, now_ns: int, dt: float) -> None:
        force = 0.0 if self.gap is None else self._force(now_ns, self.gap)
        self.omega += (
            (torque - ARM_WEIGHT_MOMENT * math.sin(self.angle) - ARM_LENGTH * force) / ARM_INERTIA * dt
        )
        if self._held:
            self.omega = 0.0
        self.angle += self.omega * dt
        if self.gap is not None:
            self.theta_dot += (force * BOX_HEIGHT / BOX_INERTIA - BOX_K * math.sin(BOX_PHI - self.theta)) * dt
            if self.theta <= 0 and self.theta_dot < 0:
                self.theta_dot = 0.0
            self.theta = max(0.0, self.theta + self.theta_dot * dt)
            if force:
                self.touches[-1].impulse += force * dt

    def _force(self, now_ns: int, gap: float) -> float:
        tip, tip_speed = ARM_LENGTH * math.sin(self.angle), ARM_LENGTH * self.omega
        depth = tip - gap - BOX_HEIGHT * self.theta
        rate = tip_speed - BOX_HEIGHT * self.theta_dot
        touching = bool(self.touches) and self.touches[-1].open
        if depth <= 0 or self.theta > 1.0:
            if touching:
                self.touches[-1].open = False
            return 0.0
        if not touching:
            if rate <= 0:
                return 0.0
            self.touches.append(Touch(now_ns - int(depth / rate * 1e9), tip_speed))
            self._closing = rate
        mass = 1 / (1 / EFFECTIVE_MASS + BOX_HEIGHT**2 / BOX_INERTIA)
        unit_s = TOUCH_S / TOUCH_UNITS
        stiffness = mass / unit_s**2 / math.sqrt(self._closing * unit_s)
        return max(0.0, stiffness * depth**1.5 * (1 + DAMPING * rate / self._closing))
