"""Few frames, unevenly: their interval, and their noise, are known or not, and no warning is given."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from analyze.motion.free_motion import frame_noise
from analyze.sources.frame_timing import frame_timing, usual_interval


@pytest.mark.parametrize(
    ("times", "interval"),
    [([0, 1, 11], 10), ([0, 9, 10, 20, 30, 60], 9.67), ([5, 3], 2), ([30, 0, 10, 20], 10)],
)
def test_the_usual_interval_is_one_that_is_there(times, interval):
    """Of two gaps of which one is ten times the other neither is near their mean.

    That mean was of nothing.
    """
    assert usual_interval(times) == pytest.approx(interval, abs=0.01)


def test_three_frames_have_a_pace():
    pace = frame_timing([0, 1, 11], Fraction(1, 30), None, None)
    assert pace is not None
    assert pace.interval_s == pytest.approx(1 / 3)


def test_the_noise_of_two_frames_is_not_known():
    assert math.isnan(frame_noise(np.zeros(2)))
    assert frame_noise(np.array([0.0, 1.0, 0.0])) > 0
