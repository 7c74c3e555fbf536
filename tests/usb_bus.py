"""USB bus of this process, to which tests plug virtual cameras: the stand-in for libusb, in place of libusb.

It must be loaded before Aravis, so it is loaded once the tests are collected, if one of them has the mark
`usb_bus`.
"""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import pytest

from acquire.clock.clock import SystemClock
from acquire.errors import CameraError
from acquire.virtual.usb3_camera import VirtualUsb3Camera
from acquire.virtual.usb3_features import Usb3Habits
from acquire.virtual.usb_library import compile_library
from tests.acquire.virtual.pattern_source import PatternSource

SERIAL, SIZE, SEED = "PATTERN", (656, 492), 7


@cache
def bus_folder() -> tuple[Path | None, str]:
    """Folder of the loaded stand-in; or None, and why it cannot be loaded."""
    # The folder is deleted when this process ends.
    folder = _folders().name
    try:
        ctypes.CDLL(str(compile_library(Path(folder))), ctypes.RTLD_GLOBAL)
    except (CameraError, OSError) as error:
        return None, str(error)
    return Path(folder), ""


@cache
def _folders() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="pu-")


@contextmanager
def pattern_usb3(habits: Usb3Habits | None = None) -> Iterator[VirtualUsb3Camera]:
    """Camera with the test pattern, plugged in until the block ends."""
    folder, reason = bus_folder()
    if folder is None:
        pytest.skip(reason)
    clock = SystemClock()
    camera = VirtualUsb3Camera(folder, SERIAL, SIZE, PatternSource(clock, SEED), clock, habits)
    try:
        yield camera
    finally:
        camera.close()
