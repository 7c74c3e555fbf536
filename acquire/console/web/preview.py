"""Live image for browsers: compressed once for all, with aids for exposure, focus and distance."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from acquire.capture.preview_slot import PreviewImage

QUALITY: Final = 75
"""quality of the JPEG images [%]"""
AID_S: Final = 0.5
"""shortest interval between two computations of the aids [s]"""
SHOWN_S: Final = 3.0
"""time after the last request for an image for which the aids are computed [s]"""
_SATURATED: Final = 254


@dataclass(frozen=True)
class ImageAids:
    """Aids for exposure, focus and distance, from one image."""

    saturated_fraction: float
    """fraction of saturated pixels"""
    sharpness: float
    """variance of the image's Laplacian [grey levels squared]"""
    tag_px: float | None
    """mean side of the smallest tag in view [px of the camera's image]; None if there is none"""


class LiveImage:
    """Newest image of the camera as JPEG; any thread may call its methods.

    Args:
        newest: function that returns the newest preview image; None if there is none.
        monotonic_s: function that returns a monotonic time [s].
    """

    def __init__(
        self,
        newest: Callable[[], PreviewImage | None],
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._newest, self._monotonic_s = newest, monotonic_s
        self._lock = threading.Lock()
        self._coded: tuple[int, int, bytes] | None = None
        self._aids: ImageAids | None = None
        self._aids_s = 0.0
        self._asked_s = float("-inf")
        self._detector: cv2.aruco.ArucoDetector | None = None

    def jpeg(self) -> tuple[int, bytes] | None:
        """Number and JPEG bytes of the newest image; None if there is none."""
        with self._lock:
            self._asked_s = self._monotonic_s()
            image = self._newest()
            if image is None:
                return None
            if self._coded is None or self._coded[:2] != (image.number, image.time_ns):
                quality = [int(cv2.IMWRITE_JPEG_QUALITY), QUALITY]
                _, data = cv2.imencode(".jpg", image.image, quality)
                self._coded = (image.number, image.time_ns, data.tobytes())
                if self._asked_s - self._aids_s > AID_S:
                    self._aids_s = self._asked_s
                    self._aids = self._measured(image)
            return image.number, self._coded[2]

    @property
    def aids(self) -> ImageAids | None:
        """Aids from an image of the last seconds; None while nobody looks."""
        return self._aids if self._monotonic_s() - self._asked_s < SHOWN_S else None

    def _measured(self, image: PreviewImage) -> ImageAids:
        pixels = image.image
        side_px = self._smallest_tag(pixels)
        return ImageAids(
            saturated_fraction=float(np.mean(pixels >= _SATURATED)),
            sharpness=float(cv2.Laplacian(pixels, cv2.CV_32F).var()),
            tag_px=None if side_px is None else side_px * image.step,
        )

    def _smallest_tag(self, pixels: NDArray[np.uint8]) -> float | None:
        if self._detector is None:
            family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
            self._detector = cv2.aruco.ArucoDetector(family)
        corners, _, _ = self._detector.detectMarkers(pixels)
        sides = [
            float(np.mean(np.linalg.norm(np.diff(each[0], axis=0, append=each[0][:1]), axis=1)))
            for each in corners
        ]
        return min(sides, default=None)
