"""Cameras as makers build them: names, bounds, clocks, memory, and faults of camera and network."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from acquire.camera.aravis import AravisCamera
from acquire.camera.stream import CameraStream
from acquire.camera.subnet import not_found_remedy
from acquire.clock.clock import SystemClock
from acquire.errors import CameraSettingError
from acquire.frames.frame import Frame
from acquire.virtual.camera_makes import (
    BINNING_X,
    CHUNKS,
    GAMMA,
    MAKES,
    REVERSE_X,
    TRIGGER_MODE,
    USER_SET_LOAD,
)
from acquire.virtual.gige_camera import VirtualGigeCamera
from acquire.virtual.gige_faults import CameraHabits, GigeFaults
from schemas.rig import CameraConfig
from tests.acquire.virtual.pattern_source import PatternSource, read_stamp
from tests.loopback import loopback

ADDRESS = loopback(52)
MakeConfig = Callable[..., CameraConfig]


@contextmanager
def connected(config: CameraConfig, habits: CameraHabits) -> Iterator[tuple[AravisCamera, VirtualGigeCamera]]:
    """A virtual camera with habits, and its client, which is not open yet."""
    clock = SystemClock()
    server = VirtualGigeCamera(config.address, "MAKE", PatternSource(clock, 1), clock, habits=habits)
    camera = AravisCamera(config, clock)
    try:
        yield camera, server
    finally:
        camera.close()
        server.close()


def periods_ns(camera: AravisCamera, count: int = 6) -> set[int]:
    """Open the camera, start it, and return the times between its frames [ns]."""
    camera.open()
    camera.start()
    times = []
    for _ in range(count):
        frame = camera.read(20.0)
        assert frame is not None
        assert frame.image.shape == (492, 656)
        times.append(frame.device_time_ns)
        frame.buffer.release()
    camera.stop()
    return set(np.diff(times).tolist())


def register(server: VirtualGigeCamera, address: int) -> int:
    return server._library.read_register(server._fake, address)


@pytest.mark.parametrize("name", MAKES)
def test_every_make_streams_after_another_program_has_used_it(camera_config: MakeConfig, name: str) -> None:
    habits = CameraHabits(make=MAKES[name], faults=GigeFaults(left_streaming=True))
    with connected(camera_config(ADDRESS), habits) as (camera, server):
        assert register(server, BINNING_X) == 2
        assert periods_ns(camera) == {8_333_000}
        assert camera.warnings == ()
        kept = [register(server, each) for each in (BINNING_X, REVERSE_X, GAMMA, CHUNKS, TRIGGER_MODE)]
        assert kept == [1, 0, 0, 0, 0]


@pytest.mark.parametrize("name", ["basler-ace", "hikrobot"])
def test_pulses_start_frames_by_the_name_that_the_make_has(camera_config: MakeConfig, name: str) -> None:
    habits = CameraHabits(make=MAKES[name], pulses_hz=80.0)
    config = camera_config(ADDRESS, trigger="Line1", frame_rate_hz=80.0)
    with connected(config, habits) as (camera, _):
        assert periods_ns(camera) == {12_500_000}


@pytest.mark.parametrize(
    ("name", "gain", "message"),
    [
        ("basler-ace", {"gain_db": 0.0}, r"counts its gain in steps, 192 to 1023: write gain_raw = 192"),
        ("alvium-g1", {"gain_raw": 200}, r"counts its gain in dB, 0 to 24: write gain_db = 0"),
    ],
)
def test_a_gain_in_the_other_unit_is_refused(
    camera_config: MakeConfig, name: str, gain: dict[str, float], message: str
) -> None:
    with (
        connected(camera_config(ADDRESS, **gain), CameraHabits(make=MAKES[name])) as (camera, _),
        pytest.raises(CameraSettingError, match=message),
    ):
        camera.open()


@pytest.mark.parametrize(
    ("name", "gain"), [("basler-ace", {"gain_raw": 300}), ("alvium-g1", {"gain_db": 6.0})]
)
def test_a_gain_in_the_makes_unit_is_set(
    camera_config: MakeConfig, name: str, gain: dict[str, float]
) -> None:
    with connected(camera_config(ADDRESS, **gain), CameraHabits(make=MAKES[name])) as (camera, server):
        camera.open()
        assert server._settings().gain_db == pytest.approx(6.0 if "gain_db" in gain else 108 * 0.0359)


def test_a_remembered_setting_that_is_locked_is_named_with_its_remedy(camera_config: MakeConfig) -> None:
    """The rig file has no such setting, so that correcting it would be no remedy."""
    faults = GigeFaults(locked=frozenset({GAMMA, USER_SET_LOAD}))
    with (
        connected(camera_config(ADDRESS), CameraHabits(make=MAKES["mako"], faults=faults)) as (camera, _),
        pytest.raises(CameraSettingError, match=r"GammaEnable = .* was refused .*: set it with the maker's"),
    ):
        camera.open()


def test_settings_locked_at_the_wanted_value_do_not_matter(camera_config: MakeConfig) -> None:
    faults = GigeFaults(locked=frozenset({GAMMA, REVERSE_X}))  # the user set has cleared them
    with connected(camera_config(ADDRESS), CameraHabits(make=MAKES["mako"], faults=faults)) as (camera, _):
        assert periods_ns(camera) == {8_333_000}


def test_a_clock_without_its_frequency_is_told_and_frames_have_arrival_times(
    camera_config: MakeConfig,
) -> None:
    habits = CameraHabits(make=MAKES["mako"], faults=GigeFaults(hides_ticks=True))
    with connected(camera_config(ADDRESS), habits) as (camera, _):
        camera.open()
        assert camera._link.stamps_arrival
        assert camera.latch_clock() is None
        assert (
            "does not report its clock's frequency: frame times come from their arrival" in camera.warnings[0]
        )


@pytest.mark.parametrize(
    ("habits", "stated"),
    [
        (CameraHabits(make=MAKES["alvium-g1"]), "exposure_start"),
        (CameraHabits(make=MAKES["alvium-g1"]), "trigger"),
        (CameraHabits(make=MAKES["blackfly-s"]), "exposure_end"),
        (CameraHabits(make=MAKES["mako"], faults=GigeFaults(hides_ticks=True)), "exposure_start"),
    ],
    ids=["start", "trigger", "end", "arrival"],
)
def test_frames_have_the_time_of_mid_exposure(
    camera_config: MakeConfig, habits: CameraHabits, stated: str
) -> None:
    """The pattern carries the true start of its exposure; a wrong instant is off by the exposure, 6 ms."""
    config = camera_config(ADDRESS, exposure_us=6000.0, frame_rate_hz=100.0, timestamp_at=stated)
    clock = SystemClock()
    server = VirtualGigeCamera(ADDRESS, "MID", PatternSource(clock, 1), clock, habits=habits)
    off_ms: list[float] = []

    def compare(frame: Frame) -> None:
        true_ns = read_stamp(frame.image.reshape(-1))[0] + 3_000_000
        off_ms.append(1e-6 * (frame.mid_exposure_ns - true_ns))

    stream = CameraStream(
        lambda: AravisCamera(config, clock), config, clock, compare, lambda _: None, lambda _: None
    )
    try:
        stream.start()
        end_s = time.monotonic() + 20.0
        while len(off_ms) < 40 and time.monotonic() < end_s:
            time.sleep(0.02)
    finally:
        stream.stop()
        server.close()
    assert abs(float(np.median(off_ms[10:]))) < (0.3 if stream.status().latched else 2.0)


def test_packets_that_the_network_cuts_are_told(camera_config: MakeConfig) -> None:
    with connected(camera_config(ADDRESS), CameraHabits(make=MAKES["mako"], faults=GigeFaults(mtu=1500))) as (
        camera,
        _,
    ):
        camera.open()
        [warning] = camera.warnings
        assert "B are used instead of 8192 B" in warning
        assert "mtu 9000" in warning


def test_a_camera_in_another_subnet_gets_the_command_that_mends_it() -> None:
    assert "`sudo ip address add 169.254.7.8/16 dev " in not_found_remedy("169.254.7.9")
    assert "`sudo ip address add 203.0.113.4/24 dev " in not_found_remedy("203.0.113.5")
    assert "`sudo ip address add 203.0.113.2/24 dev " in not_found_remedy("203.0.113.1")
    assert "`sudo ip address add 203.0.113.253/24 dev " in not_found_remedy("203.0.113.254")
    assert not_found_remedy("127.0.0.9").startswith("check power")
    assert not_found_remedy("Basler-1234").startswith("check power")
