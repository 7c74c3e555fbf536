"""The contract of Camera (acquire/camera/base.py), checked on a virtual camera of each kind and make.

What a make decides (names, bounds, clock, locks) is checked on all six. The four tests of frame buffers run
on one GigE camera: the client owns that memory, and no register or packet of a make enters into it.

With `-m hardware` it is checked on the camera of the rig file that PERCUSS_RIG names.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from acquire.camera.base import Camera
from acquire.camera.factory import make_camera
from acquire.clock.clock import SystemClock
from acquire.errors import CameraError
from acquire.frames.frame import Frame
from acquire.virtual.camera_makes import MAKES
from acquire.virtual.gige_camera import VirtualGigeCamera
from acquire.virtual.gige_faults import USUAL, CameraHabits
from acquire.virtual.usb3_features import device_id
from schemas.camera_kind import CameraKindName
from schemas.rig import CameraConfig, RigConfig
from schemas.session_manifest import CameraCalibrationSpec
from tests.acquire.camera.video_device import pattern_video
from tests.acquire.virtual.pattern_source import PatternSource
from tests.loopback import loopback
from tests.usb_bus import SERIAL, pattern_usb3

ADDRESS = loopback(61)
CLOSE_S = 12.0
BUFFERS = 16
BORROWABLE = 20
STALL_S = 10.0
"""time without frames after which the camera counts as lost [s]; long, because a loaded machine may pause"""


def config(address: str, kind: CameraKindName = "gige") -> CameraConfig:
    calibration = CameraCalibrationSpec(
        width=656,
        height=492,
        K=[[1430.0, 0.0, 327.5], [0.0, 1430.0, 245.5], [0.0, 0.0, 1.0]],
        T_world_camera=np.eye(4).tolist(),
    )
    return CameraConfig(kind=kind, address=address, buffers=BUFFERS, stall_s=STALL_S, calibration=calibration)


@contextmanager
def virtual_gige(habits: CameraHabits) -> Iterator[CameraConfig]:
    clock = SystemClock()
    server = VirtualGigeCamera(ADDRESS, "CONTRACT", PatternSource(clock, 1), clock, habits=habits)
    try:
        yield config(ADDRESS)
    finally:
        server.close()


@contextmanager
def virtual_video(folder: Path) -> Iterator[CameraConfig]:
    with pattern_video(folder / "video0"):
        yield config(str(folder / "video0"), "v4l2")


@contextmanager
def virtual_usb3() -> Iterator[CameraConfig]:
    with pattern_usb3():
        yield config(device_id(SERIAL), "usb3")


REAL = pytest.param("real", marks=pytest.mark.hardware)
KINDS = ("gige", pytest.param("usb3", marks=pytest.mark.usb_bus), "v4l2", REAL)


@pytest.fixture(scope="module", params=[*KINDS, *MAKES])
def virtual(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[CameraConfig | None]:
    """Configuration of a virtual camera that serves all tests of its kind or make; None for a real one."""
    if request.param == "real":
        yield None
        return
    if request.param == "v4l2":
        opened = virtual_video(tmp_path_factory.mktemp("video"))
    elif request.param == "usb3":
        opened = virtual_usb3()
    else:
        opened = virtual_gige(CameraHabits(make=MAKES[request.param]) if request.param in MAKES else USUAL)
    with opened as found:
        yield found


one_of_each_kind = pytest.mark.parametrize("virtual", KINDS, indirect=True, scope="module")
"""runs a test of the client's own memory, which is the same for all makes"""


@pytest.fixture
def camera_config(virtual: CameraConfig | None, real_rig: Callable[[], RigConfig]) -> CameraConfig:
    if virtual is None:
        return real_rig().camera.model_copy(update={"buffers": BUFFERS, "stall_s": STALL_S})
    return virtual


@pytest.fixture
def camera(camera_config: CameraConfig) -> Iterator[Camera]:
    before = set(threading.enumerate())
    device = make_camera(camera_config, SystemClock(), BORROWABLE)
    try:
        yield device
    finally:
        device.close()
    end = time.monotonic() + CLOSE_S
    while (left := set(threading.enumerate()) - before) and time.monotonic() < end:
        time.sleep(0.02)
    assert not left


def next_frame(camera: Camera) -> Frame:
    frame = camera.read(20.0)
    assert frame is not None
    return frame


def test_the_camera_reports_its_identity(camera: Camera) -> None:
    info = camera.open()
    assert info.vendor
    assert info.model
    assert info.serial


def test_frames_are_numbered_and_their_clocks_run_forward(
    camera: Camera, camera_config: CameraConfig
) -> None:
    camera.open()
    camera.start()
    previous = next_frame(camera)
    assert previous.sequence == 0
    assert previous.lost_before == 0
    assert previous.image.shape == (camera_config.height, camera_config.width)
    assert previous.image.dtype == np.uint8
    for _ in range(30):
        previous.buffer.release()
        frame = next_frame(camera)
        assert frame.sequence == previous.sequence + 1
        assert frame.device_time_ns > previous.device_time_ns
        assert frame.host_time_ns > previous.host_time_ns
        assert frame.exposure_us == pytest.approx(camera_config.exposure_us, rel=0.02, abs=20.0)
        previous = frame
    previous.buffer.release()
    camera.stop()


@one_of_each_kind
def test_a_held_frame_is_not_overwritten(camera: Camera) -> None:
    """One camera of each kind: the buffers are the client's, and no make enters into them."""
    camera.open()
    camera.start()
    held = next_frame(camera)
    copy = held.image.copy()
    for _ in range(40):  # more than there are buffers
        next_frame(camera).buffer.release()
    assert np.array_equal(held.image, copy)
    held.buffer.release()


@one_of_each_kind
def test_frames_that_are_never_released_are_not_overwritten(camera: Camera) -> None:
    """One camera of each kind: the buffers are the client's, and no make enters into them."""
    camera.open()
    camera.start()
    held = [next_frame(camera) for _ in range(BUFFERS)]
    assert camera.read(0.3) is None
    for frame in held:
        frame.buffer.release()
    assert next_frame(camera).lost_before > 0  # what came meanwhile is counted


@one_of_each_kind
def test_borrowed_frames_take_nothing_from_reception(camera: Camera) -> None:
    """One camera of each kind: the buffers are the client's, and no make enters into them."""
    camera.open()
    camera.start()
    assert camera.borrowable_frames == BORROWABLE
    borrowed: list[tuple[Frame, np.ndarray]] = []
    for _ in range(BORROWABLE):
        frame = next_frame(camera)
        assert frame.image.ctypes.data % 4096 == 0
        assert frame.buffer.borrow()
        borrowed.append((frame, frame.image.copy()))
    previous = next_frame(camera)
    assert not previous.buffer.borrow(), "no buffer is left to take its place"
    for _ in range(2 * BUFFERS):
        previous.buffer.release()
        previous = next_frame(camera)
        assert previous.lost_before == 0
    previous.buffer.release()
    assert all(np.array_equal(frame.image, copy) for frame, copy in borrowed)
    other = threading.Thread(target=lambda: [frame.buffer.release() for frame, _ in borrowed[:5]])
    other.start()
    again = []
    other.join()
    for _ in range(5):
        frame = next_frame(camera)
        assert frame.buffer.borrow()
        again.append(frame)
    last = next_frame(camera)
    assert not last.buffer.borrow()
    for frame in (last, *again, *(frame for frame, _ in borrowed[5:])):
        frame.buffer.release()
    assert {next_frame(camera).lost_before for _ in range(BUFFERS // 2)} == {0}


@one_of_each_kind
def test_a_borrowed_frame_outlives_its_camera(camera: Camera) -> None:
    """One camera of each kind: the buffers are the client's, and no make enters into them."""
    camera.open()
    camera.start()
    frame = next_frame(camera)
    assert frame.buffer.borrow()
    copy = frame.image.copy()
    camera.close()
    assert np.array_equal(frame.image, copy)
    frame.buffer.release()
    assert not frame.buffer.borrow()


def test_clock_readings_are_bounded_by_host_times(camera: Camera) -> None:
    camera.open()
    first = camera.latch_clock()
    time.sleep(0.1)
    second = camera.latch_clock()
    assert first is not None
    assert second is not None
    assert first.host_before_ns < first.host_after_ns < second.host_before_ns < second.host_after_ns
    elapsed = second.device_time_ns - first.device_time_ns
    assert second.host_before_ns - first.host_after_ns < elapsed * (1 + 1e-4)
    assert elapsed * (1 - 1e-4) < second.host_after_ns - first.host_before_ns


def test_a_read_ends_in_time_and_without_a_frame_where_none_comes(camera: Camera) -> None:
    camera.open()
    camera.start()
    camera.stop()
    began = time.monotonic()
    assert camera.read(0.1) is None
    assert time.monotonic() - began < 2.0


def test_close_is_always_safe(camera: Camera) -> None:
    camera.close()
    camera.open()
    camera.start()
    camera.close()
    camera.close()
    with pytest.raises(CameraError, match="not open"):
        camera.read(0.1)
