"""The USB3 Vision path of the Aravis client, against a virtual camera behind a stand-in for libusb."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from acquire.camera.aravis_library import aravis_and_glib
from acquire.camera.base import Camera
from acquire.camera.factory import discover_cameras, make_camera
from acquire.clock.clock import SystemClock
from acquire.errors import CameraError, CameraLost, CameraNotFound, CameraSettingError
from acquire.frames.frame import Frame
from acquire.virtual.usb3_features import DEFAULTS, LIMIT, LIMIT_MODE, Usb3Habits, device_id
from acquire.virtual.usb_device import ACCESS
from schemas.rig import CameraConfig
from tests.acquire.virtual.pattern_source import PatternSource, noise, read_stamp, stamped
from tests.usb_bus import SEED, SERIAL, SIZE, pattern_usb3

pytestmark = [
    pytest.mark.usb_bus,
    # Aravis 0.8.26 joins a thread that was never started, if a camera cannot be opened.
    pytest.mark.filterwarnings("ignore:g_thread_join"),
]
GIGE_ONLY = ("gv_set_packet_size", "gv_get_packet_size", "gv_set_stream_options", "gv_auto_packet_size")
FEW, MANY = 16, 64
"""numbers of buffers with which transfers are asked for one by one, and queued"""

Configure = Callable[..., CameraConfig]


@pytest.fixture(autouse=True)
def no_call_of_gige(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a call for GigE cameras alone")

    for name in GIGE_ONLY:
        monkeypatch.setattr(aravis_and_glib()[0].Camera, name, refuse)


@pytest.fixture
def usb_config(camera_config: Configure) -> Configure:
    def make(**changes: object) -> CameraConfig:
        changes = {"kind": "usb3", "buffers": MANY} | changes
        return camera_config(device_id(SERIAL), **changes)

    return make


@pytest.fixture
def plugged() -> Iterator[Any]:
    with pattern_usb3() as camera:
        yield camera


def next_frame(camera: Camera) -> Frame:
    frame = camera.read(20.0)
    assert frame is not None
    return frame


def opened(config: CameraConfig) -> Camera:
    camera = make_camera(config, SystemClock(), 4)
    camera.open()
    return camera


def read_for_ever(camera: Camera) -> None:
    while True:
        frame = camera.read(0.2)
        if frame is not None:
            frame.buffer.release()


@pytest.mark.parametrize("buffers", [FEW, MANY])
def test_frames_are_byte_exact_periodic_and_none_is_lost(plugged, usb_config, buffers: int) -> None:
    pattern = noise(*SIZE, SEED)
    camera = make_camera(usb_config(buffers=buffers), SystemClock(), 4)
    info = camera.open()
    assert (info.vendor, info.model, info.serial, info.kind) == ("Percuss", "USB3-656", SERIAL, "usb3")
    assert camera.warnings == ()
    camera.start()
    last_ns = 0
    for number in range(60):
        frame = next_frame(camera)
        start_ns, drawn = read_stamp(frame.image)
        assert (drawn, frame.sequence, frame.frame_id, frame.lost_before) == (number, number, number, 0)
        assert np.array_equal(frame.image, stamped(pattern, start_ns, drawn))
        assert abs(plugged.device_clock.to_device(start_ns) - frame.device_time_ns) < 10
        assert number == 0 or frame.device_time_ns - last_ns == 8_333_000
        last_ns = frame.device_time_ns
        assert frame.host_time_ns > start_ns + 1_500_000
        frame.buffer.release()
    camera.stop()
    camera.close()


def test_a_camera_left_streaming_with_a_limit_and_another_programs_settings_is_set(usb_config) -> None:
    habits = Usb3Habits(left_streaming=True, limit_bytes_s=20_000_000)  # the images need 38.7 MB/s
    with pattern_usb3(habits) as server:
        camera = opened(usb_config())
        assert server.register(LIMIT_MODE) == 0
        assert {address: server.register(address) for address in DEFAULTS} == DEFAULTS
        camera.start()
        assert next_frame(camera).frame_id == 0
        camera.close()


def test_a_limit_that_cannot_be_lifted_is_named_where_it_is_too_low(usb_config) -> None:
    with pattern_usb3(Usb3Habits(limit_bytes_s=20_000_000, limit_locked=True)) as server:
        with pytest.raises(
            CameraSettingError,
            match=r"frame rate = 120 Hz was written, 61\.9.* Hz read back: the camera limits its images to "
            r"20 MB/s \(DeviceLinkThroughputLimit\), which are 62 Hz: use a USB 3 port",
        ):
            opened(usb_config())
        opened(usb_config(frame_rate_hz=60.0)).close()
        assert server.register(LIMIT) == 20_000_000


def test_settings_and_other_kinds_are_refused(plugged, usb_config) -> None:
    with pytest.raises(CameraSettingError, match="Width = 5000"):
        opened(usb_config(width=5000))
    with pytest.raises(CameraError, match='is not a GigE Vision camera: write kind = "usb3"'):
        opened(usb_config(kind="gige"))


def test_a_camera_is_found_absent_in_use_or_not_to_be_opened(usb_config) -> None:
    with pytest.raises(CameraNotFound, match=r"no USB3 Vision camera answers as Percuss-.* check its cable"):
        opened(usb_config())
    with pattern_usb3():
        found, notes = discover_cameras()
        assert [camera.address for camera in found if camera.kind == "usb3"] == [device_id(SERIAL)]
        assert notes == []
        first = opened(usb_config())
        first.start()
        with pytest.raises(CameraError, match="used by another program: close it, then try again"):
            opened(usb_config())
        next_frame(first)
        first.close()
    with pattern_usb3(Usb3Habits(open_status=ACCESS)):
        denied = (
            r"may not open the USB3 Vision camera /dev/bus/usb/002/009 \(LIBUSB_ERROR_ACCESS\): copy docs/99"
        )
        with pytest.raises(CameraError, match=denied):
            opened(usb_config())
        found, (note,) = discover_cameras()
        assert not [camera for camera in found if camera.kind == "usb3"]
        assert "copy docs/99-percuss.rules to /etc/udev/rules.d" in note


@pytest.mark.parametrize("buffers", [FEW, MANY])
def test_an_unplugged_camera_is_lost_and_comes_back(usb_config, buffers: int) -> None:
    config = usb_config(buffers=buffers)
    with pattern_usb3() as server:
        camera = opened(config)
        camera.start()
        next_frame(camera)
        server.close()
        began = time.monotonic()
        with pytest.raises(
            CameraLost, match="it left the USB bus: check power and cable, then connect again"
        ):
            read_for_ever(camera)
        assert time.monotonic() - began < 2.0
        camera.close()
    with pattern_usb3():
        camera = opened(config)
        camera.start()
        assert next_frame(camera).sequence == 0
        camera.close()


@pytest.mark.parametrize("buffers", [FEW, MANY])
@pytest.mark.parametrize("fault", ["cut_every", "lacks_trailer_every"])
def test_frames_that_arrive_damaged_are_counted_as_lost(usb_config, fault: str, buffers: int) -> None:
    pattern = noise(*SIZE, SEED)
    with pattern_usb3(Usb3Habits(**{fault: 10})):
        camera = opened(usb_config(buffers=buffers))
        camera.start()
        lost, numbers = 0, []
        while not numbers or numbers[-1] < 35:
            frame = next_frame(camera)
            numbers.append(frame.frame_id)
            lost += frame.lost_before
            assert np.array_equal(frame.image, stamped(pattern, *read_stamp(frame.image)))
            frame.buffer.release()
        camera.close()
    assert lost == sum(after - before - 1 for before, after in pairwise(numbers))
    assert 3 <= lost <= 6  # a missing trailer may take the next frame with it


def test_a_camera_whose_frames_all_arrive_damaged_is_lost_with_that_reason(usb_config) -> None:
    with pattern_usb3(Usb3Habits(cut_every=1)):
        camera = opened(usb_config(stall_s=0.5))
        camera.start()
        with pytest.raises(
            CameraLost, match=r"\(\d+ frames arrived incomplete: use a USB 3 port of its own, and a shorter"
        ):
            read_for_ever(camera)
        camera.close()


def test_a_clock_that_cannot_be_latched_is_reported(usb_config) -> None:
    with pattern_usb3(Usb3Habits(latches=False)):
        camera = opened(usb_config())
        (warning,) = camera.warnings
        assert "cannot latch its clock: frame times come from their arrival" in warning
        assert camera.latch_clock() is None
        camera.close()


def test_frames_that_the_cameras_memory_cannot_hold_are_counted(usb_config) -> None:
    with pattern_usb3(Usb3Habits(memory_frames=2)):
        camera = opened(usb_config())
        camera.start()
        held = [next_frame(camera) for _ in range(MANY)]
        assert camera.read(0.2) is None
        for frame in held:
            frame.buffer.release()
        kept = [next_frame(camera).lost_before for _ in range(3)]
        assert max(kept) > 10
        camera.close()


@pytest.mark.slow
@pytest.mark.timeout(180)
@pytest.mark.parametrize("rate_hz", [120.0, 365.0])
def test_no_frame_is_lost_in_a_minute(plugged, usb_config, rate_hz: float) -> None:
    camera = opened(usb_config(frame_rate_hz=rate_hz))
    camera.start()
    end, frames, lost = time.monotonic() + 60.0, 0, 0
    while time.monotonic() < end:
        frame = next_frame(camera)
        frames, lost = frames + 1, lost + frame.lost_before
        frame.buffer.release()
    camera.close()
    assert lost == 0
    assert frames > 59 * rate_hz


def test_late_images_that_are_never_sent_are_told_from_those_lost(
    usb_config, plugged, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A computer that draws too slowly owes images when the camera is opened anew: nothing lost them."""
    quick = PatternSource.image

    def slow(*arguments: Any) -> Any:
        time.sleep(0.04)
        return quick(*arguments)

    monkeypatch.setattr(PatternSource, "image", slow)
    camera = opened(usb_config())
    camera.start()
    begin_ns, times = 0, [0]
    while times[-1] < begin_ns + 80_000_000:  # ten images, in whose time some fifty were exposed
        times.append(next_frame(camera).device_time_ns)
        begin_ns = begin_ns or times[-1]
    camera.stop()
    camera.start()
    missed = (next_frame(camera).device_time_ns - times[-1]) * 120e-9
    assert 0.7 * missed - 10 < plugged.statistics.unsent < missed
    assert plugged.packet_counts == {"memory_full": 0}
    camera.close()
