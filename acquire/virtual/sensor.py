"""Camera sensor: exposure, gain, vignette, shot and read noise, saturation, 8 bits.

Not modelled: fixed pattern, row noise, hot pixels, black level, rolling shutter (the camera has a global
shutter).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

REFERENCE_EXPOSURE_US = 1500.0
"""exposure at 0 dB at which the scene's grey levels are defined [us]"""
FULL_WELL_E = 6000.0
"""electrons at grey level 255 and 0 dB: shot noise of 3.1 levels on white paper"""
READ_NOISE = 1.5
"""standard deviation in grey levels at 0 dB, including the converter's quantisation"""
_BANK = 1 << 22
"""number of noise values drawn once"""


def brightness(exposure_us: float, gain_db: float) -> float:
    """Factor on the scene's grey levels due to exposure [us] and gain [dB]; 1 at 1500 us and 0 dB."""
    return exposure_us / REFERENCE_EXPOSURE_US * gain_factor(gain_db)


def gain_factor(gain_db: float) -> float:
    """Ratio of signal amplitudes for a gain in dB; 10 for 20 dB."""
    return 10.0 ** (gain_db / 20.0)


def vignette(width: int, height: int) -> NDArray[np.float32]:
    """Vignetting factor (height, width) on an image's grey levels: 1 in the centre, 0.9 in the corners."""
    x = (np.arange(width) - (width - 1) / 2) / (width / 2)
    y = (np.arange(height) - (height - 1) / 2) / (height / 2)
    return (1.0 - 0.05 * (x[None, :] ** 2 + y[:, None] ** 2)).astype(np.float32)


def noise_sd(clean: NDArray[np.float32], gain_db: float) -> NDArray[np.float32]:
    """Standard deviation of each pixel's noise [grey levels], of the shape of `clean`.

    sd^2 = (read noise * gain)^2 + 255 * gain * level / full well, with gain the amplitude ratio.

    Args:
        clean: noise-free grey levels, (height, width).
        gain_db: gain of the sensor [dB].
    """
    gain = gain_factor(gain_db)
    variance = cv2.addWeighted(clean, 255.0 * gain / FULL_WELL_E, clean, 0.0, (READ_NOISE * gain) ** 2)
    return np.asarray(cv2.sqrt(variance), np.float32)


class NoiseBank:
    """Store of normal noise drawn once; each frame uses a part of the store, from a random offset on.

    Args:
        rng: generator of noise and offsets.
        width: image width [px].
        height: image height [px].
    """

    def __init__(self, rng: np.random.Generator, width: int, height: int) -> None:
        self._rng = rng
        self._shape = (height, width)
        self._bank = rng.standard_normal(_BANK, dtype=np.float32)
        self._work = np.empty(self._shape, np.float32)

    def expose(self, clean: NDArray[np.float32], sd: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Frame (height, width), uint8: noise-free grey levels plus noise, rounded, saturated at 0 and 255.

        Args:
            clean: (height, width) noise-free grey levels.
            sd: (height, width) standard deviations of the noise [grey levels].
        """
        size = clean.size
        offset = int(self._rng.integers(0, _BANK - size))
        noise = self._bank[offset : offset + size].reshape(self._shape)
        cv2.multiply(noise, sd, self._work)
        return np.asarray(cv2.add(self._work, clean, dtype=cv2.CV_8U), np.uint8)
