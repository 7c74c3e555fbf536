"""Stream of a camera whose clock drifts, while the host's wall clock is set.

Only the wall anchor may depend on the wall clock.
"""

from __future__ import annotations

import threading
from itertools import pairwise

import numpy as np
import pytest

from acquire.camera.stream import CameraStream
from acquire.clock.clock import SystemClock
from acquire.frames.frame import Frame
from tests.acquire.synthetic_camera import Faults, SyntheticCamera

FRAMES = 90


class SteppedClock(SystemClock):
    """A wall clock that is set while the camera runs."""

    def __init__(self) -> None:
        self.step_ns = 0

    def wall_ns(self) -> int:
        return super().wall_ns() + self.step_ns


@pytest.mark.parametrize("hours", [1, -1])
def test_a_step_of_the_wall_clock_changes_no_frames_time(
    camera_config, monkeypatch: pytest.MonkeyPatch, hours: int
) -> None:
    clock, config = SteppedClock(), camera_config("synthetic", width=64, height=48)
    camera = SyntheticCamera(config, clock, Faults())
    frames: list[Frame] = []
    enough = threading.Event()

    def on_frame(frame: Frame) -> None:
        frames.append(frame)
        if len(frames) == FRAMES // 3:
            clock.step_ns = hours * 3600 * 10**9
            monkeypatch.setattr("time.time", lambda: clock.wall_ns() * 1e-9)
            monkeypatch.setattr("time.time_ns", clock.wall_ns)
        if len(frames) == FRAMES:
            enough.set()

    stream = CameraStream(lambda: camera, config, clock, on_frame, lambda _reading: None, lambda _text: None)
    stream.start()
    try:
        assert enough.wait(60.0)
    finally:
        stream.stop()
    status = stream.status()
    assert (status.lost, status.trouble, status.latched) == (0, "", True)
    exposed = [frame.mid_exposure_ns - round(frame.exposure_us * 500.0) for frame in frames]
    sigmas = [
        (camera.device_ns(host) - frame.device_time_ns) / frame.mapping_sd_ns
        for host, frame in zip(exposed, frames, strict=True)
    ]
    assert np.max(np.abs(sigmas)) < 3.0
    assert all(later > earlier for earlier, later in pairwise(exposed))
