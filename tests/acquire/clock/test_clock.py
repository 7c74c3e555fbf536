"""Clock mapping: a drifting device clock read over a jittery wire is mapped back to the host's clock."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquire.camera.stream import FIRST_LATCH_S, FIRST_LATCHES, LATCH_S, LATCH_SPAN_S
from acquire.clock.bounds import lines_between
from acquire.clock.clock import DeviceClockMapper, SystemClock
from acquire.clock.reading import ClockReading

HOST0 = 86_400 * 10**9 * 200  # 200 days of uptime: float64 nanoseconds would be wrong by microseconds here


class DriftingDevice:
    """A device clock of constant rate error. Does not model temperature."""

    def __init__(self, drift: float, offset_ns: int) -> None:
        self.drift, self.offset_ns = drift, offset_ns

    def at(self, host_ns: int) -> int:
        elapsed = host_ns - HOST0
        return self.offset_ns + elapsed + round(self.drift * elapsed)


def feed(
    mapper: DeviceClockMapper,
    device: DriftingDevice,
    seconds: float,
    rng: np.random.Generator,
    rate_hz: float = 2.0,
) -> int:
    """Add `seconds` of readings of a device clock to `mapper`; return host time of the last one [ns].

    The delay between device and host is at least 20 us each way, plus exponential queueing.
    """
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
def test_latched_mapping_stays_within_30_us_whatever_the_drift(
    seed: int, drift: float, offset_ns: int
) -> None:
    device = DriftingDevice(drift, offset_ns)
    mapper = DeviceClockMapper()
    last = feed(mapper, device, 12.0, np.random.default_rng(seed))
    for host in range(last - 5 * 10**9, last + 10**9, 10**8):
        assert abs(mapper.to_host(device.at(host)) - host) <= 30_000


@pytest.mark.parametrize("drift", [-50e-6, 0.0, 50e-6])
@pytest.mark.parametrize("seed", range(5))
def test_every_frame_from_the_first_on_is_mapped_to_30_us_at_50_ppm(drift: float, seed: int) -> None:
    """Clock readings of an idle computer: round trips of 90 to 150 us, as often as CameraStream reads."""
    rng = np.random.default_rng(seed)
    device, mapper = DriftingDevice(drift, 5_000_000_000), DeviceClockMapper()

    def latch(host: int) -> None:
        there, back = rng.uniform(45_000, 75_000, 2)
        mapper.add(ClockReading(device.at(host), host - int(there), host + int(back)))

    for n in range(FIRST_LATCHES):
        latch(HOST0 + n * 600_000)
    due = HOST0 + FIRST_LATCHES * 600_000
    errors, sigmas = [], []
    for frame in range(HOST0 + 20_000_000, HOST0 + 12 * 10**9, 8_333_333):
        while due <= frame:
            latch(due)
            due += round((LATCH_S if mapper.span_s > LATCH_SPAN_S else FIRST_LATCH_S) * 1e9)
        time_ns = device.at(frame)
        errors.append(mapper.to_host(time_ns) - frame)
        sigmas.append(errors[-1] / mapper.sd_at(time_ns))
    assert np.max(np.abs(errors)) <= 30_000
    assert np.max(np.abs(sigmas)) < 3.0


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    drift=st.floats(-2.5e-4, 2.5e-4),
    slowness=st.floats(0.0, 20e6),
    one_way=st.booleans(),
    pause_s=st.floats(1e-3, 2.0),
)
def test_no_delay_causes_an_error_beyond_three_sigma(
    seed: int, drift: float, slowness: float, one_way: bool, pause_s: float
) -> None:
    rng = np.random.default_rng(seed)
    device, mapper = DriftingDevice(drift, 77), DeviceClockMapper()
    host = HOST0
    for _ in range(int(rng.integers(1, 40))):
        there, back = 20_000 + rng.exponential(slowness, 2) * (1, 0 if one_way else 1)
        mapper.add(ClockReading(device.at(host), host - int(there), host + int(back)))
        for ahead_s in (0.0, 0.5):
            time_ns = device.at(host + round(ahead_s * 1e9))
            error = mapper.to_host(time_ns) - host - round(ahead_s * 1e9)
            assert abs(error) < 3.0 * mapper.sd_at(time_ns)
        host += round(pause_s * 1e9) + int(there + back)


def drift_of(mapper: DeviceClockMapper) -> float:
    """Rate of the device clock against the host's, minus 1."""
    return 10**12 / (mapper.to_host(10**12) - mapper.to_host(0)) - 1.0


def test_a_clock_whose_rate_changed_is_followed() -> None:
    before, mapper = DriftingDevice(50e-6, 0), DeviceClockMapper()
    change = feed(mapper, before, 8.0, np.random.default_rng(2))
    after = DriftingDevice(-150e-6, before.at(change) - change + HOST0 + round(150e-6 * (change - HOST0)))
    assert after.at(change) == pytest.approx(before.at(change), abs=2)
    for n in range(1, 8):
        host = change + n * 500_000_000
        mapper.add(ClockReading(after.at(host), host - 50_000, host + 50_000))
    assert abs(mapper.to_host(after.at(host)) - host) < 3 * mapper.sd_at(after.at(host))
    assert mapper.span_s < 4.0
    assert drift_of(mapper) == pytest.approx(-150e-6, abs=20e-6)


def test_the_lines_between_bounds_have_the_mean_and_spread_of_many_drawn_ones() -> None:
    rng = np.random.default_rng(4)
    device = DriftingDevice(30e-6, 0)
    readings = []
    for n in range(4):
        host = HOST0 + n * 400_000_000
        there, back = rng.uniform(10_000, 60_000, 2).astype(int)
        readings.append(ClockReading(device.at(host), host - int(there), host + int(back)))
    newest = readings[-1]
    offset = rng.uniform(0.0, newest.host_after_ns - newest.host_before_ns, 2_000_000)
    rate = rng.uniform(-3e-4, 3e-4, offset.size)
    fits = np.ones(offset.size, dtype=bool)
    for reading in readings:
        elapsed = reading.device_time_ns - newest.device_time_ns
        mapped = newest.host_before_ns - reading.host_before_ns + elapsed + offset + rate * elapsed
        fits &= (mapped >= 0.0) & (mapped <= reading.host_after_ns - reading.host_before_ns)
    drawn = np.array([offset[fits], rate[fits]])
    lines = lines_between(readings, 3e-4)
    assert lines is not None
    assert (lines.offset_ns, lines.rate) == pytest.approx(tuple(drawn.mean(axis=1)), rel=0.01)
    covariance = np.cov(drawn)
    assert lines.covariance == pytest.approx((covariance[0, 0], covariance[0, 1], covariance[1, 1]), rel=0.02)


def test_fifty_ppm_is_found_and_the_error_agrees_with_its_sd() -> None:
    errors = []
    for seed in range(40):
        device = DriftingDevice(50e-6, 7_000_000_000)
        mapper = DeviceClockMapper()
        last = feed(mapper, device, 12.0, np.random.default_rng(seed))
        assert drift_of(mapper) == pytest.approx(50e-6, abs=8e-6)
        errors.append((mapper.to_host(device.at(last)) - last) / mapper.sd_at(device.at(last)))
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


def test_a_burst_of_quick_readings_does_not_hide_the_drift() -> None:
    device = DriftingDevice(37e-6, 0)
    mapper = DeviceClockMapper()
    for n in range(10):
        host = HOST0 - 10**9 + n * 200_000
        mapper.add(ClockReading(device.at(host), host - 30_000, host + 30_000))
    last = feed(mapper, device, 3.0, np.random.default_rng(5), rate_hz=4.0)
    assert abs(mapper.to_host(device.at(last)) - last) <= 30_000


def test_one_reading_gives_a_mapping_with_a_correct_sd() -> None:
    device = DriftingDevice(50e-6, 123)
    mapper = DeviceClockMapper()
    mapper.add(ClockReading(device.at(HOST0), HOST0 - 50_000, HOST0 + 50_000))
    assert mapper.latched
    assert abs(mapper.to_host(device.at(HOST0 + 10**8)) - HOST0 - 10**8) < 6_000
    assert 20_000 < mapper.sd_at(device.at(HOST0)) < 40_000


def test_a_restarted_device_empties_the_window() -> None:
    mapper = DeviceClockMapper()
    feed(mapper, DriftingDevice(0.0, 10**15), 5.0, np.random.default_rng(1))
    later = HOST0 + 10 * 10**9
    mapper.add(ClockReading(1_000, later - 20_000, later + 20_000))
    assert mapper.to_host(1_000) == later


def test_arrivals_serve_where_the_camera_cannot_latch() -> None:
    rng = np.random.default_rng(3)
    device = DriftingDevice(50e-6, 5)
    mapper = DeviceClockMapper()
    host = HOST0
    for n in range(1200):
        host = HOST0 + n * 8_333_333
        mapper.add_arrival(device.at(host), host + 900_000 + int(rng.exponential(200_000)))
    assert not mapper.latched
    assert abs(mapper.to_host(device.at(host)) - host - 900_000) <= 30_000
    assert mapper.sd_at(device.at(host)) > 10_000


def test_mapping_before_the_first_reading_is_an_error() -> None:
    with pytest.raises(ValueError, match="before its first reading"):
        DeviceClockMapper().to_host(1)


def test_system_clock_is_monotonic_and_ignores_negative_sleeps() -> None:
    clock = SystemClock()
    before = time.monotonic_ns()
    clock.sleep(-1.0)
    assert before <= clock.monotonic_ns() <= time.monotonic_ns()
    assert abs(clock.wall_ns() - time.time_ns()) < 10**9
