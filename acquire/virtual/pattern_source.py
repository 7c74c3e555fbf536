"""Test pattern for the virtual camera: known bytes in every frame, without world and renderer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.clock.clock import Clock
    from acquire.virtual.gige_camera import StreamSettings

_STAMP_BYTES = 16


class PatternSource:
    """Source of seeded noise that changes with every frame.

    The first 16 bytes of a frame are its start of exposure (host monotonic ns) and its number.
    """

    def __init__(self, clock: Clock, seed: int) -> None:
        self._clock, self._seed, self._number = clock, seed, 0
        self._noise = np.zeros((0, 0), np.uint8)

    def latest_time_ns(self) -> int:
        """Current time: there is no world to wait for."""
        return self._clock.monotonic_ns()

    def image(self, start_ns: int, settings: StreamSettings) -> NDArray[np.uint8]:
        """Pattern (height, width) of the next frame."""
        if self._noise.shape != (settings.height, settings.width):
            self._noise = noise(settings.width, settings.height, self._seed)
        image = stamped(self._noise, start_ns, self._number)
        self._number += 1
        return image


def noise(width: int, height: int, seed: int) -> NDArray[np.uint8]:
    """Seeded noise (height, width) that the pattern is made from."""
    return np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)


def stamped(pattern: NDArray[np.uint8], start_ns: int, number: int) -> NDArray[np.uint8]:
    """Image of frame `number`: pattern (height, width) XOR number, with the stamp in its first bytes."""
    image = pattern ^ np.uint8(number & 0xFF)
    image.reshape(-1)[:_STAMP_BYTES] = np.array([start_ns, number], dtype="<i8").view(np.uint8)
    return image


def read_stamp(image: NDArray[np.uint8]) -> tuple[int, int]:
    """Start of exposure [host monotonic ns] and number of a pattern image."""
    start_ns, number = image.reshape(-1)[:_STAMP_BYTES].copy().view("<i8")
    return int(start_ns), int(number)
