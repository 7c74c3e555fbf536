"""Computed camera for tests of the stages behind a camera: no wire, packets or device settings.

Its clock runs 50 ppm fast from an arbitrary origin. The first four pixels of an image hold its number, so
that a test can identify the frame of an image. `CAMERA_FAULTS=lose:N,die:N` loses every Nth frame, or stops
sending once, after frame N, until it is opened again; `stick:N` never returns from reading frame N;
`freeze:N` does not return either and holds the interpreter, like a faulty library. If `CAMERA_FAULTS_ONCE`
names a file, the first process to load this module removes it; the cameras of later ones have no faults.
"""

from __future__ import annotations

import ctypes
import os
import sys
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from acquire.camera.base import Camera, CameraInfo
from acquire.clock.clock import Clock
from acquire.clock.reading import ClockReading
from acquire.errors import CameraLost, CameraNotFound
from acquire.frames.buffer_pool import BufferPool, PooledBuffer
from acquire.frames.frame import Frame
from schemas.rig import CameraConfig

ORIGIN_NS = 77_000_000_000
DRIFT = 50e-6


@dataclass
class Faults:
    lose_every: int = 0
    die_after: int = 0
    stick_at: int = 0
    freeze_at: int = 0

    @classmethod
    def from_environment(cls) -> Faults:
        entries = dict(entry.split(":") for entry in os.environ.get("CAMERA_FAULTS", "").split(",") if entry)
        once = os.environ.get("CAMERA_FAULTS_ONCE")
        if once is not None:
            try:
                Path(once).unlink()
            except FileNotFoundError:
                entries = {}
        numbers = {name: int(entries.get(name, 0)) for name in ("lose", "die", "stick", "freeze")}
        return cls(numbers["lose"], numbers["die"], numbers["stick"], numbers["freeze"])


class MarkedBuffer(PooledBuffer):
    """Buffer that marks the pixels of a released frame, so that a later reader is noticed."""

    __slots__ = ("_image",)

    def __init__(self, pool: BufferPool, slot: int, image: np.ndarray) -> None:
        super().__init__(pool, slot)
        self._image = image

    def release(self) -> None:
        self._image[0, 4:8] = 0xAA
        super().release()


@dataclass
class SyntheticCamera(Camera):
    config: CameraConfig
    clock: Clock
    faults: Faults = field(default_factory=Faults.from_environment)
    borrowable: int = 0
    deaths: int = 0

    def __post_init__(self) -> None:
        self._next = 0
        self._sequence = 0
        self._start_ns = 0
        size = self.config.width, self.config.height
        pixels = np.random.default_rng(1).integers(0, 255, size[::-1], dtype=np.uint8)
        self._free = deque(range(2))
        self._buffers = BufferPool(2, self.borrowable, pixels.size, self._free.append)
        for slot in range(len(self._buffers)):
            self._buffers.image(slot, *size)[:] = pixels

    def open(self) -> CameraInfo:
        if self.config.address == "absent":
            raise CameraNotFound("camera absent: nothing answers: check cable and address")
        return CameraInfo("Percuss", "Synthetic", "1", self.config.address)

    def device_ns(self, host_ns: int) -> int:
        return ORIGIN_NS + host_ns + round(DRIFT * (host_ns % 10**13))

    def start(self) -> None:
        self._start_ns = self.clock.monotonic_ns()

    def read(self, timeout_s: float) -> Frame | None:
        lost = 0
        if self.faults.lose_every and self._next % self.faults.lose_every == self.faults.lose_every - 1:
            self._next += 1
            lost = 1
        if self.faults.die_after and self._next >= self.faults.die_after:
            self.faults.die_after = 0
            raise CameraLost("camera synthetic: no frame for 1 s: check power and cable")
        if self.faults.stick_at and self._next == self.faults.stick_at:
            time.sleep(1000.0)
        if self.faults.freeze_at and self._next == self.faults.freeze_at:
            ctypes.PyDLL(None).sleep(1000)
        exposed = self._start_ns + round(self._next * 1e9 / self.config.frame_rate_hz)
        ready = exposed + round(self.config.exposure_us * 1000) + 500_000
        wait = (ready - self.clock.monotonic_ns()) * 1e-9
        if wait > timeout_s:
            time.sleep(timeout_s)
            return None
        if wait > 0:
            time.sleep(wait)
        slot = self._free.popleft()
        image = self._buffers.image(slot, self.config.width, self.config.height)
        image[0, 4:8] = 0
        image[0, :4] = np.frombuffer(np.uint32(self._next).tobytes(), np.uint8)
        self._next += 1
        self._sequence += 1
        return Frame(
            image=image,
            sequence=self._sequence - 1,
            frame_id=(65_400 + self._next) % 65_535 + 1,
            device_time_ns=self.device_ns(exposed),
            host_time_ns=self.clock.monotonic_ns(),
            exposure_us=self.config.exposure_us,
            lost_before=lost,
            buffer=MarkedBuffer(self._buffers, slot, image),
        )

    @property
    def borrowable_frames(self) -> int:
        return self.borrowable

    def latch_clock(self) -> ClockReading | None:
        before = self.clock.monotonic_ns()
        return ClockReading(self.device_ns(before + 10_000), before, before + 20_000)

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass


_faults = Faults.from_environment()


def make(config: CameraConfig, clock: Clock, borrowable_frames: int = 0) -> Camera:
    """Synthetic camera with the faults of the environment variable CAMERA_FAULTS.

    All cameras of a process share the faults: one that occurs once does not recur after a reconnection.
    """
    return SyntheticCamera(config, clock, _faults, borrowable_frames)


if __name__ == "__main__":
    from acquire.capture.process import serve

    fd, heartbeat_fd = (int(sys.argv[sys.argv.index(name) + 1]) for name in ("--fd", "--heartbeat"))
    serve(fd, heartbeat_fd, make)
