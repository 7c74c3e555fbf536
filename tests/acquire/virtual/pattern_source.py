"""Test pattern for the virtual camera: known bytes in every frame, without world and renderer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.clock.clock import Clock
    from acquire.virtual.image_source import StreamSettings

_STAMP_BYTES = 16


class PatternSource:
    """Image source of seeded noise that changes with every frame.

    The first 16 bytes of a frame are two little-endian int64: its start of exposure (host monotonic ns) and
    its number, from 0.

    Args:
        clock: the host's clock.
        seed: seed of the noise.
    """

    def __init__(self, clock: Clock, seed: int) -> None:
        self._clock, self._seed, self._number = clock, seed, 0
        self._noise = np.zeros((0, 0), np.uint8)

    def latest_time_ns(self) -> int:
        """Current host monotonic time [ns]: a pattern needs no world to wait for."""
        return self._clock.monotonic_ns()

    def image(self, start_ns: int, settings: StreamSettings) -> NDArray[np.uint8]:
        """Pattern (height, width), uint8, of the next frame, stamped with `start_ns` and the frame's number.

        Args:
            start_ns: host monotonic time at which the exposure starts.
            settings: its width and height are the image's; nothing else is used.
        """
        if self._noise.shape != (settings.height, settings.width):
            self._noise = noise(settings.width, settings.height, self._seed)
        image = stamped(self._noise, start_ns, self._number)
        self._number += 1
        return image


def noise(width: int, height: int, seed: int) -> NDArray[np.uint8]:
    """Noise (height, width), uint8, uniform over 0-255, from a seed: the basis of every pattern frame.

    Args:
        width: width of the image [px].
        height: height of the image [px].
        seed: seed of the generator.
    """
    return np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)


def stamped(pattern: NDArray[np.uint8], start_ns: int, number: int) -> NDArray[np.uint8]:
    """Image (height, width) of one frame: the pattern XOR its number, with a stamp in its first 16 bytes.

    Args:
        pattern: (height, width) pattern; it is not changed.
        start_ns: start of the exposure (host monotonic), the first 8 bytes of the stamp.
        number: number of the frame, the other 8 bytes; its lowest byte is the XOR's.
    """
    image = pattern ^ np.uint8(number & 0xFF)
    image.reshape(-1)[:_STAMP_BYTES] = np.array([start_ns, number], dtype="<i8").view(np.uint8)
    return image


def read_stamp(image: NDArray[np.uint8]) -> tuple[int, int]:
    """Start of exposure [ns, host monotonic] and frame number from the first 16 bytes of a pattern image."""
    start_ns, number = image.reshape(-1)[:_STAMP_BYTES].copy().view("<i8")
    return int(start_ns), int(number)
