"""Clock mapping: a drifting device clock read over a jittery wire is mapped back to the host's clock."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquire.camera.base import ClockReading
from acquire.clock import DeviceClockMapper, SystemClock

HOST0 = 86_400 * 10**9 * 200  # 200 days of uptime: float64 nanoseconds would be wrong by microseconds here


class DriftingDevice:
    """A device clock of constant rate error. Does not model temperature."""

    def __init__(self, drift: float, offset_ns: int) -> None:
        self.drift, self.offset_ns = drift, offset_ns

    def at(self, host_ns: int) -> int:
        elapsed = host_ns - HOST0
        return self.offset_ns + elapsed + round(self.drift * elapsed)


def feed(mapper: DeviceClockMapper, device: DriftingDevice, seconds: float, rng: np.random.Generator, rate_hz: float = 2.0) -> int:
    """Read the clock over a wire: 20 us each way at least, exponential queueing on top. Returns the host time of the last reading."""
    host = HOST0
    for host in range(HOST0, HOST0 + round(seconds * 1e9), round(1e9 / rate_hz)):
        there, back = (20_000 + rng.exponential(30_000.0, 2)).astype(int)
        mapper.add(ClockReading(device.at(host), host - int(there), host + int(back)))
    return host


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    drift=st.floats(-1e-4, 1e-4),
    offset_ns=st.integers(0, 2**62),
)
def test_latched_mapping_stays_within_30_us_whatever_the_drift(seed: int, drift: float, offset_ns: int) -> None:
    device = DriftingDevice(drift, offset_ns)
    mapper = DeviceClockMapper()
    last = feed(mapper, device, 12.0, np.random.default_rng(seed))
    for host in range(last - 5 * 10**9, last + 10**9, 10**8):
        assert abs(mapper.to_host(device.at(host)) - host) <= 30_000


def test_fifty_ppm_is_found_and_the_error_agrees_with_its_sd() -> None:
    errors = []
    for seed in range(40):
        device = DriftingDevice(50e-6, 7_000_000_000)
        mapper = DeviceClockMapper()
        last = feed(mapper, device, 12.0, np.random.default_rng(seed))
        assert mapper.drift == pytest.approx(50e-6, abs=8e-6)
        errors.append((mapper.to_host(device.at(last)) - last) / mapper.sd_ns)
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


def test_a_burst_of_quick_readings_does_not_hide_the_drift() -> None:
    device = DriftingDevice(37e-6, 0)
    mapper = DeviceClockMapper()
    for n in range(10):
        host = HOST0 - 10**9 + n * 200_000
        mapper.add(ClockReading(device.at(host), host - 30_000, host + 30_000))
    last = feed(mapper, device, 3.0, np.random.default_rng(5), rate_hz=4.0)
    assert abs(mapper.to_host(device.at(last)) - last) <= 30_000


def test_one_reading_is_enough_to_start_with_an_honest_sd() -> None:
    device = DriftingDevice(50e-6, 123)
    mapper = DeviceClockMapper()
    assert not mapper.ready
    mapper.add(ClockReading(device.at(HOST0), HOST0 - 50_000, HOST0 + 50_000))
    assert mapper.ready
    assert mapper.latched
    assert abs(mapper.to_host(device.at(HOST0 + 10**8)) - HOST0 - 10**8) < 6_000
    assert 20_000 < mapper.sd_ns < 40_000


def test_a_restarted_device_empties_the_window() -> None:
    mapper = DeviceClockMapper()
    feed(mapper, DriftingDevice(0.0, 10**15), 5.0, np.random.default_rng(1))
    later = HOST0 + 10 * 10**9
    mapper.add(ClockReading(1_000, later - 20_000, later + 20_000))
    assert mapper.to_host(1_000) == later


def test_arrivals_serve_where_the_camera_cannot_latch() -> None:
    rng = np.random.default_rng(3)
    device = DriftingDevice(50e-6, 5)
    mapper = DeviceClockMapper(least_delay_ns=900_000)
    host = HOST0
    for n in range(1200):
        host = HOST0 + n * 8_333_333
        mapper.add_arrival(device.at(host), host + 900_000 + int(rng.exponential(200_000)))
    assert not mapper.latched
    assert abs(mapper.to_host(device.at(host)) - host) <= 30_000
    assert mapper.sd_ns > 10_000


def test_nothing_fed_is_said_so() -> None:
    with pytest.raises(ValueError, match="before its first reading"):
        DeviceClockMapper().to_host(1)


def test_system_clock_is_monotonic_and_ignores_negative_sleeps() -> None:
    clock = SystemClock()
    before = time.monotonic_ns()
    clock.sleep(-1.0)
    assert before <= clock.monotonic_ns() <= time.monotonic_ns()
    assert abs(clock.wall_ns() - time.time_ns()) < 10**9
