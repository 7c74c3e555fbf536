"""Timing from few, uneven frames: interval and noise, without numerical warnings."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from analyze.motion.free_motion import frame_noise
from analyze.sources.frame_timing import frame_timing, time_scatter, usual_interval


@pytest.mark.parametrize(
    ("times", "interval"),
    [([0, 1, 11], 10), ([0, 9, 10, 20, 30, 60], 9.67), ([5, 3], 2), ([30, 0, 10, 20], 10)],
)
def test_usual_interval_is_near_an_interval_that_occurs(times, interval):
    """Two gaps, one ten times the other, are both far from their mean, which must not be the result."""
    assert usual_interval(times) == pytest.approx(interval, abs=0.01)


def test_timing_from_three_frames():
    timing = frame_timing([0, 1, 11], Fraction(1, 30), None, None)
    assert timing is not None
    assert timing.interval_s == pytest.approx(1 / 3)


def test_noise_of_two_frames_is_nan():
    assert math.isnan(frame_noise(np.zeros(2)))
    assert frame_noise(np.array([0.0, 1.0, 0.0])) > 0


@pytest.mark.parametrize("jitter_ns", [0.0, 1e5, 6e5])
def test_scatter_of_frame_times_is_measured_beside_lost_frames_and_a_drifting_rate(jitter_ns):
    random = np.random.default_rng(4)
    number = np.sort(random.permutation(1000)[:800])
    times = 1e9 / 240 * (number + 2e-5 * number**2) + jitter_ns * random.standard_normal(800)
    scatter, interval = time_scatter(times.astype(np.int64))
    assert interval == pytest.approx(1e9 / 240, rel=0.1)
    assert scatter == pytest.approx(jitter_ns, rel=0.2, abs=0.05e6)


def test_rising_stamps_give_rising_times_whatever_the_stated_rate():
    """Stamps in hundredths of a second, as a GIF has, with a mean rate that is not that of the frames."""
    random = np.random.default_rng(2)
    for interval in range(1, 8):
        for delays in ([1, 3] * 30, [3, 3, 4] * 20, random.integers(1, 9, 60), [6, 6, 6, 1, 11] * 12):
            stamps = np.concatenate([[0], np.cumsum(delays)])
            timing = frame_timing(stamps.tolist(), Fraction(1, 100), Fraction(100, interval), None)
            assert timing is not None
            times = timing.times_ns(stamps.tolist())
            assert (np.diff(times) > 0).all()
            assert np.abs(times * 1e-7 - stamps).max() < 1


@pytest.mark.parametrize("rate", [Fraction(30000, 1001), Fraction(60), Fraction(240), Fraction(120)])
@pytest.mark.parametrize("rounding", [np.rint, np.floor])
def test_times_of_a_constant_rate_are_not_those_of_its_rounded_stamps(rate, rounding):
    frames = np.arange(500)[np.random.default_rng(1).random(500) > 0.05]
    stamps = rounding(1000 * (frames / float(rate)) + 0.3).astype(int).tolist()
    timing = frame_timing(stamps, Fraction(1, 1000), rate, None)
    assert timing is not None
    assert timing.steady_s == 1 / rate
    times = timing.times_ns(stamps)
    assert np.abs(times - times[0] - 1e9 * (frames - frames[0]) / float(rate)).max() < 2
