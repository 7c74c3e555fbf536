"""The Aravis client against the virtual camera: real GVCP and GVSP on loopback addresses."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest

from acquire.camera.aravis import AravisCamera
from acquire.camera.aravis_library import discover
from acquire.clock.clock import DeviceClockMapper, SystemClock
from acquire.errors import CameraError, CameraLost, CameraNotFound, CameraSettingError
from acquire.frames.frame import Frame
from acquire.virtual.gige_camera import VirtualGigeCamera
from acquire.virtual.gige_faults import CameraHabits
from tests.acquire.virtual.pattern_source import PatternSource, noise, read_stamp, stamped
from tests.loopback import loopback

SEED = 7
PERIOD_NS = 8_333_000
"""120 fps in whole microseconds, as the camera's register holds it"""


def next_frame(camera: AravisCamera) -> Frame:
    frame = camera.read(20.0)
    assert frame is not None
    return frame


def read_for_ever(camera: AravisCamera, device_times_ns: list[int] | None = None) -> None:
    while True:
        frame = camera.read(0.2)
        if frame is not None:
            if device_times_ns is not None:
                device_times_ns.append(frame.device_time_ns)
            frame.buffer.release()


def test_frames_are_byte_exact_periodic_and_none_is_lost_at_120_fps(pattern_camera, camera_config) -> None:
    clock = SystemClock()
    pattern = noise(656, 492, SEED)
    with pattern_camera(loopback(31)):
        camera = AravisCamera(camera_config(loopback(31)), clock)
        info = camera.open()
        assert (info.vendor, info.model, info.serial, info.address) == (
            "Allied Vision Technologies",
            "GUPPY-SIM GE656",
            "PATTERN",
            loopback(31),
        )
        assert camera.receive_buffer_bytes > 0
        mapper = DeviceClockMapper()
        for _ in range(10):
            reading = camera.latch_clock()
            assert reading is not None
            assert reading.host_before_ns < reading.host_after_ns
            mapper.add(reading)
        camera.start()
        times, numbers, ids, sigmas = [], [], [], []
        for count in range(300):
            frame = next_frame(camera)
            start_ns, number = read_stamp(frame.image)
            assert np.array_equal(frame.image, stamped(pattern, start_ns, number))
            assert frame.lost_before == 0
            assert frame.sequence == count
            assert frame.host_time_ns > start_ns
            assert frame.exposure_us == pytest.approx(1500.0)
            times.append(frame.device_time_ns)
            numbers.append(number)
            ids.append(frame.frame_id)
            if count % 30 == 0 and (again := camera.latch_clock()) is not None:
                mapper.add(again)
            sigmas.append(
                (mapper.to_host(frame.device_time_ns) - start_ns) / mapper.sd_at(frame.device_time_ns)
            )
            frame.buffer.release()
        camera.stop()
        camera.close()
    assert set(np.diff(times)) == {PERIOD_NS}
    assert set(np.diff(numbers)) == {1}
    assert max(ids) == 65535
    assert min(ids) == 1  # the ids wrapped past 0
    assert camera.incomplete_frames == 0
    # In units of the stated sd, which is larger on a slow computer; on an idle one: make bench-clock.
    assert np.max(np.abs(sigmas)) < 3.0


def test_stop_and_start_again_loses_nothing(pattern_camera, camera_config) -> None:
    with pattern_camera(loopback(32)):
        camera = AravisCamera(camera_config(loopback(32)), SystemClock())
        camera.open()
        for _ in range(2):
            camera.start()
            last = None
            for _ in range(20):
                frame = next_frame(camera)
                if last is not None:
                    assert frame.device_time_ns - last == PERIOD_NS
                last = frame.device_time_ns
                frame.buffer.release()
            camera.stop()
        camera.close()


def test_region_exposure_gain_and_rate_are_set(pattern_camera, camera_config) -> None:
    with pattern_camera(loopback(33)):
        config = camera_config(
            loopback(33),
            width=320,
            height=200,
            offset_x=100,
            offset_y=50,
            frame_rate_hz=50.0,
            exposure_us=900.0,
            gain_raw=3,
        )
        camera = AravisCamera(config, SystemClock())
        camera.open()
        camera.start()
        first, second = next_frame(camera), next_frame(camera)
        assert first.image.shape == (200, 320)
        assert second.device_time_ns - first.device_time_ns == 20_000_000
        assert first.exposure_us == pytest.approx(900.0)
        camera.close()


def test_a_hardware_trigger_of_the_rig_file_starts_each_frame(camera_config) -> None:
    clock = SystemClock()
    server = VirtualGigeCamera(
        loopback(46), "V", PatternSource(clock, SEED), clock, habits=CameraHabits(pulses_hz=80.0)
    )
    camera = AravisCamera(camera_config(loopback(46), trigger="Line0", frame_rate_hz=80.0), clock)
    try:
        camera.open()
        camera.start()
        times = []
        for _ in range(10):
            frame = next_frame(camera)
            assert frame.lost_before == 0
            times.append(frame.device_time_ns)
            frame.buffer.release()
        assert set(np.diff(times)) == {12_500_000}
    finally:
        camera.close()
        server.close()


def test_missing_pulses_are_reported_and_free_running_turns_the_trigger_off(camera_config) -> None:
    clock = SystemClock()
    server = VirtualGigeCamera(loopback(47), "V", PatternSource(clock, SEED), clock)
    waiting = AravisCamera(camera_config(loopback(47), trigger="Line0"), clock)
    free = AravisCamera(camera_config(loopback(47)), clock)
    impatient = AravisCamera(camera_config(loopback(47), trigger="Line0", stall_s=0.3), clock)
    try:
        waiting.open()
        waiting.start()
        assert waiting.read(0.3) is None
        waiting.stop()
        waiting.close()
        free.open()  # the camera still has the other's settings
        free.start()
        next_frame(free).buffer.release()
        free.stop()
        free.close()
        impatient.open()
        impatient.start()
        with pytest.raises(
            CameraLost, match=r"no frame for \d\.\d s \(trigger = Line0: check that its pulses arrive\)"
        ):
            read_for_ever(impatient)
    finally:
        for camera in (waiting, free, impatient):
            camera.close()
        server.close()


def test_an_absent_camera_is_named_in_time(camera_config) -> None:
    began = time.monotonic()
    camera = AravisCamera(camera_config(loopback(34)), SystemClock())
    with pytest.raises(
        CameraNotFound, match=rf"no camera answers at {re.escape(loopback(34))} .*acquire discover"
    ) as caught:
        camera.open()
    assert time.monotonic() - began < 8.0  # 2.5 s of Aravis's time-outs
    assert "\n" not in str(caught.value)
    camera.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 5000}, "Width = 5000 px was refused"),
        ({"gain_raw": 500}, "gain = 500 steps was refused .*: correct the rig file"),
        (
            {"trigger": "Line7"},
            "TriggerSource = Line7 was refused .*'Line7' not an entry.*: correct the rig file",
        ),
    ],
)
def test_settings_the_camera_cannot_take_are_refused(pattern_camera, camera_config, changes, message) -> None:
    with pattern_camera(loopback(35)):
        camera = AravisCamera(camera_config(loopback(35), **changes), SystemClock())
        with pytest.raises(CameraSettingError, match=message):
            camera.open()
        camera.close()


def test_discovery_finds_the_camera_of_this_host(pattern_camera) -> None:
    with pattern_camera(loopback(44)):
        found = [info for info in discover(loopback(44)) if info.address == loopback(44)]
    assert [info.model for info in found] == ["GUPPY-SIM GE656"]


def test_calls_before_open_are_refused(camera_config) -> None:
    camera = AravisCamera(camera_config(loopback(39)), SystemClock())
    with pytest.raises(CameraError, match="is not open"):
        camera.start()
    assert camera.latch_clock() is None
    camera.close()
