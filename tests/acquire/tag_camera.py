"""Virtual camera before a still tag on white paper, run as `tag_camera.py ADDRESS`.

It ends when its input closes, or on SIGTERM.

The protocol is real (GigE Vision); the scene is not modelled: nothing moves, there is no lens, no noise.
"""

from __future__ import annotations

import signal
import sys

import cv2
import numpy as np

from acquire.clock.clock import SystemClock
from acquire.virtual.gige_camera import VirtualGigeCamera
from acquire.virtual.image_source import StreamSettings

TAG, EDGE_PX = 5, 96


class Still:
    """Image source that repeats one image."""

    def __init__(self) -> None:
        tag = cv2.aruco.generateImageMarker(
            cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), TAG, EDGE_PX
        )
        self._image = np.full((492, 656), 90, np.uint8)
        self._image[180:320, 250:390] = 200
        self._image[202 : 202 + EDGE_PX, 272 : 272 + EDGE_PX] = np.clip(tag, 30, 200)

    def latest_time_ns(self) -> int:
        """Host monotonic time now [ns]: the image does not depend on a simulated world."""
        return SystemClock().monotonic_ns()

    def image(self, start_ns: int, settings: StreamSettings) -> np.ndarray:
        """Image of the whole sensor, whatever region is set."""
        return self._image[: settings.height, : settings.width]


if __name__ == "__main__":
    sys.setswitchinterval(5e-4)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    camera = VirtualGigeCamera(sys.argv[1], "TAG", Still(), SystemClock())
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    try:
        sys.stdin.read()
    finally:
        camera.close()
