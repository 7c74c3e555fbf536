"""Cameras on loopback addresses of their own, and a check that nothing is left behind."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from schemas.rig import CameraConfig
from schemas.session_manifest import CameraCalibrationSpec

CLOSE_S = 12.0


@pytest.fixture
def camera_config() -> Callable[..., CameraConfig]:
    """Factory of a CameraConfig for an address; keywords replace other entries.

    The stall time allows for a loaded computer that pauses for a second.
    """

    def make(address: str, **changes: object) -> CameraConfig:
        calibration = CameraCalibrationSpec(
            width=656,
            height=492,
            K=[[1430.0, 0.0, 327.5], [0.0, 1430.0, 245.5], [0.0, 0.0, 1.0]],
            T_world_camera=np.eye(4).tolist(),
        )
        return CameraConfig.model_validate(
            {
                "address": address,
                "calibration": calibration,
                "receive_buffer_bytes": 64 << 20,
                "buffers": 256,
                "stall_s": 10.0,
                **changes,
            }
        )

    return make


@contextmanager
def _process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, str(Path(__file__).with_name("pattern_camera.py")), *arguments]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def pattern_camera() -> Callable[..., object]:
    """Factory of a pattern camera in a separate process, as a context manager."""
    return _process


@pytest.fixture(scope="session")
def graves() -> Iterator[None]:
    """After all tests, wait for the threads that close dead cameras; fail if one outlasts 7.5 s.

    Not after each file: the last tests of a file would wait for nothing else.
    """
    yield
    end = time.monotonic() + CLOSE_S
    while (left := _burials()) and time.monotonic() < end:
        time.sleep(0.05)
    assert not left, f"left behind: {left}"


@pytest.fixture(autouse=True)
def nothing_left(graves: None) -> Iterator[None]:
    """Check that no thread outlives a test, except those that close dead cameras."""
    before = set(threading.enumerate())
    yield
    end = time.monotonic() + CLOSE_S
    while (left := set(threading.enumerate()) - before - _burials()) and time.monotonic() < end:
        time.sleep(0.05)
    assert not left, f"left behind: {left}"


def _burials() -> set[threading.Thread]:
    return {thread for thread in threading.enumerate() if thread.name == "aravis-close"}
