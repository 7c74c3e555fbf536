"""The USB3 Vision path of the Aravis client.

Aravis has no virtual USB camera. Its in-process fake camera is neither GigE nor USB: with it everything runs
but the USB transfers themselves, the bandwidth limit and the clock; the last two run on a stand-in with the
calls of Aravis.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from acquire.camera.aravis_library import aravis_and_glib
from acquire.camera.aravis_link import UsbLink
from acquire.camera.factory import make_camera
from acquire.clock.clock import SystemClock
from acquire.errors import CameraError, CameraNotFound, CameraSettingError

GIGE_ONLY = ("gv_set_packet_size", "gv_get_packet_size", "gv_set_stream_options", "gv_auto_packet_size")


@pytest.fixture
def fake_interface(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Aravis with its in-process fake camera, and with every GigE-only call made to fail."""
    pytest.importorskip("gi")
    Aravis, _ = aravis_and_glib()

    def refuse(*_: object) -> None:
        raise AssertionError("a call for GigE cameras alone")

    for name in GIGE_ONLY:
        monkeypatch.setattr(Aravis.Camera, name, refuse)
    Aravis.enable_interface("Fake")
    yield Aravis
    Aravis.disable_interface("Fake")


def test_frames_arrive_without_a_call_of_gige(fake_interface, camera_config) -> None:
    camera = make_camera(camera_config("Fake_1", kind="usb3", exposure_us=2000.0), SystemClock(), 4)
    info = camera.open()
    assert (info.model, info.address, info.kind) == ("Fake", "Fake_1", "usb3")
    assert camera.latch_clock() is None
    (warning,) = camera.warnings
    assert "cannot latch its clock" in warning
    camera.start()
    images = []
    for number in range(30):
        frame = camera.read(5.0)
        assert frame is not None
        assert frame.sequence == number
        assert frame.image.shape == (492, 656)
        assert frame.exposure_us == pytest.approx(2000.0)
        images.append(frame.image[:, :64].copy())
        frame.buffer.release()
    assert any(not np.array_equal(images[0], image) for image in images)
    assert camera.take_foreign_packets().count == 0
    camera.stop()
    camera.close()


def test_a_setting_is_refused_and_an_absent_camera_named(fake_interface, camera_config) -> None:
    with pytest.raises(CameraSettingError, match="Width = 5000"):
        make_camera(camera_config("Fake_1", kind="usb3", width=5000), SystemClock()).open()
    with pytest.raises(CameraNotFound, match=r"no USB3 Vision camera U3V-1 can be opened .* check its cable"):
        make_camera(camera_config("U3V-1", kind="usb3"), SystemClock()).open()


@dataclass
class StandIn:
    """Calls of Aravis's Camera and Device that a USB camera has; models no transfer."""

    switch_refused: bool = False
    increment: int = 1
    limits: list[int] = field(default_factory=list)
    latched: int = 0

    def is_uv_device(self) -> bool:
        return True

    def uv_is_bandwidth_control_available(self) -> bool:
        return True

    def uv_get_bandwidth_bounds(self) -> tuple[int, int]:
        return 1, 380_000_000

    def uv_set_bandwidth(self, value: int) -> None:
        if self.switch_refused and value == 0:
            raise aravis_and_glib()[1].Error("no such entry: Off")
        self.limits.append(value)

    def is_feature_available(self, name: str) -> bool:
        return name in {"TimestampLatch", "TimestampLatchValue", "TimestampIncrement"}

    def get_integer(self, _name: str) -> int:
        return self.increment

    def execute_command(self, name: str) -> None:
        assert name == "TimestampLatch"
        self.latched = 1000

    def get_integer_feature_value(self, name: str) -> int:
        assert name == "TimestampLatchValue"
        return self.latched


@pytest.mark.parametrize(("refused", "limits"), [(False, [0]), (True, [380_000_000])])
def test_the_bandwidth_limit_is_switched_off_or_raised(
    camera_config, refused: bool, limits: list[int]
) -> None:
    pytest.importorskip("gi")
    camera = StandIn(switch_refused=refused)
    link = UsbLink(camera_config("U3V-1", kind="usb3"), SystemClock())
    link.prepare_stream(camera)
    assert camera.limits == limits
    assert link.warnings == []


def test_the_clock_is_latched_by_its_standard_feature(camera_config) -> None:
    camera = StandIn(increment=8)
    link = UsbLink(camera_config("U3V-1", kind="usb3"), SystemClock())
    link.prepare_clock(camera)
    assert link.can_latch
    assert link.latched_ns(camera) == 0
    link.latch_now(camera)
    assert link.latched_ns(camera) == 8000


def test_a_usb_camera_is_no_gige_one(fake_interface, camera_config) -> None:
    with pytest.raises(CameraError, match='is not a GigE Vision camera: write kind = "usb3"'):
        make_camera(camera_config("Fake_1", kind="gige"), SystemClock()).open()


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_no_number_is_missing_in_a_minute(fake_interface, camera_config) -> None:
    """By the frames' numbers alone: the fake camera's thread keeps no even time on a busy computer."""
    camera = make_camera(camera_config("Fake_1", kind="usb3"), SystemClock(), 4)
    camera.open()
    camera.start()
    numbers = []
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        frame = camera.read(5.0)
        assert frame is not None
        numbers.append(frame.frame_id)
        frame.buffer.release()
    camera.close()
    assert len(numbers) > 3000
    assert all((after - before) % 65535 == 1 for before, after in pairwise(numbers))
